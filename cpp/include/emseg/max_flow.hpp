// Maximum flow and minimum cut on sparse graphs with terminals, 64-bit integer capacities.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

struct MaxFlowResult {
  std::int64_t flow = 0;
  std::vector<std::uint8_t> sink_side;  // per node: 1 on the sink's side of a minimum cut, 0 on the source's
};

// Arc e joins tail[e] to head[e] with capacity[e] along it and reverse[e] against it; source[v] and sink[v] are the
// capacities of the arcs from the source to v and from v to the sink.  All capacities are >= 0.
// Throws std::invalid_argument on negative capacities, nodes out of range, or a total that overflows.
MaxFlowResult max_flow(std::int64_t node_count, std::span<const std::int32_t> tail,
                       std::span<const std::int32_t> head, std::span<const std::int64_t> capacity,
                       std::span<const std::int64_t> reverse, std::span<const std::int64_t> source,
                       std::span<const std::int64_t> sink);

}  // namespace emseg
