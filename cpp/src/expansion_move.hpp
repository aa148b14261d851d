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

// The cut: the source's side keeps its label, the sink's side switches to alpha.  Sites that have alpha
// already are not in it.  Potts terms need no auxiliary nodes (Kolmogorov, Zabih, PAMI 2004): with x = 1 for
// "switches",
//   one end has alpha:     w [x_u = 0]                     a cost of keeping u
//   equal labels:          w [x_u != x_v]                  an edge of capacity w both ways
//   different labels:      w (1 - x_u x_v)                 a cost of keeping u and an arc v -> u of capacity
//   w
// A node's excess is its cost of switching minus its cost of keeping.
//
// alpha's own label cost needs no hub: the best move of all is also the best of those that use alpha, unless
// it is to keep everything; it is taken if it gains more than that cost.  The other labels' costs are in
// LabelHubs.
//
// The flow of the last move to the same label is where the next one starts: clamped to the new capacities it
// is as good a beginning as none, and where little has changed it leaves little to do, often not even a graph
// to build.
//
// Capacity must hold the range of the data costs plus twice the weights at any one site (see FlowSolver).
template <typename Capacity>
class ExpansionMove {
 public:
  // Forgets what earlier moves left for this problem or another.
  template <typename Cost>
  void begin(const BasicLabelingProblem<Cost>& problem);

  // By how much the best move to alpha lowers the energy; 0 if none does.  `used` counts the sites of every
  // label.
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
  void gather_edges(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                    std::int32_t alpha, std::span<const Capacity> flow);
  void build();
  template <typename Cost>
  void keep_flow(const BasicLabelingProblem<Cost>& problem, std::span<Capacity> flow) const;
  std::int64_t deficits() const;
  std::int64_t gain_bound() const;

  static constexpr std::int32_t kHasAlpha = -1;
  static constexpr std::size_t kFlowMemory = std::size_t{32}
                                             << 20;  // bytes; labels beyond start from no flow

  // An edge between two nodes of the cut, with what the flow so far leaves of its capacities.
  struct Edge {
    std::int32_t index;  // in the problem
    std::int32_t u;
    std::int32_t v;
    Capacity forward;
    Capacity backward;
  };

  FlowSolver<Capacity> solver_;
  LabelHubs<Capacity> hubs_;
  std::vector<std::int32_t> node_of_site_;  // or kHasAlpha
  std::vector<std::int32_t> site_of_node_;
  std::vector<std::int32_t> label_of_node_;
  std::vector<std::int64_t> hub_cost_;        // per label: its cost if it is in use and not alpha
  std::vector<std::vector<Capacity>> flows_;  // per label: the last move's flow along every edge
  std::vector<Edge> edges_;
  std::vector<std::int32_t> arc_of_edge_;  // as edges_
  std::vector<std::int32_t> switched_;
};

template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::begin(const BasicLabelingProblem<Cost>& problem) {
  const std::size_t edge_count = std::max<std::size_t>(1, problem.indices.size());
  const auto label_count = static_cast<std::size_t>(problem.label_count);
  flows_.resize(std::min(label_count, kFlowMemory / (edge_count * sizeof(Capacity)) + 1));
  for (auto& flow : flows_) flow.clear();
}

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

  // Labels beyond the memory share the last flow: it begins less well, and is as valid.
  std::vector<Capacity>& flow = flows_[std::min(static_cast<std::size_t>(alpha), flows_.size() - 1)];
  if (flow.empty()) flow.assign(problem.indices.size(), 0);
  gather_sites(problem, labels, alpha);
  gather_edges(problem, labels, alpha, flow);
  if (gain_bound() <= price) return 0;
  build();

  // Keeping everything cuts every deficit; the minimum cut is as large as the flow.
  const std::int64_t keep_all = deficits();
  solver_.start();
  solver_.maximise(keep_all - price);
  if (!solver_.is_maximum()) {
    if (gain_bound() <= price) {
      keep_flow(problem, flow);
      return 0;
    }
    solver_.maximise();
  }
  std::int64_t gain = deficits() - price;
  hubs_.survey(solver_, label_of_node_, hub_cost_);
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    if (hubs_.is_wiped_by_cut(l)) gain += hub_cost_[static_cast<std::size_t>(l)];
  }
  if (gain + hubs_.gain_bound() > 0) gain += hubs_.fill(solver_);
  keep_flow(problem, flow);
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

// Costs at single sites go to their excess; edges between sites are listed, for there may be no need to build
// them.
template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::gather_edges(const BasicLabelingProblem<Cost>& problem,
                                           std::span<const std::int32_t> labels, std::int32_t alpha,
                                           std::span<const Capacity> flow) {
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  edges_.resize(problem.indices.size());
  std::size_t count = 0;
  for (std::size_t i = 0; i < problem.site_count(); ++i) {
    const std::int32_t label = labels[i];
    const std::int32_t u = node_of_site_[i];
    Capacity from_u = 0;
    for (auto e = static_cast<std::size_t>(problem.indptr[i]);
         e < static_cast<std::size_t>(problem.indptr[i + 1]); ++e) {
      const auto j = static_cast<std::size_t>(problem.indices[e]);
      const std::int32_t v = node_of_site_[j];
      const auto weight = static_cast<Capacity>(problem.weight[e * stride]);
      if (labels[j] == alpha) {
        from_u += weight;
      } else if (label == alpha) {
        solver_.excess(static_cast<std::size_t>(v)) -= weight;
      } else if (u != v) {
        const bool equal = label == labels[j];
        const Capacity most = equal ? weight : 0;
        const Capacity along = std::clamp<Capacity>(flow[e], -weight, most);
        from_u += weight - most + along;
        solver_.excess(static_cast<std::size_t>(v)) += along;
        edges_[count++] = {static_cast<std::int32_t>(e), u, v, static_cast<Capacity>(most - along),
                           static_cast<Capacity>(weight + along)};
      }
    }
    if (u != kHasAlpha) solver_.excess(static_cast<std::size_t>(u)) -= from_u;
  }
  edges_.resize(count);
}

template <typename Capacity>
void ExpansionMove<Capacity>::build() {
  for (const Edge& edge : edges_) solver_.count_edge(edge.u, edge.v);
  solver_.allocate();
  arc_of_edge_.resize(edges_.size());
  for (std::size_t k = 0; k < edges_.size(); ++k) {
    const Edge& edge = edges_[k];
    arc_of_edge_[k] = solver_.add_edge(edge.u, edge.v, edge.forward, edge.backward);
  }
}

// The capacity backward is the weight, whatever the labels; flow along the edge adds to what is left of it.
template <typename Capacity>
template <typename Cost>
void ExpansionMove<Capacity>::keep_flow(const BasicLabelingProblem<Cost>& problem,
                                        std::span<Capacity> flow) const {
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  for (std::size_t k = 0; k < edges_.size(); ++k) {
    const auto e = static_cast<std::size_t>(edges_[k].index);
    flow[e] = solver_.arc(arc_of_edge_[k]).backward - static_cast<Capacity>(problem.weight[e * stride]);
  }
}

// What the cut that keeps every label pays.
template <typename Capacity>
std::int64_t ExpansionMove<Capacity>::deficits() const {
  std::int64_t sum = 0;
  for (std::size_t v = 0; v < solver_.node_count(); ++v) sum -= std::min<std::int64_t>(0, solver_.excess(v));
  return sum;
}

// No move gains more than this: edges between sites count nothing, and a label is either switched where that
// pays, or wiped out at the price of all its sites.
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
  for (std::size_t l = 0; l < hub_cost_.size(); ++l)
    bound += std::max<std::int64_t>(0, hub_cost_[l] - excess[l]);
  return bound;
}

}  // namespace emseg
