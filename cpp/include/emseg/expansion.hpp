// Labelling by alpha-expansion: data costs, Potts costs and label costs, minimised by minimum cuts.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

// E(L) = sum_k unary[k, L_k] + sum_e weight_e [L_i(e) != L_j(e)] + sum_l label_cost_l [l is used]
// in 64-bit integers.  Each stored entry of the compressed rows is one edge.
struct LabelingProblem {
  std::int32_t label_count = 0;
  std::span<const std::int32_t> unary;        // sites * labels, row by row; may be negative
  std::span<const std::int64_t> indptr;       // sites + 1
  std::span<const std::int32_t> indices;      // edges
  std::span<const std::int32_t> weight;       // edges, or one for all; >= 0
  std::span<const std::int64_t> label_cost;   // labels; >= 0

  std::size_t site_count() const { return indptr.empty() ? 0 : indptr.size() - 1; }
};

struct ExpansionOptions {
  int max_sweeps = 2;  // sweeps over all labels (NUM_ITER_LABELING of the published code); stops early when one changes nothing
};

struct ExpansionResult {
  std::vector<std::int32_t> labels;          // sites
  std::int64_t energy = 0;
  std::vector<std::int64_t> energy_trace;    // before the first sweep, then after each
};

// The one evaluator of the discrete energy: logs, tests and acceptance use it.
std::int64_t labeling_energy(const LabelingProblem& problem, std::span<const std::int32_t> labels);

// Expansion moves over all labels in turn (Boykov, Veksler, Zabih 2001) with label costs (Delong et al. 2012).
// The energy never rises.  An empty `initial` starts from each site's cheapest label.
// Throws std::invalid_argument where shapes, labels or costs do not fit, or where the energy could overflow.
ExpansionResult expansion(const LabelingProblem& problem, std::span<const std::int32_t> initial = {},
                          const ExpansionOptions& options = {});

}  // namespace emseg
