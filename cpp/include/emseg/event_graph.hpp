// The space-time graph over the events of a window: sites are events, edges join neighbours in space and time.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

// An undirected graph in compressed rows.  Each edge {i, j} is stored once, in the row of its smaller end,
// and rows are sorted: indices[indptr[i] .. indptr[i+1]) are the neighbours j > i of site i.
struct EventGraph {
  std::vector<std::int64_t> indptr;   // sites + 1
  std::vector<std::int32_t> indices;  // edges

  std::size_t site_count() const { return indptr.empty() ? 0 : indptr.size() - 1; }
  std::size_t edge_count() const { return indices.size(); }
};

struct Pixel {
  int x = 0;
  int y = 0;

  friend bool operator==(const Pixel&, const Pixel&) = default;
};

// Edges (a, b), a < b, of a Delaunay triangulation of distinct integer pixels, sorted.  Cocircular pixels are
// triangulated one way or another; collinear pixels give the path along their line; one pixel gives none.
std::vector<std::pair<std::int32_t, std::int32_t>> delaunay_edges(std::span<const Pixel> pixels);

// Builds the graph: active pixels are triangulated; each event is joined to its predecessor and successor at
// its own pixel and, for every Delaunay neighbour of that pixel, to the temporally nearest event at or before it and
// the nearest after it there (2 + 2N neighbours before duplicates are removed).
// Source: Zhou et al., "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts", TNNLS 2021, III-B.
EventGraph build_event_graph(const EventView& events, ImageSize size);

}  // namespace emseg
