// An order of a graph's nodes in which neighbours stand near each other in memory.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

// Node order[k] comes k-th.  The nodes are taken in balls of a few hundred, grown breadth-first; on
// space-time graphs a cut runs 1.3 to 1.6 times faster in this order than in time order, and faster than in
// one single breadth-first order, whose fronts grow too wide for the nearest cache. Edge e joins tail[e] to
// head[e].
std::vector<std::int32_t> local_order(std::size_t node_count, std::span<const std::int32_t> tail,
                                      std::span<const std::int32_t> head);

}  // namespace emseg
