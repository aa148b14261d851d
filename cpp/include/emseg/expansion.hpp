// Labelling by alpha-expansion: data costs, Potts costs and label costs, minimised by minimum cuts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace emseg {

// E(L) = sum_k unary[k, L_k] + sum_e weight_e [L_i(e) != L_j(e)] + sum_l label_cost_l [l is used]
// in 64-bit integers.  Each stored entry of the compressed rows is one edge, in either direction; an edge
// from a site to itself costs nothing.
template <typename Cost>
struct BasicLabelingProblem {
  std::int32_t label_count = 0;
  std::span<const Cost> unary;               // sites * labels, row by row; may be negative
  std::span<const std::int64_t> indptr;      // sites + 1
  std::span<const std::int32_t> indices;     // edges
  std::span<const Cost> weight;              // edges, or one for all; >= 0
  std::span<const std::int64_t> label_cost;  // labels, or one for all; >= 0

  std::size_t site_count() const { return indptr.empty() ? 0 : indptr.size() - 1; }
  std::int64_t cost_of_label(std::int32_t l) const {
    return label_cost.size() == 1 ? label_cost[0] : label_cost[static_cast<std::size_t>(l)];
  }
};

using LabelingProblem = BasicLabelingProblem<std::int32_t>;      // the hot path
using WideLabelingProblem = BasicLabelingProblem<std::int64_t>;  // costs that need 64 bits: half the speed

struct ExpansionOptions {
  int max_sweeps = 2;  // sweeps over all labels (NUM_ITER_LABELING of the published code); ends early once
                       // every label in turn has brought nothing
};

struct ExpansionResult {
  std::vector<std::int32_t> labels;  // sites
  std::int64_t energy = 0;
  std::vector<std::int64_t>
      energy_trace;  // at the beginning; after the start on groups, if any; after each sweep
};

// Memory of the cuts, kept from one call to the next.  Not for two calls at a time.
class ExpansionWorkspace {
 public:
  ExpansionWorkspace();
  ~ExpansionWorkspace();
  ExpansionWorkspace(ExpansionWorkspace&&) noexcept;
  ExpansionWorkspace& operator=(ExpansionWorkspace&&) noexcept;

  struct Moves;
  Moves& moves() { return *moves_; }

 private:
  std::unique_ptr<Moves> moves_;
};

// The one evaluator of the discrete energy: logs, tests and acceptance use it.
// Throws std::invalid_argument as expansion does.
std::int64_t labeling_energy(const LabelingProblem& problem, std::span<const std::int32_t> labels);
std::int64_t labeling_energy(const WideLabelingProblem& problem, std::span<const std::int32_t> labels);

// Expansion moves over all labels in turn (Boykov, Veksler, Zabih 2001) with label costs (Delong et al.
// 2012). Every move is the best of its kind, and the energy never rises.  An empty `initial` starts from each
// site's cheapest label.  Problems of 1000 sites and more are first expanded with neighbouring sites merged
// into groups; what that finds, if it is better than `initial`, is where the sites start, the labels in use
// first. Throws std::invalid_argument where shapes, labels or costs do not fit, or where the energy could
// overflow.
ExpansionResult expansion(const LabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options, ExpansionWorkspace& workspace);
ExpansionResult expansion(const WideLabelingProblem& problem, std::span<const std::int32_t> initial,
                          const ExpansionOptions& options, ExpansionWorkspace& workspace);
ExpansionResult expansion(const LabelingProblem& problem, std::span<const std::int32_t> initial = {},
                          const ExpansionOptions& options = {});
ExpansionResult expansion(const WideLabelingProblem& problem, std::span<const std::int32_t> initial = {},
                          const ExpansionOptions& options = {});

}  // namespace emseg
