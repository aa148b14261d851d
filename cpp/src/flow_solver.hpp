// Maximum flow by incremental breadth-first search, on graphs whose nodes carry an excess or a deficit.
//
// Source: Goldberg, Hed, Kaplan, Tarjan, Werneck, "Maximum Flows by Incremental Breadth-First Search", ESA
// 2011. Two forests of shortest residual paths are grown level by level: one from the nodes with excess (the
// source's side), one towards the nodes with a deficit (the sink's).  Where they meet, flow is pushed from
// root to root; nodes cut off by saturated arcs look for a new parent on the lowest possible level.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <span>
#include <vector>

namespace emseg {

// A graph without capacities: both arcs of every edge, by their tails.
class ArcRows {
 public:
  struct Arc {
    std::int32_t head;
    std::int32_t sister;  // the same edge's arc at the other end
  };

  // Use: begin(n); count_edge(..) for every edge; allocate(); add_edge(..) for the same edges in any order.
  // All memory is kept for the next graph.
  void begin(std::size_t node_count) { first_.assign(node_count + 2, 0); }

  // Rows are counted two places up, so that filling them leaves every row's begin in its own place.
  void count_edge(std::int32_t u, std::int32_t v) {
    ++first_[static_cast<std::size_t>(u) + 2];
    ++first_[static_cast<std::size_t>(v) + 2];
  }

  void allocate() {
    for (std::size_t k = 2; k < first_.size(); ++k) first_[k] += first_[k - 1];
    arcs_.resize(static_cast<std::size_t>(first_.back()));
  }

  // Returns the edge's arc at u.
  std::int32_t add_edge(std::int32_t u, std::int32_t v) {
    const std::int32_t a = first_[static_cast<std::size_t>(u) + 1]++;
    const std::int32_t b = first_[static_cast<std::size_t>(v) + 1]++;
    arcs_[static_cast<std::size_t>(a)] = {v, b};
    arcs_[static_cast<std::size_t>(b)] = {u, a};
    return a;
  }

  std::size_t node_count() const { return first_.empty() ? 0 : first_.size() - 2; }
  std::size_t arc_count() const { return arcs_.size(); }
  std::int32_t begin_of(std::int32_t v) const { return first_[static_cast<std::size_t>(v)]; }
  std::int32_t end_of(std::int32_t v) const { return first_[static_cast<std::size_t>(v) + 1]; }
  const Arc& arc(std::int32_t a) const { return arcs_[static_cast<std::size_t>(a)]; }

 private:
  std::vector<std::int32_t> first_;  // rows of arcs_, nodes + 2
  std::vector<Arc> arcs_;
};

// What a flow leaves of an edge's capacities.  Both stand at both its arcs: a search in either direction
// reads one of them only.
template <typename Residual>
struct Residuals {
  Residual forward;   // towards the arc's head
  Residual backward;  // from it
};

// Residual holds forward + backward of every edge, Capacity the excess of every node besides: residuals stay
// within the first, and no push raises an excess.
//
// Use: attach(..) to a graph and a flow in it; start(); maximise().  The flow stays in the arrays attached.
template <typename Capacity, typename Residual = Capacity>
class FlowSolver {
 public:
  using Arc = ArcRows::Arc;

  // Borrowed until the next call; residuals by arc, excess by node.
  void attach(const ArcRows& rows, std::span<Residuals<Residual>> residuals, std::span<Capacity> excess) {
    assert(residuals.size() == rows.arc_count() && excess.size() == rows.node_count());
    rows_ = &rows;
    residuals_ = residuals;
    excess_ = excess;
  }

  std::size_t node_count() const { return excess_.size(); }

  // Positive: capacity left from the source; negative: capacity left to the sink.
  Capacity& excess(std::size_t v) { return excess_[v]; }
  Capacity excess(std::size_t v) const { return excess_[v]; }

  std::int32_t arcs_begin(std::int32_t v) const { return rows_->begin_of(v); }
  std::int32_t arcs_end(std::int32_t v) const { return rows_->end_of(v); }
  const Arc& arc(std::int32_t a) const { return rows_->arc(a); }
  const Residuals<Residual>& residuals(std::int32_t a) const {
    return residuals_[static_cast<std::size_t>(a)];
  }

  void push(std::int32_t a, Capacity amount) {
    Residuals<Residual>& here = residuals_[static_cast<std::size_t>(a)];
    Residuals<Residual>& there = residuals_[static_cast<std::size_t>(arc(a).sister)];
    const auto part = static_cast<Residual>(amount);
    here.forward = static_cast<Residual>(here.forward - part);
    here.backward = static_cast<Residual>(here.backward + part);
    there.forward = static_cast<Residual>(there.forward + part);
    there.backward = static_cast<Residual>(there.backward - part);
  }

  // Once after the flow is attached.
  void start();

  // Pushes flow from excesses to deficits until it is a maximum flow, or is at least `enough` at the end of a
  // pass; then it can be called again for more.  Returns the flow since start().
  std::int64_t maximise(std::int64_t enough = std::numeric_limits<std::int64_t>::max());
  bool is_maximum() const { return sink_.frontier.empty(); }

  // Of a maximum flow: whether a deficit can still be reached from v.  This is the minimum cut with the
  // fewest nodes on the sink's side.
  bool on_sink_side(std::size_t v) const { return nodes_[v].distance < 0; }

 private:
  enum class Side { source, sink };

  static constexpr std::int32_t kRoot = -1;
  static constexpr std::int32_t kOrphan = -2;
  static constexpr std::int32_t kNone = -1;

  struct Node {
    std::int32_t distance;  // > 0: level in the source's forest; < 0: minus that in the sink's; 0: free
    std::int32_t parent;    // arc to the parent, kRoot or kOrphan
  };

  struct Forest {
    std::int32_t depth = 1;              // the deepest finished level
    std::int32_t limit = 1;              // the deepest level that a node may take now
    std::vector<std::int32_t> frontier;  // nodes of level `depth`; entries that left it are skipped
    std::vector<std::int32_t> next;      // nodes of level depth + 1 while the forest grows
  };

  struct Detached {
    std::int32_t node;
    std::int32_t level;  // that it had
  };

  // Residual capacity in the direction of flow away from the forest's roots (source) or towards them (sink).
  template <Side side>
  Capacity outgoing(std::int32_t a) const {
    return side == Side::source ? residuals(a).forward : residuals(a).backward;
  }
  template <Side side>
  Capacity incoming(std::int32_t a) const {
    return side == Side::source ? residuals(a).backward : residuals(a).forward;
  }
  template <Side side>
  static constexpr std::int32_t signed_level(std::int32_t level) {
    return side == Side::source ? level : -level;
  }

  std::int32_t& distance(std::int32_t v) { return nodes_[static_cast<std::size_t>(v)].distance; }
  std::int32_t& parent(std::int32_t v) { return nodes_[static_cast<std::size_t>(v)].parent; }
  Capacity& excess_at(std::int32_t v) { return excess_[static_cast<std::size_t>(v)]; }
  template <Side side>
  Forest& forest() {
    return side == Side::source ? source_ : sink_;
  }

  void push_to_neighbours();
  template <Side side>
  void push_to_neighbours_of();
  void plant();
  template <Side side>
  void grow();
  void augment(std::int32_t bridge);
  template <Side side>
  Capacity path_capacity(std::int32_t v, Capacity bound);
  template <Side side>
  void push_along_path(std::int32_t v, Capacity amount);
  void make_orphan(std::int32_t v);
  void list_at_level(std::int32_t v, std::int32_t level);
  template <Side side>
  void adopt_orphans();
  template <Side side>
  bool adopt_at_same_level(std::int32_t v);
  template <Side side>
  void detach(std::int32_t v);
  template <Side side>
  void place_detached();
  template <Side side>
  void place(std::int32_t v, std::int32_t level);

  const ArcRows* rows_ = nullptr;
  std::span<Residuals<Residual>> residuals_;
  std::span<Capacity> excess_;
  std::vector<Node> nodes_;
  std::vector<std::int32_t> next_orphan_;
  std::vector<std::int32_t> orphans_;  // per level: head of a list through next_orphan_
  std::vector<Detached> detached_;     // orphans that cannot stay on their level
  std::vector<std::int32_t> placed_;   // of these, those that found another, nearest first
  std::int32_t lowest_orphan_ = 0;
  std::int32_t highest_orphan_ = 0;
  Forest source_;
  Forest sink_;
  std::int64_t flow_ = 0;
};

template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::start() {
  flow_ = 0;
  push_to_neighbours();
  plant();
}

template <typename Capacity, typename Residual>
std::int64_t FlowSolver<Capacity, Residual>::maximise(std::int64_t enough) {
  // The sink's forest is always completed, so that the cut does not depend on which side ends first.
  while (!is_maximum() && flow_ < enough) {
    const bool source_is_next =
        source_.depth < sink_.depth ||
        (source_.depth == sink_.depth && source_.frontier.size() <= sink_.frontier.size());
    if (!source_.frontier.empty() && source_is_next) {
      grow<Side::source>();
    } else {
      grow<Side::sink>();
    }
  }
  return flow_;
}

// Paths of one arc, before there are forests to keep in order; from the side that has fewer nodes.
template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::push_to_neighbours() {
  std::size_t sources = 0, sinks = 0;
  for (const Capacity excess : excess_) {
    sources += excess > 0 ? 1 : 0;
    sinks += excess < 0 ? 1 : 0;
  }
  if (sources < sinks) {
    push_to_neighbours_of<Side::source>();
  } else {
    push_to_neighbours_of<Side::sink>();
  }
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::push_to_neighbours_of() {
  constexpr Capacity sign = side == Side::source ? 1 : -1;
  const auto n = static_cast<std::int32_t>(node_count());
  for (std::int32_t v = 0; v < n; ++v) {
    for (std::int32_t a = arcs_begin(v); a < arcs_end(v) && sign * excess_at(v) > 0; ++a) {
      const auto [head, sister] = arc(a);
      const Capacity wanted = -sign * excess_at(head);
      if (wanted <= 0 || outgoing<side>(a) == 0) continue;
      const Capacity amount = std::min({sign * excess_at(v), outgoing<side>(a), wanted});
      push(side == Side::source ? a : sister, amount);
      excess_at(v) -= sign * amount;
      excess_at(head) += sign * amount;
      flow_ += amount;
    }
  }
}

template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::plant() {
  const std::size_t n = node_count();
  nodes_.assign(n, {0, kRoot});
  next_orphan_.resize(n);
  orphans_.assign(2, kNone);
  for (Forest* forest : {&source_, &sink_}) {
    forest->depth = forest->limit = 1;
    forest->frontier.clear();
    forest->next.clear();
  }
  for (std::size_t v = 0; v < n; ++v) {
    if (excess_[v] == 0) continue;
    nodes_[v].distance = excess_[v] > 0 ? 1 : -1;
    (excess_[v] > 0 ? source_ : sink_).frontier.push_back(static_cast<std::int32_t>(v));
  }
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::grow() {
  Forest& self = forest<side>();
  const std::int32_t here = signed_level<side>(self.depth);
  const std::int32_t below = signed_level<side>(self.depth + 1);
  self.limit = self.depth + 1;
  if (orphans_.size() < static_cast<std::size_t>(self.limit) + 1)
    orphans_.resize(2 * orphans_.size() + 1, kNone);
  for (std::size_t k = 0; k < self.frontier.size(); ++k) {  // adoption may lengthen the frontier
    const std::int32_t v = self.frontier[k];
    for (std::int32_t a = arcs_begin(v); a < arcs_end(v) && distance(v) == here;) {
      if (outgoing<side>(a) > 0) {
        const auto [head, sister] = arc(a);
        const std::int32_t met = distance(head);
        if (met == 0) {
          distance(head) = below;
          parent(head) = sister;
          self.next.push_back(head);
        } else if ((met > 0) != (here > 0)) {
          augment(side == Side::source ? a : sister);
          continue;  // the same arc may carry more, by other paths
        }
      }
      ++a;
    }
  }
  self.frontier.swap(self.next);
  self.next.clear();
  self.depth = self.limit;
}

// Pushes what the path through `bridge`, an arc from the source's forest to the sink's, can carry.
template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::augment(std::int32_t bridge) {
  const std::int32_t head = arc(bridge).head;
  const std::int32_t tail = arc(arc(bridge).sister).head;
  Capacity amount = residuals(bridge).forward;
  amount = path_capacity<Side::source>(tail, amount);
  amount = path_capacity<Side::sink>(head, amount);
  push(bridge, amount);
  flow_ += amount;
  push_along_path<Side::source>(tail, amount);
  adopt_orphans<Side::source>();
  push_along_path<Side::sink>(head, amount);
  adopt_orphans<Side::sink>();
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
Capacity FlowSolver<Capacity, Residual>::path_capacity(std::int32_t v, Capacity bound) {
  while (parent(v) != kRoot) {
    bound = std::min(bound, incoming<side>(parent(v)));
    v = arc(parent(v)).head;
  }
  return std::min(bound, static_cast<Capacity>(std::abs(excess_at(v))));
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::push_along_path(std::int32_t v, Capacity amount) {
  lowest_orphan_ = std::numeric_limits<std::int32_t>::max();
  highest_orphan_ = 0;
  while (parent(v) != kRoot) {
    const std::int32_t a = parent(v);
    const auto [up, sister] = arc(a);
    push(side == Side::source ? sister : a, amount);
    if (incoming<side>(a) == 0) make_orphan(v);
    v = up;
  }
  excess_at(v) -= side == Side::source ? amount : -amount;
  if (excess_at(v) == 0) make_orphan(v);
}

template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::make_orphan(std::int32_t v) {
  parent(v) = kOrphan;
  const std::int32_t level = std::abs(distance(v));
  lowest_orphan_ = std::min(lowest_orphan_, level);
  highest_orphan_ = std::max(highest_orphan_, level);
  list_at_level(v, level);
}

template <typename Capacity, typename Residual>
void FlowSolver<Capacity, Residual>::list_at_level(std::int32_t v, std::int32_t level) {
  std::int32_t& list = orphans_[static_cast<std::size_t>(level)];
  next_orphan_[static_cast<std::size_t>(v)] = list;
  list = v;
}

// Orphans first look for another parent one level up, from the lowest level on: whoever could be one has been
// settled before.  Those without one are detached with their subtrees, and only then placed anew, nearest
// first: relabelling them one by one would let a cut-off region count up level by level on its own stale
// labels.
template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::adopt_orphans() {
  detached_.clear();
  for (std::int32_t level = lowest_orphan_; level <= highest_orphan_; ++level) {
    std::int32_t& list = orphans_[static_cast<std::size_t>(level)];
    while (list != kNone) {
      const std::int32_t v = list;
      list = next_orphan_[static_cast<std::size_t>(v)];
      if (!adopt_at_same_level<side>(v)) detach<side>(v);
    }
  }
  place_detached<side>();
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
bool FlowSolver<Capacity, Residual>::adopt_at_same_level(std::int32_t v) {
  const std::int32_t level = std::abs(distance(v));
  if (level == 1) return false;
  const std::int32_t wanted = signed_level<side>(level - 1);
  for (std::int32_t a = arcs_begin(v); a < arcs_end(v); ++a) {
    if (distance(arc(a).head) == wanted && incoming<side>(a) > 0) {
      parent(v) = a;
      return true;
    }
  }
  return false;
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::detach(std::int32_t v) {
  const std::int32_t below = distance(v) + signed_level<side>(1);
  for (std::int32_t a = arcs_begin(v); a < arcs_end(v); ++a) {
    const auto [head, sister] = arc(a);
    if (distance(head) == below && parent(head) == sister) make_orphan(head);
  }
  detached_.push_back({v, std::abs(distance(v))});
  distance(v) = 0;
}

// Breadth-first over the detached nodes, every one starting at the level that the rest of the forest offers
// it.
template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::place_detached() {
  const std::int32_t limit = forest<side>().limit;
  std::int32_t lowest = limit + 1;
  for (const auto& [v, old_level] : detached_) {
    // One level up nobody could take it, so that nothing lies nearer than one level down.
    std::int32_t level = limit + 1;
    for (std::int32_t a = arcs_begin(v); a < arcs_end(v) && level > old_level + 1; ++a) {
      const std::int32_t offered = signed_level<side>(distance(arc(a).head)) + 1;
      if (offered > 1 && offered < level && incoming<side>(a) > 0) {
        level = offered;
        parent(v) = a;
      }
    }
    if (level > limit) continue;
    list_at_level(v, level);
    lowest = std::min(lowest, level);
  }

  placed_.clear();
  std::size_t next = 0;  // first placed node that has not offered its own level yet
  for (std::int32_t level = lowest; level <= limit; ++level) {
    std::int32_t& list = orphans_[static_cast<std::size_t>(level)];
    for (; list != kNone; list = next_orphan_[static_cast<std::size_t>(list)]) {
      if (distance(list) == 0) place<side>(list, level);
    }
    if (level == limit) break;
    for (const std::size_t end = placed_.size(); next < end; ++next) {
      const std::int32_t v = placed_[next];
      for (std::int32_t a = arcs_begin(v); a < arcs_end(v); ++a) {
        const auto [head, sister] = arc(a);
        if (distance(head) != 0 || outgoing<side>(a) == 0) continue;
        parent(head) = sister;
        place<side>(head, level + 1);
      }
    }
  }
}

template <typename Capacity, typename Residual>
template <typename FlowSolver<Capacity, Residual>::Side side>
void FlowSolver<Capacity, Residual>::place(std::int32_t v, std::int32_t level) {
  Forest& self = forest<side>();
  distance(v) = signed_level<side>(level);
  placed_.push_back(v);
  if (level == self.depth) self.frontier.push_back(v);
  if (level > self.depth) self.next.push_back(v);
}

}  // namespace emseg
