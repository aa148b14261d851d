// Label costs in an expansion move: which labels does it pay to wipe out?
//
// A label l of cost h_l > 0 stops costing only when all its sites switch.  In the cut of Delong et al. (IJCV
// 2012) that is a hub node with an arc of capacity h_l to the sink and infinite arcs from every site of l. In
// one cut with everything else, such hubs make augmenting-path search crawl.  Here they come second:
//
// - The cut without hubs is solved first.  Label costs only favour switching, so whatever it switches stays
//   switched in some optimum with hubs.  What remains has supplies (excess that wants its site kept) and no
//   demand.
// - Each hub is then a demand of h_l that any site of l can serve.  Where the sites' own excess serves all of
// them,
//   which large labels do, nothing more can be gained and no path is searched.
// - Else the hubs are filled by blocking flows over shortest paths (Dinic 1970), searched from the unserved
// hubs; a
//   hub is scanned once per phase.  Flow may also go through a hub: from a site of l into it, and back out to
//   a site that had served it.  Whatever can still reach an unserved hub in the end switches.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flow_solver.hpp"

namespace emseg {

template <typename Capacity, typename Residual>
class LabelHubs {
 public:
  // After solver.maximise(): takes in how much excess the kept sites of every label have.  node_label has one
  // entry per node; cost one per label, 0 where no hub is wanted.
  void survey(const FlowSolver<Capacity, Residual>& solver, std::span<const std::int32_t> node_label,
              std::span<const std::int64_t> cost);

  // No wipe-out that the cut without hubs leaves open can gain more than this.
  std::int64_t gain_bound() const;

  // The exact gain of the best wipe-outs.  switches(v) then tells the sites that they switch on top of the
  // cut's.  What sites served is given back in the end, so that their excess is again what the flow between
  // sites leaves.
  std::int64_t fill(FlowSolver<Capacity, Residual>& solver);
  bool switches(std::size_t v) const { return level_[v] >= 0; }

  bool is_wiped_by_cut(std::int32_t label) const { return kept_[static_cast<std::size_t>(label)] == 0; }

 private:
  // Vertices: the solver's nodes, then one hub per label.
  bool is_hub(std::int32_t vertex) const { return vertex >= node_count_; }
  std::int32_t hub_of(std::int32_t v) const { return node_count_ + label_[static_cast<std::size_t>(v)]; }
  std::size_t label_of(std::int32_t hub) const { return static_cast<std::size_t>(hub - node_count_); }
  std::int32_t& level(std::int32_t vertex) { return level_[static_cast<std::size_t>(vertex)]; }
  std::int32_t& cursor(std::int32_t vertex) { return cursor_[static_cast<std::size_t>(vertex)]; }

  void list_sites(const FlowSolver<Capacity, Residual>& solver);
  void serve_from_own_sites(FlowSolver<Capacity, Residual>& solver);
  bool search(const FlowSolver<Capacity, Residual>& solver);
  void visit(const FlowSolver<Capacity, Residual>& solver, std::int32_t vertex, std::int32_t at);
  void push_blocking_flow(FlowSolver<Capacity, Residual>& solver);
  std::int32_t step(const FlowSolver<Capacity, Residual>& solver, std::int32_t vertex);
  void push_along(FlowSolver<Capacity, Residual>& solver);

  static constexpr std::int32_t kUnseen = -1;
  static constexpr std::int32_t kDead = -2;  // no way to an unserved hub is left in this phase

  std::int32_t node_count_ = 0;
  std::span<const std::int32_t> label_;
  std::vector<std::int64_t> demand_;       // per label: what its hub still takes
  std::vector<std::int64_t> supply_;       // per label: excess at its kept sites
  std::vector<std::int32_t> kept_;         // per label: kept sites
  std::vector<std::int32_t> sites_begin_;  // per label, + 1: rows of sites_
  std::vector<std::int32_t> sites_;        // kept sites, label by label
  std::vector<std::int64_t> served_;       // per node: flow into its label's hub
  std::vector<std::int32_t> level_;        // per vertex: arcs to the nearest unserved hub, or kUnseen, kDead
  std::vector<std::int32_t> cursor_;       // per vertex: the arc being tried
  std::vector<std::int32_t> seen_;         // vertices in the order of the search
  std::vector<std::int32_t> path_;
};

template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::survey(const FlowSolver<Capacity, Residual>& solver,
                                           std::span<const std::int32_t> node_label,
                                           std::span<const std::int64_t> cost) {
  node_count_ = static_cast<std::int32_t>(solver.node_count());
  label_ = node_label;
  demand_.assign(cost.begin(), cost.end());
  supply_.assign(cost.size(), 0);
  kept_.assign(cost.size(), 0);
  for (std::size_t v = 0; v < solver.node_count(); ++v) {
    if (solver.on_sink_side(v)) continue;
    const auto l = static_cast<std::size_t>(label_[v]);
    supply_[l] += solver.excess(v);
    ++kept_[l];
  }
  for (std::size_t l = 0; l < demand_.size(); ++l) {
    if (kept_[l] == 0) demand_[l] = 0;
  }
}

template <typename Capacity, typename Residual>
std::int64_t LabelHubs<Capacity, Residual>::gain_bound() const {
  std::int64_t bound = 0;
  for (std::size_t l = 0; l < demand_.size(); ++l)
    bound += std::max<std::int64_t>(0, demand_[l] - supply_[l]);
  return bound;
}

template <typename Capacity, typename Residual>
std::int64_t LabelHubs<Capacity, Residual>::fill(FlowSolver<Capacity, Residual>& solver) {
  const std::size_t vertex_count = solver.node_count() + demand_.size();
  level_.assign(vertex_count, kUnseen);
  if (gain_bound() == 0) return 0;
  cursor_.resize(vertex_count);
  served_.assign(solver.node_count(), 0);
  seen_.clear();
  list_sites(solver);
  serve_from_own_sites(solver);
  while (search(solver)) push_blocking_flow(solver);
  for (const std::int32_t v : sites_) {
    solver.excess(static_cast<std::size_t>(v)) += static_cast<Capacity>(served_[static_cast<std::size_t>(v)]);
  }
  std::int64_t gain = 0;
  for (const std::int64_t left : demand_) gain += left;
  return gain;
}

template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::list_sites(const FlowSolver<Capacity, Residual>& solver) {
  sites_begin_.assign(kept_.size() + 1, 0);
  for (std::size_t l = 0; l < kept_.size(); ++l) sites_begin_[l + 1] = sites_begin_[l] + kept_[l];
  sites_.resize(static_cast<std::size_t>(sites_begin_.back()));
  for (std::size_t l = 0; l < kept_.size(); ++l)
    cursor(node_count_ + static_cast<std::int32_t>(l)) = sites_begin_[l];
  for (std::int32_t v = 0; v < node_count_; ++v) {
    if (!solver.on_sink_side(static_cast<std::size_t>(v)))
      sites_[static_cast<std::size_t>(cursor(hub_of(v))++)] = v;
  }
}

// Where a label has more than its hub takes, every site gives its share, so that none runs dry and no later
// path need go through the hub.
template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::serve_from_own_sites(FlowSolver<Capacity, Residual>& solver) {
  for (std::size_t l = 0; l < demand_.size(); ++l) {
    if (demand_[l] == 0) continue;
    const std::int64_t share = std::max<std::int64_t>(1, supply_[l] / demand_[l]);
    for (const std::int64_t divisor : {share, std::int64_t{1}}) {
      for (std::int32_t k = sites_begin_[l]; k < sites_begin_[l + 1] && demand_[l] > 0; ++k) {
        const auto v = static_cast<std::size_t>(sites_[static_cast<std::size_t>(k)]);
        const std::int64_t amount = std::min<std::int64_t>(demand_[l], solver.excess(v) / divisor);
        solver.excess(v) -= static_cast<Capacity>(amount);
        served_[v] += amount;
        demand_[l] -= amount;
      }
    }
  }
}

// Breadth-first from the unserved hubs against the flow, up to the nearest level with excess; false if there
// is none, and then everything that can reach an unserved hub has been seen.
template <typename Capacity, typename Residual>
bool LabelHubs<Capacity, Residual>::search(const FlowSolver<Capacity, Residual>& solver) {
  for (const std::int32_t vertex : seen_) level(vertex) = kUnseen;
  seen_.clear();
  for (std::size_t l = 0; l < demand_.size(); ++l) {
    if (demand_[l] > 0) visit(solver, node_count_ + static_cast<std::int32_t>(l), 0);
  }
  std::int32_t goal = kUnseen;
  for (std::size_t k = 0; k < seen_.size(); ++k) {
    const std::int32_t vertex = seen_[k];
    const std::int32_t next = level(vertex) + 1;
    if (goal != kUnseen && next > goal) break;
    if (is_hub(vertex)) {
      const std::size_t l = label_of(vertex);
      for (std::int32_t s = sites_begin_[l]; s < sites_begin_[l + 1]; ++s)
        visit(solver, sites_[static_cast<std::size_t>(s)], next);
      continue;
    }
    const auto v = static_cast<std::size_t>(vertex);
    if (solver.excess(v) > 0) {
      goal = level(vertex);
      continue;
    }
    for (std::int32_t a = solver.arcs_begin(vertex); a < solver.arcs_end(vertex); ++a) {
      const std::int32_t head = solver.arc(a).head;
      if (solver.residuals(a).backward > 0 && !solver.on_sink_side(static_cast<std::size_t>(head)))
        visit(solver, head, next);
    }
    if (served_[v] > 0) visit(solver, hub_of(vertex), next);
  }
  return goal != kUnseen;
}

template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::visit(const FlowSolver<Capacity, Residual>& solver, std::int32_t vertex,
                                          std::int32_t at) {
  if (level(vertex) != kUnseen) return;
  level(vertex) = at;
  cursor(vertex) = is_hub(vertex) ? sites_begin_[label_of(vertex)] : solver.arcs_begin(vertex);
  seen_.push_back(vertex);
}

template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::push_blocking_flow(FlowSolver<Capacity, Residual>& solver) {
  for (const std::int32_t start : seen_) {
    if (is_hub(start) || solver.excess(static_cast<std::size_t>(start)) == 0) continue;
    path_.assign(1, start);
    while (!path_.empty()) {
      const std::int32_t vertex = path_.back();
      if (is_hub(vertex) && level(vertex) == 0 && demand_[label_of(vertex)] > 0) {
        push_along(solver);
        path_.resize(1);
        if (solver.excess(static_cast<std::size_t>(start)) == 0) break;
        continue;
      }
      const std::int32_t next = step(solver, vertex);
      if (next == kUnseen) {
        level(vertex) = kDead;
        path_.pop_back();
      } else {
        path_.push_back(next);
      }
    }
  }
}

// The vertex that the cursor of `vertex` leads to, one level nearer to an unserved hub, or kUnseen.
// A node's cursor runs over its arcs and then its hub; a hub's, over the sites that served it.
template <typename Capacity, typename Residual>
std::int32_t LabelHubs<Capacity, Residual>::step(const FlowSolver<Capacity, Residual>& solver,
                                                 std::int32_t vertex) {
  const std::int32_t wanted = level(vertex) - 1;
  if (wanted < 0) return kUnseen;
  std::int32_t& at = cursor(vertex);
  if (is_hub(vertex)) {
    for (; at < sites_begin_[label_of(vertex) + 1]; ++at) {
      const std::int32_t v = sites_[static_cast<std::size_t>(at)];
      if (level(v) == wanted && served_[static_cast<std::size_t>(v)] > 0) return v;
    }
    return kUnseen;
  }
  for (; at < solver.arcs_end(vertex); ++at) {
    const std::int32_t head = solver.arc(at).head;
    if (level(head) == wanted && solver.residuals(at).forward > 0) return head;
  }
  return level(hub_of(vertex)) == wanted ? hub_of(vertex) : kUnseen;
}

template <typename Capacity, typename Residual>
void LabelHubs<Capacity, Residual>::push_along(FlowSolver<Capacity, Residual>& solver) {
  const auto start = static_cast<std::size_t>(path_.front());
  std::int64_t& demand = demand_[label_of(path_.back())];
  std::int64_t amount = std::min<std::int64_t>(demand, solver.excess(start));
  for (std::size_t k = 0; k + 1 < path_.size(); ++k) {
    if (is_hub(path_[k])) {
      amount = std::min(amount, served_[static_cast<std::size_t>(path_[k + 1])]);
    } else if (!is_hub(path_[k + 1])) {
      amount = std::min<std::int64_t>(amount, solver.residuals(cursor(path_[k])).forward);
    }
  }
  for (std::size_t k = 0; k + 1 < path_.size(); ++k) {
    if (is_hub(path_[k])) {
      served_[static_cast<std::size_t>(path_[k + 1])] -= amount;
    } else if (is_hub(path_[k + 1])) {
      served_[static_cast<std::size_t>(path_[k])] += amount;
    } else {
      solver.push(cursor(path_[k]), static_cast<Capacity>(amount));
    }
  }
  solver.excess(start) -= static_cast<Capacity>(amount);
  demand -= amount;
}

}  // namespace emseg
