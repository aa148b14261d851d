// One expansion move: which sites should take the label alpha, given all other sites' choice to keep theirs?
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "emseg/expansion.hpp"
#include "flow_solver.hpp"
#include "label_hubs.hpp"

namespace emseg {

// The cut: the source's side keeps its label, the sink's side switches to alpha.  Sites that have alpha
// already, or must not take it, are not in it.  Potts terms need no auxiliary nodes (Kolmogorov, Zabih, PAMI
// 2004): with x = 1 for "switches", and u < v,
//   one end has alpha:     w [x_u = 0]                     a cost of keeping u
//   one end must keep:     w [x_u = 1] if labels are equal, else nothing that depends on x
//   equal labels:          w [x_u != x_v]                  an edge of capacity w both ways
//   different labels:      w (1 - x_u x_v)                 a cost of keeping u and an arc v -> u of capacity
//   w
// A node's excess is its cost of switching minus its cost of keeping, less the flow that leaves it.
//
// alpha's own label cost needs no hub: the best move of all is also the best of those that use alpha, unless
// it is to keep everything; it is taken if it gains more than that cost.  The other labels' costs are in
// LabelHubs.
//
// The graph is the same for all moves.  The flow of every label's last move is kept, and only what follows
// from labels that have changed since is changed in it: clamped to its new capacities, a flow is as good a
// beginning as none, and where little has changed it leaves little to do.
//
// Capacity must hold the range of the data costs plus twice the weights at any one site, Residual twice the
// weight of an edge.
template <typename Capacity, typename Residual = Capacity>
class ExpansionMove {
 public:
  // Forgets what earlier moves left for this problem or another.  `allowed`, if not empty, has a bit for each
  // of the first 64 labels that a site may take; what it has it may keep, and later labels are for all.
  template <typename Cost>
  void begin(const BasicLabelingProblem<Cost>& problem, std::span<const std::uint64_t> allowed = {});

  // By how much the best move to alpha lowers the energy; 0 if none does.  `used` counts the sites of every
  // label.
  template <typename Cost>
  std::int64_t find(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                    std::span<const std::int32_t> used, std::int32_t alpha);

  // The sites that the move found last switches.
  std::span<const std::int32_t> switched() const { return switched_; }

 private:
  // A site's part in a move: its label if it may switch, kHasAlpha, or, where it must keep its label,
  // kept(label).
  using Role = std::int32_t;
  static constexpr Role kHasAlpha = -1;
  static Role kept(std::int32_t label) { return -2 - label; }
  static bool takes_part(Role role) { return role >= 0; }

  // The flow of the last move to a label, in the graph of the roles that sites had in it.
  struct Flow {
    std::int32_t label = kNoLabel;
    std::vector<Role> roles;
    std::vector<Capacity> excess;
    std::vector<Residuals<Residual>> residuals;
  };

  // What an edge u - v with these roles gives to u's arc and to u's excess.
  struct Terms {
    Residual forward;
    Residual backward;
    Capacity excess;
  };
  static Terms terms_of(Role u, Role v, Residual weight, bool u_is_first);

  template <typename Cost>
  void set_roles(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                 std::span<const std::int32_t> used, std::int32_t alpha);
  template <typename Cost>
  Capacity data_excess(const BasicLabelingProblem<Cost>& problem, std::size_t v, Role role,
                       std::int32_t alpha) const;
  template <typename Cost>
  void bring_up_to_date(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                        std::int32_t alpha, Flow& flow);
  template <typename Cost>
  void begin_from_unused(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels,
                         std::int32_t alpha, Flow& flow);
  template <typename Cost>
  void reset(const BasicLabelingProblem<Cost>& problem, std::span<const Role> roles, std::int32_t alpha,
             Flow& flow) const;
  void list_changes(std::span<const Role> roles, const Flow& flow);
  template <typename Cost>
  void update(const BasicLabelingProblem<Cost>& problem, std::span<const Role> roles, std::int32_t alpha,
              Flow& flow);
  template <typename Cost>
  void update_site(const BasicLabelingProblem<Cost>& problem, std::span<const Role> roles, std::int32_t alpha,
                   std::int32_t v, Flow& flow) const;
  Residual weight_at(std::int32_t arc) const { return weight_[weight_.size() == 1 ? 0 : arc]; }
  std::int64_t gain_bound(const Flow& flow);
  static std::int64_t deficit_of(const Flow& flow);

  static constexpr std::int32_t kNoLabel = -1;
  static constexpr std::int32_t kUnused = -2;     // the label of unused_
  static constexpr std::size_t kUpdateShare = 4;  // a site's update costs more than its share of a reset
  static constexpr std::size_t kFlowMemory = std::size_t{48} << 20;  // bytes; labels beyond share one flow

  ArcRows rows_;
  std::vector<Residual> weight_;  // by arc, or one for all
  std::span<const std::uint64_t> allowed_;
  FlowSolver<Capacity, Residual> solver_;
  LabelHubs<Capacity, Residual> hubs_;
  std::vector<Role> roles_;
  std::vector<std::int64_t> hub_cost_;  // per label: what wiping it out gains
  std::vector<Flow> flows_;             // per label
  Flow unused_;                         // none, of a label that no site has and whose data cost nothing
  std::vector<std::int64_t> excess_;    // per label + 1: above 0, the first of sites without a part
  std::vector<std::int32_t> changed_;   // sites whose role is not the flow's
  std::vector<std::int32_t> switched_;
};

template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::begin(const BasicLabelingProblem<Cost>& problem,
                                              std::span<const std::uint64_t> allowed) {
  const auto site_count = static_cast<std::int32_t>(problem.site_count());
  const auto visit_edges = [&](auto visit) {
    for (std::int32_t i = 0; i < site_count; ++i) {
      for (std::int64_t e = problem.indptr[i]; e < problem.indptr[i + 1]; ++e) {
        if (problem.indices[e] != i) visit(e, i, problem.indices[e]);
      }
    }
  };
  rows_.begin(problem.site_count());
  visit_edges([&](std::int64_t, std::int32_t u, std::int32_t v) { rows_.count_edge(u, v); });
  rows_.allocate();
  if (problem.weight.size() == 1) {
    visit_edges([&](std::int64_t, std::int32_t u, std::int32_t v) { rows_.add_edge(u, v); });
    weight_.assign(1, static_cast<Residual>(problem.weight[0]));
  } else {
    weight_.resize(std::max<std::size_t>(rows_.arc_count(), 2));
    visit_edges([&](std::int64_t e, std::int32_t u, std::int32_t v) {
      const std::int32_t a = rows_.add_edge(u, v);
      weight_[a] = weight_[rows_.arc(a).sister] = static_cast<Residual>(problem.weight[e]);
    });
  }
  allowed_ = allowed;
  const std::size_t bytes = rows_.arc_count() * sizeof(Residuals<Residual>) +
                            problem.site_count() * (sizeof(Role) + sizeof(Capacity)) + 1;
  const std::size_t count = std::min(static_cast<std::size_t>(problem.label_count), kFlowMemory / bytes + 1);
  if (flows_.size() < count) flows_.resize(count);
  for (Flow& flow : flows_) flow.label = kNoLabel;
  unused_.label = kNoLabel;
}

template <typename Capacity, typename Residual>
template <typename Cost>
std::int64_t ExpansionMove<Capacity, Residual>::find(const BasicLabelingProblem<Cost>& problem,
                                                     std::span<const std::int32_t> labels,
                                                     std::span<const std::int32_t> used, std::int32_t alpha) {
  switched_.clear();
  set_roles(problem, labels, used, alpha);
  const std::int64_t price = used[alpha] > 0 ? 0 : problem.cost_of_label(alpha);

  Flow& flow = flows_[std::min(static_cast<std::size_t>(alpha), flows_.size() - 1)];
  bring_up_to_date(problem, labels, alpha, flow);
  if (gain_bound(flow) <= price) return 0;

  // Keeping everything cuts every deficit; the minimum cut is as large as the flow.
  const std::int64_t keep_all = deficit_of(flow);
  solver_.attach(rows_, flow.residuals, flow.excess);
  solver_.start();
  solver_.maximise(keep_all - price);
  if (!solver_.is_maximum()) {
    if (gain_bound(flow) <= price) return 0;
    solver_.maximise();
  }
  std::int64_t gain = deficit_of(flow) - price;
  hubs_.survey(solver_, labels, hub_cost_);
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    if (hubs_.is_wiped_by_cut(l)) gain += hub_cost_[l];
  }
  if (gain + hubs_.gain_bound() > 0) gain += hubs_.fill(solver_);
  if (gain <= 0) return 0;

  for (std::size_t v = 0; v < solver_.node_count(); ++v) {
    if (takes_part(roles_[v]) && (solver_.on_sink_side(v) || hubs_.switches(v))) {
      switched_.push_back(static_cast<std::int32_t>(v));
    }
  }
  return gain;
}

// A label that a site must keep cannot be wiped out.
template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::set_roles(const BasicLabelingProblem<Cost>& problem,
                                                  std::span<const std::int32_t> labels,
                                                  std::span<const std::int32_t> used, std::int32_t alpha) {
  hub_cost_.resize(used.size());
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    hub_cost_[l] = used[l] > 0 && l != alpha ? problem.cost_of_label(l) : 0;
  }
  roles_.resize(labels.size());
  if (allowed_.empty() || alpha >= std::numeric_limits<std::uint64_t>::digits) {
    for (std::size_t v = 0; v < labels.size(); ++v) roles_[v] = labels[v] == alpha ? kHasAlpha : labels[v];
    return;
  }
  for (std::size_t v = 0; v < labels.size(); ++v) {
    const bool may_switch = ((allowed_[v] >> alpha) & 1) != 0;
    roles_[v] = labels[v] == alpha ? kHasAlpha : may_switch ? labels[v] : kept(labels[v]);
    if (!may_switch) hub_cost_[labels[v]] = 0;
  }
}

template <typename Capacity, typename Residual>
typename ExpansionMove<Capacity, Residual>::Terms ExpansionMove<Capacity, Residual>::terms_of(
    Role u, Role v, Residual weight, bool u_is_first) {
  const auto w = static_cast<Capacity>(weight);
  if (u == v) return {weight, weight, 0};
  if (v == kHasAlpha) return {0, 0, static_cast<Capacity>(-w)};
  if (!takes_part(v)) return {0, 0, v == kept(u) ? w : Capacity{0}};
  return u_is_first ? Terms{0, weight, static_cast<Capacity>(-w)} : Terms{weight, 0, 0};
}

template <typename Capacity, typename Residual>
template <typename Cost>
Capacity ExpansionMove<Capacity, Residual>::data_excess(const BasicLabelingProblem<Cost>& problem,
                                                        std::size_t v, Role role, std::int32_t alpha) const {
  if (!takes_part(role) || alpha == kUnused) return 0;
  const Cost* row = problem.unary.data() + v * static_cast<std::size_t>(problem.label_count);
  return static_cast<Capacity>(static_cast<Capacity>(row[alpha]) - static_cast<Capacity>(row[role]));
}

template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::bring_up_to_date(const BasicLabelingProblem<Cost>& problem,
                                                         std::span<const std::int32_t> labels,
                                                         std::int32_t alpha, Flow& flow) {
  if (flow.label != alpha) {
    std::size_t without_part = 0;
    for (const Role role : roles_) without_part += takes_part(role) ? 0 : 1;
    if (without_part > roles_.size() / kUpdateShare) {
      reset<Cost>(problem, roles_, alpha, flow);
      return;
    }
    begin_from_unused(problem, labels, alpha, flow);
  }
  update<Cost>(problem, roles_, alpha, flow);
}

// What labels' moves have in common is copied: all but the data costs, where no site has the label.
template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::begin_from_unused(const BasicLabelingProblem<Cost>& problem,
                                                          std::span<const std::int32_t> labels,
                                                          std::int32_t alpha, Flow& flow) {
  if (unused_.label != kUnused) {
    reset(problem, labels, kUnused, unused_);
  } else {
    update(problem, labels, kUnused, unused_);
  }
  flow = unused_;
  flow.label = alpha;
  for (std::size_t v = 0; v < labels.size(); ++v) flow.excess[v] += data_excess(problem, v, labels[v], alpha);
}

template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::update(const BasicLabelingProblem<Cost>& problem,
                                               std::span<const Role> roles, std::int32_t alpha, Flow& flow) {
  list_changes(roles, flow);
  if (changed_.size() > roles.size() / kUpdateShare) {
    reset(problem, roles, alpha, flow);
    return;
  }
  for (const std::int32_t v : changed_) update_site(problem, roles, alpha, v, flow);
  for (const std::int32_t v : changed_) flow.roles[v] = roles[v];
}

// Mostly few, so that whole runs of sites are skipped.
template <typename Capacity, typename Residual>
void ExpansionMove<Capacity, Residual>::list_changes(std::span<const Role> roles, const Flow& flow) {
  constexpr std::size_t kRun = 64;
  changed_.clear();
  for (std::size_t begin = 0; begin < roles.size(); begin += kRun) {
    const std::size_t end = std::min(begin + kRun, roles.size());
    Role differences = 0;
    for (std::size_t v = begin; v < end; ++v) differences |= roles[v] ^ flow.roles[v];
    if (differences == 0) continue;
    for (std::size_t v = begin; v < end; ++v) {
      if (roles[v] != flow.roles[v]) changed_.push_back(static_cast<std::int32_t>(v));
    }
  }
}

template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::reset(const BasicLabelingProblem<Cost>& problem,
                                              std::span<const Role> roles, std::int32_t alpha,
                                              Flow& flow) const {
  const auto site_count = static_cast<std::int32_t>(roles.size());
  flow.label = alpha;
  flow.roles.assign(roles.begin(), roles.end());
  flow.excess.resize(roles.size());
  flow.residuals.resize(rows_.arc_count());
  for (std::int32_t v = 0; v < site_count; ++v) {
    const Role role = roles[v];
    const std::int32_t end = rows_.end_of(v);
    if (!takes_part(role)) {
      flow.excess[v] = 0;
      std::fill(flow.residuals.begin() + rows_.begin_of(v), flow.residuals.begin() + end,
                Residuals<Residual>{0, 0});
      continue;
    }
    Capacity excess = data_excess(problem, v, role, alpha);
    for (std::int32_t a = rows_.begin_of(v); a < end; ++a) {
      const std::int32_t head = rows_.arc(a).head;
      const Terms terms = terms_of(role, roles[head], weight_at(a), v < head);
      excess += terms.excess;
      flow.residuals[a] = {terms.forward, terms.backward};
    }
    flow.excess[v] = excess;
  }
}

// Changes what follows from the role of one site, and of those neighbours that have been changed before it.
template <typename Capacity, typename Residual>
template <typename Cost>
void ExpansionMove<Capacity, Residual>::update_site(const BasicLabelingProblem<Cost>& problem,
                                                    std::span<const Role> roles, std::int32_t alpha,
                                                    std::int32_t v, Flow& flow) const {
  const auto terms = [](Role u, Role h, Residual weight, bool u_is_first) {
    return takes_part(u) ? terms_of(u, h, weight, u_is_first) : Terms{0, 0, 0};
  };
  flow.excess[v] += data_excess(problem, v, roles[v], alpha) - data_excess(problem, v, flow.roles[v], alpha);
  for (std::int32_t a = rows_.begin_of(v); a < rows_.end_of(v); ++a) {
    const auto [head, sister] = rows_.arc(a);
    if (head > v && roles[head] != flow.roles[head]) continue;  // its own update takes both changes in
    const Residual weight = weight_at(a);
    const Terms old_here = terms(flow.roles[v], flow.roles[head], weight, v < head);
    const Terms old_there = terms(flow.roles[head], flow.roles[v], weight, head < v);
    const Terms new_here = terms(roles[v], roles[head], weight, v < head);
    const Terms new_there = terms(roles[head], roles[v], weight, head < v);
    const auto along = static_cast<Residual>(old_here.forward - flow.residuals[a].forward);
    const Residual kept_along =
        std::clamp(along, static_cast<Residual>(-new_here.backward), new_here.forward);
    flow.residuals[a] = {static_cast<Residual>(new_here.forward - kept_along),
                         static_cast<Residual>(new_here.backward + kept_along)};
    flow.residuals[sister] = {flow.residuals[a].backward, flow.residuals[a].forward};
    const auto returned = static_cast<Capacity>(along - kept_along);
    flow.excess[v] += new_here.excess - old_here.excess + returned;
    flow.excess[head] += new_there.excess - old_there.excess - returned;
  }
}

// No move gains more than this: edges between sites count nothing, and a label is either switched where that
// pays, or wiped out at the price of all its sites.
template <typename Capacity, typename Residual>
std::int64_t ExpansionMove<Capacity, Residual>::gain_bound(const Flow& flow) {
  std::int64_t bound = deficit_of(flow);
  excess_.assign(hub_cost_.size() + 1, 0);
  for (std::size_t v = 0; v < roles_.size(); ++v) {
    excess_[std::max(roles_[v], -1) + 1] += std::max<Capacity>(0, flow.excess[v]);
  }
  for (std::size_t l = 0; l < hub_cost_.size(); ++l) {
    bound += std::max<std::int64_t>(0, hub_cost_[l] - excess_[l + 1]);
  }
  return bound;
}

template <typename Capacity, typename Residual>
std::int64_t ExpansionMove<Capacity, Residual>::deficit_of(const Flow& flow) {
  std::int64_t sum = 0;
  for (const Capacity excess : flow.excess) sum -= std::min<Capacity>(0, excess);
  return sum;
}

}  // namespace emseg
