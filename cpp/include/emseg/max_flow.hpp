// Maximum flow and minimum cut on sparse graphs with terminals, 64-bit integer capacities.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

// Edge e joins tail[e] to head[e] with capacity[e] along it and reverse[e] against it; source[v] and sink[v]
// are the capacities of the arcs from the source to v and from v to the sink.  All capacities are >= 0.
// Parallel edges add up, and an edge from a node to itself carries nothing.
struct FlowGraph {
  std::span<const std::int32_t> tail;      // edges
  std::span<const std::int32_t> head;      // edges
  std::span<const std::int64_t> capacity;  // edges
  std::span<const std::int64_t> reverse;   // edges
  std::span<const std::int64_t> source;    // nodes
  std::span<const std::int64_t> sink;      // nodes
};

struct MaxFlowResult {
  std::int64_t flow = 0;
  // Per node: 1 where the sink can be reached through residual arcs, else 0.  Of all minimum cuts this one
  // has the fewest nodes on the sink's side.
  std::vector<std::uint8_t> sink_side;
};

// Throws std::invalid_argument on negative capacities, nodes out of range, unequal lengths, or totals beyond
// 2^62.
MaxFlowResult max_flow(const FlowGraph& graph);

}  // namespace emseg
