// The space-time graph over the events of a window: sites are events, edges join neighbours in space and
// time.
#pragma once

#include <algorithm>
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

// What the edges between events follow from, a sixth of their size: the active pixels (those with events) in
// raster order, the events of each, and its Delaunay neighbours.
struct PixelGraph {
  std::vector<Pixel> pixels;
  std::vector<std::int32_t> pixel_of_event;
  std::vector<std::int32_t> event_start;      // pixels + 1: rows of `events`
  std::vector<std::int32_t> events;           // ascending in each row
  std::vector<std::int32_t> neighbour_start;  // pixels + 1: rows of `neighbours`
  std::vector<std::int32_t> neighbours;       // every edge stands in both its ends' rows

  std::size_t event_count() const { return pixel_of_event.size(); }
  std::int32_t pixel_count() const { return static_cast<std::int32_t>(pixels.size()); }
  std::span<const std::int32_t> events_of(std::int32_t pixel) const {
    return row(event_start, events, pixel);
  }
  std::span<const std::int32_t> neighbours_of(std::int32_t pixel) const {
    return row(neighbour_start, neighbours, pixel);
  }

 private:
  static std::span<const std::int32_t> row(const std::vector<std::int32_t>& start,
                                           const std::vector<std::int32_t>& entries, std::int32_t k) {
    const auto at = static_cast<std::size_t>(k);
    return {entries.data() + start[at], entries.data() + start[at + 1]};
  }
};

// Throws std::invalid_argument where columns differ in length, an event lies outside the sensor, or there are
// 2^31 events or more; event times are not read.
PixelGraph build_pixel_graph(const EventView& events, ImageSize size);

// Calls visit(i, j) once for every edge between the events first[i] and second[j] of two neighbouring pixels,
// given by their rows.
template <typename Visit>
void visit_event_edges(std::span<const std::int32_t> first, std::span<const std::int32_t> second,
                       Visit visit) {
  // Events arrive in order.  An arrival is joined to the last event of the other pixel and, further back, to
  // all that came there since the last arrival at its own.
  std::size_t i = 0, j = 0;
  std::size_t fresh_i = 0, fresh_j = 0;  // how many there were when the other pixel's last event arrived
  while (i < first.size() || j < second.size()) {
    if (j == second.size() || (i < first.size() && first[i] < second[j])) {
      for (std::size_t k = j == 0 ? 0 : std::min(fresh_j, j - 1); k < j; ++k) visit(i, k);
      fresh_j = j;
      ++i;
    } else {
      for (std::size_t k = i == 0 ? 0 : std::min(fresh_i, i - 1); k < i; ++k) visit(k, j);
      fresh_i = i;
      ++j;
    }
  }
}

// How many edges there are between events of two neighbouring pixels, given by their rows, none empty.
inline std::int32_t count_event_edges(std::span<const std::int32_t> first,
                                      std::span<const std::int32_t> second) {
  // A lone event is joined to each of the other pixel exactly where that one is before or after all others
  // in between: always.
  if (first.size() == 1 || second.size() == 1) {
    return static_cast<std::int32_t>(std::max(first.size(), second.size()));
  }
  std::int32_t count = 0;
  visit_event_edges(first, second, [&count](std::size_t, std::size_t) { ++count; });
  return count;
}

// All edges: each event is joined to its predecessor and successor at its own pixel and, for every Delaunay
// neighbour of that pixel, to the last event before it and the first after it there (2 + 2N neighbours).
// "Before" and "after" go by position in the array, so that events of one time have an order too.  The
// polarity plays no part.
// Source: Zhou et al., "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts", TNNLS 2021, III-B.
EventGraph join_events(const PixelGraph& graph);

// Both steps.
EventGraph build_event_graph(const EventView& events, ImageSize size);

}  // namespace emseg
