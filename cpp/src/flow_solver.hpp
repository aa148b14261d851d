// Maximum flow by incremental breadth-first search, on graphs whose nodes carry an excess or a deficit.
//
// Source: Goldberg, Hed, Kaplan, Tarjan, Werneck, "Maximum Flows by Incremental Breadth-First Search", ESA 2011.
// Two forests of shortest residual paths are grown level by level: one from the nodes with excess (the source's
// side), one towards the nodes with a deficit (the sink's).  Where they meet, flow is pushed from root to root;
// nodes cut off by saturated arcs look for a new parent on the lowest possible level.
#pragma once

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

namespace emseg {

// Capacity is std::int32_t where forward + backward of every edge and |excess| of every node fit in it, else
// std::int64_t: residuals stay within the first, and no push raises an excess.
//
// Use: begin(n); count_edge(..) for every edge; allocate(); add_edge(..) for the same edges in any order;
// excess(v) as wanted; maximise().  All memory is kept for the next graph.
template <typename Capacity>
class FlowSolver {
 public:
  // Both residuals of an edge stand at both its ends: a search in either direction reads one arc only.
  struct Arc {
    std::int32_t head;
    std::int32_t sister;  // index of the same edge's arc at the other end
    Capacity forward;     // residual capacity towards `head`
    Capacity backward;    // residual capacity from `head`
  };

  void begin(std::size_t node_count) {
    first_.assign(node_count + 2, 0);
    excess_.assign(node_count, 0);
  }

  // Rows are counted two places up, so that filling them leaves every row's begin in its own place.
  void count_edge(std::int32_t u, std::int32_t v) {
    ++first_[static_cast<std::size_t>(u) + 2];
    ++first_[static_cast<std::size_t>(v) + 2];
  }

  void allocate() {
    for (std::size_t k = 2; k < first_.size(); ++k) first_[k] += first_[k - 1];
    arcs_.resize(static_cast<std::size_t>(first_.back()));
  }

  void add_edge(std::int32_t u, std::int32_t v, Capacity forward, Capacity backward) {
    const std::int32_t a = first_[static_cast<std::size_t>(u) + 1]++;
    const std::int32_t b = first_[static_cast<std::size_t>(v) + 1]++;
    arcs_[static_cast<std::size_t>(a)] = {v, b, forward, backward};
    arcs_[static_cast<std::size_t>(b)] = {u, a, backward, forward};
  }

  std::size_t node_count() const { return excess_.size(); }

  // Positive: capacity left from the source; negative: capacity left to the sink.
  Capacity& excess(std::size_t v) { return excess_[v]; }
  Capacity excess(std::size_t v) const { return excess_[v]; }

  std::int32_t arcs_begin(std::int32_t v) const { return first_[static_cast<std::size_t>(v)]; }
  std::int32_t arcs_end(std::int32_t v) const { return first_[static_cast<std::size_t>(v) + 1]; }
  const Arc& arc(std::int32_t a) const { return arcs_[static_cast<std::size_t>(a)]; }

  void push(std::int32_t a, Capacity amount) {
    Arc& arc = arc_at(a);
    Arc& sister = arc_at(arc.sister);
    arc.forward -= amount;
    arc.backward += amount;
    sister.forward += amount;
    sister.backward -= amount;
  }

  // Pushes a maximum flow from excesses to deficits and returns its value.  Afterwards on_sink_side tells the
  // minimum cut with the fewest nodes on the sink's side.
  std::int64_t maximise();

  // Whether a deficit can still be reached from v.
  bool on_sink_side(std::size_t v) const { return distance_[v] < 0; }

 private:
  enum class Side { source, sink };

  static constexpr std::int32_t kRoot = -1;
  static constexpr std::int32_t kNone = -1;
  // parent_ of an orphan holds the arc from which its search for a parent of the same level goes on.
  static constexpr std::int32_t orphan_at(std::int32_t arc) { return -2 - arc; }

  struct Forest {
    std::int32_t depth = 1;              // the deepest finished level
    std::int32_t limit = 1;              // the deepest level that a node may take now
    std::vector<std::int32_t> frontier;  // nodes of level `depth`; entries that left it are skipped
    std::vector<std::int32_t> next;      // nodes of level depth + 1 while the forest grows
  };

  // Residual capacity in the direction of flow away from the forest's roots (source) or towards them (sink).
  template <Side side>
  static Capacity outgoing(const Arc& arc) {
    return side == Side::source ? arc.forward : arc.backward;
  }
  template <Side side>
  static Capacity incoming(const Arc& arc) {
    return side == Side::source ? arc.backward : arc.forward;
  }
  template <Side side>
  static constexpr std::int32_t signed_level(std::int32_t level) {
    return side == Side::source ? level : -level;
  }

  Arc& arc_at(std::int32_t a) { return arcs_[static_cast<std::size_t>(a)]; }
  std::int32_t& distance(std::int32_t v) { return distance_[static_cast<std::size_t>(v)]; }
  std::int32_t& parent(std::int32_t v) { return parent_[static_cast<std::size_t>(v)]; }
  Capacity& excess_at(std::int32_t v) { return excess_[static_cast<std::size_t>(v)]; }
  template <Side side>
  Forest& forest() {
    return side == Side::source ? source_ : sink_;
  }

  void push_to_neighbours();
  void plant();
  template <Side side>
  void grow();
  void augment(std::int32_t bridge);
  template <Side side>
  Capacity path_capacity(std::int32_t v, Capacity bound);
  template <Side side>
  void push_along_path(std::int32_t v, Capacity amount);
  void make_orphan(std::int32_t v, std::int32_t search_from);
  template <Side side>
  void adopt_orphans();
  template <Side side>
  void adopt(std::int32_t v);

  std::vector<std::int32_t> first_;     // rows of arcs_, nodes + 2
  std::vector<Arc> arcs_;
  std::vector<Capacity> excess_;
  std::vector<std::int32_t> distance_;  // > 0: level in the source's forest; < 0: minus that in the sink's; 0: free
  std::vector<std::int32_t> parent_;    // arc to the parent, kRoot, or orphan_at
  std::vector<std::int32_t> next_orphan_;
  std::vector<std::int32_t> orphans_;   // per level: head of a list through next_orphan_
  std::int32_t lowest_orphan_ = 0;
  std::int32_t highest_orphan_ = 0;
  Forest source_;
  Forest sink_;
  std::int64_t flow_ = 0;
};

template <typename Capacity>
std::int64_t FlowSolver<Capacity>::maximise() {
  flow_ = 0;
  push_to_neighbours();
  plant();
  // The sink's forest is always completed, so that the cut does not depend on which side ends first.
  while (!sink_.frontier.empty()) {
    if (!source_.frontier.empty() && source_.frontier.size() <= sink_.frontier.size()) {
      grow<Side::source>();
    } else {
      grow<Side::sink>();
    }
  }
  return flow_;
}

// Paths of one arc, before there are forests to keep in order.
template <typename Capacity>
void FlowSolver<Capacity>::push_to_neighbours() {
  const auto n = static_cast<std::int32_t>(node_count());
  for (std::int32_t v = 0; v < n; ++v) {
    for (std::int32_t a = arcs_begin(v); a < arcs_end(v) && excess_at(v) > 0; ++a) {
      const Arc& arc = arc_at(a);
      Capacity& deficit = excess_at(arc.head);
      if (deficit >= 0 || arc.forward == 0) continue;
      const Capacity amount = std::min({excess_at(v), arc.forward, static_cast<Capacity>(-deficit)});
      push(a, amount);
      excess_at(v) -= amount;
      deficit += amount;
      flow_ += amount;
    }
  }
}

template <typename Capacity>
void FlowSolver<Capacity>::plant() {
  const std::size_t n = node_count();
  distance_.assign(n, 0);
  parent_.assign(n, kRoot);
  next_orphan_.resize(n);
  orphans_.assign(2, kNone);
  for (Forest* forest : {&source_, &sink_}) {
    forest->depth = forest->limit = 1;
    forest->frontier.clear();
    forest->next.clear();
  }
  for (std::size_t v = 0; v < n; ++v) {
    if (excess_[v] == 0) continue;
    distance_[v] = excess_[v] > 0 ? 1 : -1;
    (excess_[v] > 0 ? source_ : sink_).frontier.push_back(static_cast<std::int32_t>(v));
  }
}

template <typename Capacity>
template <typename FlowSolver<Capacity>::Side side>
void FlowSolver<Capacity>::grow() {
  Forest& self = forest<side>();
  const std::int32_t here = signed_level<side>(self.depth);
  const std::int32_t below = signed_level<side>(self.depth + 1);
  self.limit = self.depth + 1;
  if (orphans_.size() < static_cast<std::size_t>(self.limit) + 1) orphans_.resize(2 * orphans_.size() + 1, kNone);
  for (std::size_t k = 0; k < self.frontier.size(); ++k) {  // adoption may lengthen the frontier
    const std::int32_t v = self.frontier[k];
    for (std::int32_t a = arcs_begin(v); a < arcs_end(v) && distance(v) == here;) {
      const Arc& arc = arc_at(a);
      if (outgoing<side>(arc) > 0) {
        const std::int32_t met = distance(arc.head);
        if (met == 0) {
          distance(arc.head) = below;
          parent(arc.head) = arc.sister;
          self.next.push_back(arc.head);
        } else if ((met > 0) != (here > 0)) {
          augment(side == Side::source ? a : arc.sister);
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
template <typename Capacity>
void FlowSolver<Capacity>::augment(std::int32_t bridge) {
  const std::int32_t head = arc_at(bridge).head;
  const std::int32_t tail = arc_at(arc_at(bridge).sister).head;
  Capacity amount = arc_at(bridge).forward;
  amount = path_capacity<Side::source>(tail, amount);
  amount = path_capacity<Side::sink>(head, amount);
  push(bridge, amount);
  flow_ += amount;
  push_along_path<Side::source>(tail, amount);
  adopt_orphans<Side::source>();
  push_along_path<Side::sink>(head, amount);
  adopt_orphans<Side::sink>();
}

template <typename Capacity>
template <typename FlowSolver<Capacity>::Side side>
Capacity FlowSolver<Capacity>::path_capacity(std::int32_t v, Capacity bound) {
  while (parent(v) != kRoot) {
    const Arc& arc = arc_at(parent(v));
    bound = std::min(bound, incoming<side>(arc));
    v = arc.head;
  }
  return std::min(bound, static_cast<Capacity>(std::abs(excess_at(v))));
}

template <typename Capacity>
template <typename FlowSolver<Capacity>::Side side>
void FlowSolver<Capacity>::push_along_path(std::int32_t v, Capacity amount) {
  lowest_orphan_ = std::numeric_limits<std::int32_t>::max();
  highest_orphan_ = 0;
  while (parent(v) != kRoot) {
    const std::int32_t a = parent(v);
    const Arc& arc = arc_at(a);
    const std::int32_t up = arc.head;
    push(side == Side::source ? arc.sister : a, amount);
    if (incoming<side>(arc) == 0) make_orphan(v, a);
    v = up;
  }
  excess_at(v) -= side == Side::source ? amount : -amount;
  if (excess_at(v) == 0) make_orphan(v, arcs_begin(v));
}

template <typename Capacity>
void FlowSolver<Capacity>::make_orphan(std::int32_t v, std::int32_t search_from) {
  parent(v) = orphan_at(search_from);
  const std::int32_t level = std::abs(distance(v));
  lowest_orphan_ = std::min(lowest_orphan_, level);
  highest_orphan_ = std::max(highest_orphan_, level);
  std::int32_t& list = orphans_[static_cast<std::size_t>(level)];
  next_orphan_[static_cast<std::size_t>(v)] = list;
  list = v;
}

// Level by level from the lowest: whoever could be a parent has been settled before.
template <typename Capacity>
template <typename FlowSolver<Capacity>::Side side>
void FlowSolver<Capacity>::adopt_orphans() {
  for (std::int32_t level = lowest_orphan_; level <= highest_orphan_; ++level) {
    std::int32_t& list = orphans_[static_cast<std::size_t>(level)];
    while (list != kNone) {
      const std::int32_t v = list;
      list = next_orphan_[static_cast<std::size_t>(v)];
      adopt<side>(v);
    }
  }
}

template <typename Capacity>
template <typename FlowSolver<Capacity>::Side side>
void FlowSolver<Capacity>::adopt(std::int32_t v) {
  const std::int32_t level = std::abs(distance(v));
  const std::int32_t begin = arcs_begin(v);
  const std::int32_t end = arcs_end(v);
  if (level > 1) {
    const std::int32_t wanted = signed_level<side>(level - 1);
    for (std::int32_t a = orphan_at(parent(v)); a < end; ++a) {
      if (incoming<side>(arc_at(a)) > 0 && distance(arc_at(a).head) == wanted) {
        parent(v) = a;
        return;
      }
    }
  }

  Forest& self = forest<side>();
  const std::int32_t child_distance = signed_level<side>(level + 1);
  std::int32_t parent_level = self.limit;
  std::int32_t parent_arc = kNone;
  for (std::int32_t a = begin; a < end; ++a) {
    const Arc& arc = arc_at(a);
    const std::int32_t other = distance(arc.head);
    if (other == child_distance && parent(arc.head) == arc.sister) make_orphan(arc.head, arc.sister);
    const std::int32_t other_level = signed_level<side>(other);
    if (other_level > 0 && other_level < parent_level && incoming<side>(arc) > 0) {
      parent_level = other_level;
      parent_arc = a;
    }
  }
  if (parent_arc == kNone) {
    distance(v) = 0;
    return;
  }
  distance(v) = signed_level<side>(parent_level + 1);
  parent(v) = parent_arc;
  if (parent_level + 1 == self.depth) self.frontier.push_back(v);
  if (parent_level + 1 > self.depth) self.next.push_back(v);
}

}  // namespace emseg
