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

// Expansion moves on one problem, one after the other.
template <typename Cost, typename Capacity, typename Residual>
class MovesInTurn {
 public:
  // Borrows all of them; `labels` are changed by the moves.
  MovesInTurn(const BasicLabelingProblem<Cost>& problem, ExpansionMove<Capacity, Residual>& move,
              std::vector<std::int32_t>& labels, std::span<const std::uint64_t> allowed)
      : problem_(problem),
        move_(move),
        labels_(labels),
        used_(static_cast<std::size_t>(problem.label_count), 0),
        settled_at_(used_.size(), -1) {
    move_.begin(problem, allowed);
    for (const std::int32_t label : labels) ++used_[static_cast<std::size_t>(label)];
  }

  // Expands every label in turn.  Returns what that gains.
  std::int64_t sweep() {
    std::int64_t gain = 0;
    for (std::int32_t alpha = 0; alpha < problem_.label_count; ++alpha) gain += expand(alpha);
    return gain;
  }

  // Those only that some site has.
  std::int64_t sweep_used() {
    std::int64_t gain = 0;
    for (std::int32_t alpha = 0; alpha < problem_.label_count; ++alpha) {
      if (used_[static_cast<std::size_t>(alpha)] > 0) gain += expand(alpha);
    }
    return gain;
  }

  // Whether no label has anything to gain any more.
  bool is_settled() const {
    return std::all_of(settled_at_.begin(), settled_at_.end(), [this](auto at) { return at == changes_; });
  }

 private:
  std::int64_t expand(std::int32_t alpha) {
    std::int64_t& settled_at = settled_at_[static_cast<std::size_t>(alpha)];
    if (settled_at == changes_) return 0;
    const std::int64_t gain = move_.find(problem_, labels_, used_, alpha);
    for (const std::int32_t site : move_.switched()) {
      std::int32_t& label = labels_[static_cast<std::size_t>(site)];
      --used_[static_cast<std::size_t>(label)];
      ++used_[static_cast<std::size_t>(alpha)];
      label = alpha;
    }
    changes_ += gain > 0 ? 1 : 0;
    settled_at = changes_;  // also after a gain: the move was the best one
    return gain;
  }

  const BasicLabelingProblem<Cost>& problem_;
  ExpansionMove<Capacity, Residual>& move_;
  std::vector<std::int32_t>& labels_;
  std::vector<std::int32_t> used_;  // per label: its sites
  std::vector<std::int64_t>
      settled_at_;  // per label: how many moves had changed labels when it was tried last
  std::int64_t changes_ = 0;
};

// The cheapest label of every site by itself.
template <typename Cost>
std::vector<std::int32_t> cheapest_labels(const BasicLabelingProblem<Cost>& problem) {
  const auto label_count = static_cast<std::ptrdiff_t>(problem.label_count);
  std::vector<std::int32_t> labels(problem.site_count());
  auto row = problem.unary.begin();
  for (std::int32_t& label : labels) {
    label = static_cast<std::int32_t>(std::min_element(row, row + label_count) - row);
    row += label_count;
  }
  return labels;
}

// Which labels are expanded.
enum class Expanded {
  all,
  used_first,  // all, once those in use are settled among themselves
  used,        // those in use alone
};

// Expands labels in turn until none has anything to gain, in at most `max_sweeps` sweeps, of which one that
// gains no more than `least_gain` is the last.  Returns the gain of every sweep; with Expanded::used_first,
// what settles the labels in use comes first.
template <typename Cost, typename Capacity, typename Residual>
std::vector<std::int64_t> expand_in_turn(const BasicLabelingProblem<Cost>& problem, int max_sweeps,
                                         ExpansionMove<Capacity, Residual>& move,
                                         std::vector<std::int32_t>& labels,
                                         std::span<const std::uint64_t> allowed, Expanded expanded,
                                         std::int64_t least_gain) {
  MovesInTurn<Cost, Capacity, Residual> moves(problem, move, labels, allowed);
  std::vector<std::int64_t> gains;
  if (expanded != Expanded::all) {
    gains.push_back(0);
    for (int sweep = 0; sweep < max_sweeps; ++sweep) {
      const std::int64_t gain = moves.sweep_used();
      gains.back() += gain;
      if (gain == 0) break;
    }
  }
  if (expanded == Expanded::used) return gains;
  for (int sweep = 0; sweep < max_sweeps && !moves.is_settled(); ++sweep) {
    gains.push_back(moves.sweep());
    if (gains.back() <= least_gain) break;
  }
  return gains;
}

// The same with the smallest integers that hold what the moves meet: `widest` bounds the range of the data
// costs plus twice the weights at any one site.
template <typename Cost>
std::vector<std::int64_t> expand_in_turn(const BasicLabelingProblem<Cost>& problem, int max_sweeps,
                                         std::int64_t widest, ExpansionWorkspace& workspace,
                                         std::vector<std::int32_t>& labels,
                                         std::span<const std::uint64_t> allowed = {},
                                         Expanded expanded = Expanded::all, std::int64_t least_gain = 0) {
  ExpansionWorkspace::Moves& moves = workspace.moves();
  if (widest > std::numeric_limits<std::int32_t>::max()) {
    return expand_in_turn(problem, max_sweeps, moves.wide, labels, allowed, expanded, least_gain);
  }
  Cost heaviest = 0;
  for (const Cost weight : problem.weight) heaviest = std::max(heaviest, weight);
  if (heaviest <= std::numeric_limits<std::int16_t>::max() / 2) {
    return expand_in_turn(problem, max_sweeps, moves.small, labels, allowed, expanded, least_gain);
  }
  return expand_in_turn(problem, max_sweeps, moves.narrow, labels, allowed, expanded, least_gain);
}

}  // namespace emseg
