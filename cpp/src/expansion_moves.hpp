// The loop over expansion moves, and the memory that it keeps.
#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "emseg/expansion.hpp"
#include "expansion_move.hpp"

namespace emseg {

struct ExpansionWorkspace::Moves {
  ExpansionMove<std::int32_t> narrow;
  ExpansionMove<std::int64_t> wide;

  template <typename Capacity>
  ExpansionMove<Capacity>& of();
};

template <>
inline ExpansionMove<std::int32_t>& ExpansionWorkspace::Moves::of() {
  return narrow;
}
template <>
inline ExpansionMove<std::int64_t>& ExpansionWorkspace::Moves::of() {
  return wide;
}

// Expands every label in turn until none has anything to gain, in at most `max_sweeps` sweeps.  Returns the
// gain of every sweep.
template <typename Cost, typename Capacity>
std::vector<std::int64_t> expand_in_turn(const BasicLabelingProblem<Cost>& problem, int max_sweeps,
                                         ExpansionMove<Capacity>& move, std::vector<std::int32_t>& labels) {
  move.begin(problem);
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

}  // namespace emseg
