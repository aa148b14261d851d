// One expansion move: which sites should take the label alpha, given all other sites' choice to keep theirs?
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "emseg/expansion.hpp"
#include "flow_solver.hpp"
#include "label_hubs.hpp"

namespace emseg {

// The cut: the source's side keeps its label, the sink's side switches to alpha.  Sites that have alpha already are
// not in it.  Potts terms need no auxiliary nodes (Kolmogorov, Zabih, PAMI 2004): with x = 1 for "switches",
//   one end has alpha:     w [x_u = 0]                     a cost of keeping u
//   equal labels:          w [x_u != x_v]                  an edge of capacity w both ways
//   different labels:      w (1 - x_u x_v)                 a cost of keeping u and an arc v -> u of capacity w
// A node's excess is its cost of switching minus its cost of keeping.
//
// alpha's own label cost needs no hub: the best move of all is also the best of those that use alpha, unless it is to
// keep everything; it is taken if it gains more than that cost.  The other labels' costs are in LabelHubs.
//
// Capacity must hold the range of the data costs plus twice the weights at any one site (see FlowSolver).
template <typename Capacity>
class ExpansionMove {
 public:
  // By how much the best move to alpha lowers the energy; 0 if none does.  `used` counts the sites of every label.
  template <typename Cost>
  std::int64_t find(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                    std::span<const std::int32_t> used, std::int32_t alpha);

  // The sites that the move found last switches.
  std::span<const std::int32_t> switched() const { return switched_; }

 private:
  template <typename Cost>
  void gather_sites(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                    std::int32_t alpha);
  template <typename Cost>
  void add_terminals(const BasicLabelingProblem<Cost>& problem);
  template <typename Cost>
  void add_edges(const BasicLabelingProblem<Cost>& problem);
  std::int64_t gain_bound() const;

  static constexpr std::int32_t kHasAlpha = -1;

  FlowSolver<Capacity> solver_;
  LabelHubs<Capacity> hubs_;
  std::vector<std::int32_t> node_of_site_;  // or kHasAlpha
  std::vector<std::int32_t> site_of_node_;
  std::vector<std::int32_t> label_of_node_;
  std::vector<std::int64_t> hub_cost_;  // per label: its cost if it is in use and not alpha
  std::vector<std::int32_t> switched_;
};

template <typename Capacity>
template <typename Cost>
std::int64_t ExpansionMove<Capacity>::find(const BasicLabelingProblem<Cost>& problem,
                                           std::span<const std::int32_t> labels,
                                           std::span<const std::int32_t> used, std::int32_t alpha) {
  switched_.clear();
  hub_cost_.resize(used.size());
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    const auto k = static_cast<std::size_t>(l);
    hub_cost_[k] = used[k] > 0 && l != alpha ? problem.cost_of_label(l) : 0;
  }
  const std::int64_t price = used[static_cast<std::size_t>(alpha)] > 0 ? 0 : problem.cost_of_label(alpha);

  gather_sites(problem, labels, alpha);
  add_terminals(problem);
  if (gain_bound() <= price) return 0;
  add_edges(problem);

  // Keeping everything cuts every deficit; the minimum cut is as large as the flow.
  std::int64_t gain = -price;
  for (std::size_t v = 0; v < solver_.node_count(); ++v) gain -= std::min<std::int64_t>(0, solver_.excess(v));
  gain -= solver_.maximise();
  hubs_.survey(solver_, label_of_node_, hub_cost_);
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    if (hubs_.is_wiped_by_cut(l)) gain += hub_cost_[static_cast<std::size_t>(l)];
  }
  if (gain + hubs_.gain_bound() <= 0) return 0;
  gain += hubs_.fill(solver_);
  if (gain <= 0) return 0;

  for (std::size_t v = 0; v < solver_.node_count(); ++v) {
    if (solver_.on_sink_side(v) || hubs_.switches(v)) switched_.push_back(site_of_node_[v]);
  }
  return gain;
}

template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::gather_sites(const BasicLabelingProblem<Cost>& problem,
                                           std::span<const std::int32_t> labels, std::int32_t alpha) {
  node_of_site_.resize(labels.size());
  site_of_node_.clear();
  label_of_node_.clear();
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] == alpha) {
      node_of_site_[i] = kHasAlpha;
      continue;
    }
    node_of_site_[i] = static_cast<std::int32_t>(site_of_node_.size());
    site_of_node_.push_back(static_cast<std::int32_t>(i));
    label_of_node_.push_back(labels[i]);
  }

  solver_.begin(site_of_node_.size());
  const auto label_count = static_cast<std::size_t>(problem.label_count);
  for (std::size_t v = 0; v < site_of_node_.size(); ++v) {
    const Cost* row = problem.unary.data() + static_cast<std::size_t>(site_of_node_[v]) * label_count;
    solver_.excess(v) = static_cast<Capacity>(static_cast<Capacity>(row[alpha]) -
                                              static_cast<Capacity>(row[label_of_node_[v]]));
  }
}

template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::add_terminals(const BasicLabelingProblem<Cost>& problem) {
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  for (std::size_t i = 0; i < problem.site_count(); ++i) {
    const std::int32_t u = node_of_site_[i];
    for (auto e = static_cast<std::size_t>(problem.indptr[i]); e < static_cast<std::size_t>(problem.indptr[i + 1]);
         ++e) {
      const std::int32_t v = node_of_site_[static_cast<std::size_t>(problem.indices[e])];
      if (u == v) continue;
      const auto weight = static_cast<Capacity>(problem.weight[e * stride]);
      if (u == kHasAlpha) {
        solver_.excess(static_cast<std::size_t>(v)) -= weight;
      } else if (v == kHasAlpha) {
        solver_.excess(static_cast<std::size_t>(u)) -= weight;
      } else {
        solver_.count_edge(u, v);
        if (label_of_node_[static_cast<std::size_t>(u)] != label_of_node_[static_cast<std::size_t>(v)]) {
          solver_.excess(static_cast<std::size_t>(u)) -= weight;
        }
      }
    }
  }
}

template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::add_edges(const BasicLabelingProblem<Cost>& problem) {
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  solver_.allocate();
  for (std::size_t u = 0; u < site_of_node_.size(); ++u) {
    const auto i = static_cast<std::size_t>(site_of_node_[u]);
    for (auto e = static_cast<std::size_t>(problem.indptr[i]); e < static_cast<std::size_t>(problem.indptr[i + 1]);
         ++e) {
      const std::int32_t v = node_of_site_[static_cast<std::size_t>(problem.indices[e])];
      if (v == kHasAlpha || v == static_cast<std::int32_t>(u)) continue;
      const auto weight = static_cast<Capacity>(problem.weight[e * stride]);
      const bool equal = label_of_node_[u] == label_of_node_[static_cast<std::size_t>(v)];
      solver_.add_edge(static_cast<std::int32_t>(u), v, equal ? weight : 0, weight);
    }
  }
}

// No move gains more than this: edges between sites count nothing, and a label is either switched where that pays, or
// wiped out at the price of all its sites.
template <typename Capacity>
std::int64_t ExpansionMove<Capacity>::gain_bound() const {
  std::vector<std::int64_t> excess(hub_cost_.size(), 0);
  std::int64_t bound = 0;
  for (std::size_t v = 0; v < solver_.node_count(); ++v) {
    const std::int64_t value = solver_.excess(v);
    if (value < 0) {
      bound -= value;
    } else {
      excess[static_cast<std::size_t>(label_of_node_[v])] += value;
    }
  }
  for (std::size_t l = 0; l < hub_cost_.size(); ++l) bound += std::max<std::int64_t>(0, hub_cost_[l] - excess[l]);
  return bound;
}

}  // namespace emseg
