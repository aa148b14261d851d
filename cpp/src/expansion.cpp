#include "emseg/expansion.hpp"

#include <algorithm>
#include <cassert>
#include <limits>
#include <stdexcept>
#include <string>

#include "expansion_moves.hpp"
#include "grouped_problem.hpp"
#include "labeling_problem.hpp"
#include "ordered_problem.hpp"

namespace emseg {

ExpansionWorkspace::ExpansionWorkspace() : moves_(std::make_unique<Moves>()) {}
ExpansionWorkspace::~ExpansionWorkspace() = default;
ExpansionWorkspace::ExpansionWorkspace(ExpansionWorkspace&&) noexcept = default;
ExpansionWorkspace& ExpansionWorkspace::operator=(ExpansionWorkspace&&) noexcept = default;

namespace {

// Groups pay where moves are dear: below, a whole expansion is a matter of a millisecond.
constexpr std::size_t kLeastSites = 1000;

// The labelling that expansion of groups finds, if it is better than `labels`: what it gains.
template <typename Cost>
std::int64_t expand_groups(const BasicLabelingProblem<Cost>& problem, std::int64_t energy, int max_sweeps,
                           std::int64_t widest, ExpansionWorkspace& workspace,
                           std::vector<std::int32_t>& labels) {
  const GroupedProblem groups(problem);
  const WideLabelingProblem coarse = groups.view();
  std::vector<std::int32_t> group_labels = cheapest_labels(coarse);
  expand_in_turn(coarse, max_sweeps, widest * static_cast<std::int64_t>(GroupedProblem::kMostSites),
                 workspace, group_labels);
  const std::int64_t gain = energy - evaluate(coarse, group_labels);
  if (gain <= 0) return 0;
  labels = groups.spread(group_labels);
  return gain;
}

template <typename Cost>
ExpansionResult checked_expansion(const BasicLabelingProblem<Cost>& problem,
                                  std::span<const std::int32_t> initial, const ExpansionOptions& options,
                                  ExpansionWorkspace& workspace) {
  if (options.max_sweeps < 0) {
    throw std::invalid_argument("max_sweeps is " + std::to_string(options.max_sweeps) +
                                ", expected at least 0");
  }
  const std::int64_t widest = check_problem(problem);
  ExpansionResult result;
  if (initial.empty()) {
    result.labels = cheapest_labels(problem);
  } else {
    check_labels(problem, initial);
    result.labels.assign(initial.begin(), initial.end());
  }
  result.energy = evaluate(problem, result.labels);
  result.energy_trace.push_back(result.energy);

  const OrderedProblem<Cost> ordered(problem);
  result.labels = ordered.ordered(result.labels);
  Expanded expanded = Expanded::all;
  constexpr auto kLargest = std::numeric_limits<std::int64_t>::max();
  if (options.max_sweeps > 0 && problem.site_count() >= kLeastSites &&
      widest <= kLargest / static_cast<std::int64_t>(GroupedProblem::kMostSites)) {
    result.energy -=
        expand_groups(ordered.view(), result.energy, options.max_sweeps, widest, workspace, result.labels);
    expanded = Expanded::used_first;
  }
  for (const std::int64_t gain :
       expand_in_turn(ordered.view(), options.max_sweeps, widest, workspace, result.labels, {}, expanded)) {
    result.energy -= gain;
    result.energy_trace.push_back(result.energy);
  }
  result.labels = ordered.original(result.labels);
  assert(result.energy == evaluate(problem, result.labels));
  return result;
}

template <typename Cost>
std::int64_t checked_energy(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels) {
  check_problem(problem);
  check_labels(problem, labels);
  return evaluate(problem, labels);
}

}  // namespace

std::int64_t labeling_energy(const LabelingProblem& problem, std::span<const std::int32_t> labels) {
  return checked_energy(problem, labels);
}

std::int64_t labeling_energy(const WideLabelingProblem& problem, std::span<const std::int32_t> labels) {
  return checked_energy(problem, labels);
}

ExpansionResult expansion(const LabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options, ExpansionWorkspace& workspace) {
  return checked_expansion(problem, initial, options, workspace);
}

ExpansionResult expansion(const WideLabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options, ExpansionWorkspace& workspace) {
  return checked_expansion(problem, initial, options, workspace);
}

ExpansionResult expansion(const LabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options) {
  ExpansionWorkspace workspace;
  return checked_expansion(problem, initial, options, workspace);
}

ExpansionResult expansion(const WideLabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options) {
  ExpansionWorkspace workspace;
  return checked_expansion(problem, initial, options, workspace);
}

}  // namespace emseg
