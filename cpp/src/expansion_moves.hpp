// The loop over expansion moves, and the memory that it keeps.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "emseg/expansion.hpp"
#include "expansion_move.hpp"

namespace emseg {

struct ExpansionWorkspace::Moves {
  ExpansionMove<std::int32_t, std::int16_t> small;
  ExpansionMove<std::int32_t> narrow;
  ExpansionMove<std::int64_t> wide;
};

// Expands every label in turn until none has anything to gain, in at most `max_sweeps` sweeps.  Returns the
// gain of every sweep.
template <typename Cost, typename Capacity, typename Residual>
std::vector<std::int64_t> expand_in_turn(const BasicLabelingProblem<Cost>& problem, int max_sweeps,
                                         ExpansionMove<Capacity, Residual>& move,
                                         std::vector<std::int32_t>& labels,
                                         std::span<const std::uint64_t> allowed) {
  move.begin(problem, allowed);
  std::vector<std::int32_t> used(static_cast<std::size_t>(problem.label_count), 0);
  for (const std::int32_t label : labels) ++used[static_cast<std::size_t>(label)];

  // Labels in turn that have nothing to gain any more; a label that has just been expanded is one of them.
  std::int32_t settled = 0;
  std::vector<std::int64_t> gains;
  for (int sweep = 0; sweep < max_sweeps && settled < problem.label_count; ++sweep) {
    std::int64_t total = 0;
    for (std::int32_t alpha = 0; alpha < problem.label_count && settled < problem.label_count; ++alpha) {
      const std::int64_t gain = move.find(problem, labels, used, alpha);
      settled = gain > 0 ? 1 : settled + 1;
      for (const std::int32_t site : move.switched()) {
        std::int32_t& label = labels[static_cast<std::size_t>(site)];
        --used[static_cast<std::size_t>(label)];
        ++used[static_cast<std::size_t>(alpha)];
        label = alpha;
      }
      total += gain;
    }
    gains.push_back(total);
  }
  return gains;
}

// The same with the smallest integers that hold what the moves meet: `widest` bounds the range of the data
// costs plus twice the weights at any one site.
template <typename Cost>
std::vector<std::int64_t> expand_in_turn(const BasicLabelingProblem<Cost>& problem, int max_sweeps,
                                         std::int64_t widest, ExpansionWorkspace& workspace,
                                         std::vector<std::int32_t>& labels,
                                         std::span<const std::uint64_t> allowed = {}) {
  ExpansionWorkspace::Moves& moves = workspace.moves();
  if (widest > std::numeric_limits<std::int32_t>::max()) {
    return expand_in_turn(problem, max_sweeps, moves.wide, labels, allowed);
  }
  Cost heaviest = 0;
  for (const Cost weight : problem.weight) heaviest = std::max(heaviest, weight);
  if (heaviest <= std::numeric_limits<std::int16_t>::max() / 2) {
    return expand_in_turn(problem, max_sweeps, moves.small, labels, allowed);
  }
  return expand_in_turn(problem, max_sweeps, moves.narrow, labels, allowed);
}

}  // namespace emseg
