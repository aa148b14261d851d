// The space-time graph over the events of a window: sites are events, edges join neighbours in space and
// time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
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

// An undirected edge between two pixels, by their positions in the array of pixels; first < second.
using PixelEdge = std::pair<std::int32_t, std::int32_t>;

// Edges of a Delaunay triangulation of distinct integer pixels, each once, in no particular order.  All
// decisions are exact for any coordinates that differ by at most 65535.  Cocircular pixels are triangulated
// one way or another, the same way for the same pixels; collinear pixels give the path along their line;
// fewer than two pixels give none. Throws std::invalid_argument where two pixels coincide or lie further
// apart than that.
std::vector<PixelEdge> delaunay_edges(std::span<const Pixel> pixels);

// The same by CGAL, several times slower: the oracle.  Cocircular pixels may be triangulated differently,
// from ours and from one call to the next.
std::vector<PixelEdge> delaunay_edges_cgal(std::span<const Pixel> pixels);

// Builds the graph: active pixels are triangulated; each event is joined to its predecessor and successor at
// its own pixel and, for every Delaunay neighbour of that pixel, to the last event before it and the first
// after it there (2 + 2N neighbours).  "Before" and "after" go by position in the array, so that events of
// one time have an order too.  The polarity plays no part.
// Source: Zhou et al., "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts", TNNLS 2021, III-B.
// Throws std::invalid_argument where columns differ in length, an event lies outside the sensor, or there are
// 2^31 events or more; event times are not read.
EventGraph build_event_graph(const EventView& events, ImageSize size);

}  // namespace emseg
