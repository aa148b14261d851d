#include "emseg/event_graph.hpp"

#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

namespace emseg {
namespace {

constexpr std::int32_t none = -1;

void check_input(const EventView& events, ImageSize size) {
  if (events.x.size() != events.size() || events.y.size() != events.size()) {
    throw std::invalid_argument("event columns have different lengths: x " + std::to_string(events.x.size()) +
                                ", y " + std::to_string(events.y.size()) + ", t " +
                                std::to_string(events.size()));
  }
  if (events.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw std::invalid_argument(std::to_string(events.size()) +
                                " events, expected fewer than 2^31 in one graph");
  }
  for (std::size_t k = 0; k < events.size(); ++k) {
    if (events.x[k] >= size.width || events.y[k] >= size.height) {
      throw std::invalid_argument("event " + std::to_string(k) + " lies at (" + std::to_string(events.x[k]) +
                                  ", " + std::to_string(events.y[k]) + "), outside the sensor of " +
                                  std::to_string(size.width) + "x" + std::to_string(size.height));
    }
  }
}

// Turns counts, shifted by one place, into the starts of rows.
template <typename T>
void accumulate_counts(std::vector<T>& counts) {
  std::partial_sum(counts.begin(), counts.end(), counts.begin());
}

// Positions of the events in raster order of their pixels, by two stable counting sorts: linear in the events
// and in the sides of the sensor, not in its area.
std::vector<std::int32_t> raster_order(const EventView& events, ImageSize size) {
  const std::size_t n = events.size();
  std::vector<std::int32_t> column_start(static_cast<std::size_t>(size.width) + 1);
  std::vector<std::int32_t> row_start(static_cast<std::size_t>(size.height) + 1);
  for (std::size_t k = 0; k < n; ++k) {
    ++column_start[events.x[k] + 1u];
    ++row_start[events.y[k] + 1u];
  }
  accumulate_counts(column_start);
  accumulate_counts(row_start);
  std::vector<std::int32_t> by_column(n), order(n);
  for (std::size_t k = 0; k < n; ++k) {
    by_column[column_start[events.x[k]]++] = static_cast<std::int32_t>(k);
  }
  for (const std::int32_t k : by_column) order[row_start[events.y[k]]++] = k;
  return order;
}

// The pixels with events, in raster order, and each event's position among them.
struct ActivePixels {
  std::vector<Pixel> pixels;
  std::vector<std::int32_t> pixel_of_event;
};

ActivePixels find_active_pixels(const EventView& events, ImageSize size) {
  ActivePixels active;
  active.pixel_of_event.resize(events.size());
  for (const std::int32_t k : raster_order(events, size)) {
    const Pixel pixel{events.x[k], events.y[k]};
    if (active.pixels.empty() || !(active.pixels.back() == pixel)) active.pixels.push_back(pixel);
    active.pixel_of_event[k] = static_cast<std::int32_t>(active.pixels.size()) - 1;
  }
  return active;
}

// Neighbours of every pixel in both directions, in compressed rows.
struct PixelAdjacency {
  std::vector<std::int32_t> start;  // pixels + 1; a planar graph has fewer than 6 neighbours a pixel
  std::vector<std::int32_t> neighbour;

  std::span<const std::int32_t> of(std::int32_t pixel) const {
    return {neighbour.data() + start[pixel], neighbour.data() + start[pixel + 1]};
  }
};

PixelAdjacency make_adjacency(std::size_t pixel_count, std::span<const PixelEdge> edges) {
  PixelAdjacency adjacency;
  adjacency.start.resize(pixel_count + 2);  // filled one place late, so that scattering leaves the starts
  for (const auto& [a, b] : edges) {
    ++adjacency.start[a + 2];
    ++adjacency.start[b + 2];
  }
  accumulate_counts(adjacency.start);
  adjacency.neighbour.resize(2 * edges.size());
  for (const auto& [a, b] : edges) {
    adjacency.neighbour[adjacency.start[a + 1]++] = b;
    adjacency.neighbour[adjacency.start[b + 1]++] = a;
  }
  adjacency.start.pop_back();
  return adjacency;
}

// Edges by their larger end: the smaller ends of event j's edges stand at [start[j], start[j+1]), in any
// order.
struct EdgesByLargerEnd {
  std::vector<std::int64_t> start;
  std::vector<std::int32_t> smaller_end;
};

// Plays the events in order.  When event j arrives at a pixel, its edges to earlier events are: its
// predecessor there, and at each neighbouring pixel the last event so far (j's "before"), and further back
// every event since that predecessor (j is their "after").  Each edge arises once, when its larger end
// arrives.
EdgesByLargerEnd join_events(std::span<const std::int32_t> pixel_of_event, const PixelAdjacency& adjacency) {
  const std::size_t n = pixel_of_event.size();
  EdgesByLargerEnd edges;
  edges.start.reserve(n + 1);
  edges.start.push_back(0);
  std::vector<std::int32_t> latest(adjacency.start.size() - 1, none);  // event so far, by pixel
  std::vector<std::int32_t> predecessor(n);                            // at the same pixel, by event
  for (std::size_t j = 0; j < n; ++j) {
    const std::int32_t pixel = pixel_of_event[j];
    const std::int32_t previous = latest[pixel];
    if (previous != none) edges.smaller_end.push_back(previous);
    for (const std::int32_t neighbour : adjacency.of(pixel)) {
      std::int32_t i = latest[neighbour];
      if (i == none) continue;
      do {
        edges.smaller_end.push_back(i);
        i = predecessor[i];
      } while (i > previous);
    }
    predecessor[j] = previous;
    latest[pixel] = static_cast<std::int32_t>(j);
    edges.start.push_back(static_cast<std::int64_t>(edges.smaller_end.size()));
  }
  return edges;
}

// Moves every edge into the row of its smaller end.  Larger ends are visited in order, so rows come out
// sorted.
EventGraph transpose(const EdgesByLargerEnd& edges) {
  const std::size_t n = edges.start.size() - 1;
  EventGraph graph;
  graph.indptr.resize(n + 2);  // filled one place late, as in make_adjacency
  for (const std::int32_t i : edges.smaller_end) ++graph.indptr[i + 2];
  accumulate_counts(graph.indptr);
  graph.indices.resize(edges.smaller_end.size());
  for (std::size_t j = 0; j < n; ++j) {
    for (std::int64_t e = edges.start[j]; e < edges.start[j + 1]; ++e) {
      graph.indices[graph.indptr[edges.smaller_end[e] + 1]++] = static_cast<std::int32_t>(j);
    }
  }
  graph.indptr.pop_back();
  return graph;
}

}  // namespace

EventGraph build_event_graph(const EventView& events, ImageSize size) {
  check_input(events, size);
  const ActivePixels active = find_active_pixels(events, size);
  const PixelAdjacency adjacency = make_adjacency(active.pixels.size(), delaunay_edges(active.pixels));
  return transpose(join_events(active.pixel_of_event, adjacency));
}

}  // namespace emseg
