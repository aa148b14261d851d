#include "emseg/event_graph.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <memory>
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

// Fills in the pixels and their events.
void find_active_pixels(const EventView& events, ImageSize size, PixelGraph& graph) {
  graph.pixel_of_event.resize(events.size());
  graph.events = raster_order(events, size);
  for (std::size_t place = 0; place < graph.events.size(); ++place) {
    const std::int32_t k = graph.events[place];
    const Pixel pixel{events.x[k], events.y[k]};
    if (graph.pixels.empty() || !(graph.pixels.back() == pixel)) {
      graph.pixels.push_back(pixel);
      graph.event_start.push_back(static_cast<std::int32_t>(place));
    }
    graph.pixel_of_event[k] = graph.pixel_count() - 1;
  }
  graph.event_start.push_back(static_cast<std::int32_t>(events.size()));
}

// Fills in the neighbours.
void add_neighbours(std::span<const PixelEdge> edges, PixelGraph& graph) {
  std::vector<std::int32_t>& start = graph.neighbour_start;
  start.resize(graph.pixels.size() + 2);  // filled one place late, so that scattering leaves the starts
  for (const auto& [a, b] : edges) {
    ++start[a + 2];
    ++start[b + 2];
  }
  accumulate_counts(start);
  graph.neighbours.resize(2 * edges.size());
  for (const auto& [a, b] : edges) {
    graph.neighbours[start[a + 1]++] = b;
    graph.neighbours[start[b + 1]++] = a;
  }
  start.pop_back();
}

// Edges by their larger end: the smaller ends of event j's edges stand at [start[j], start[j+1]), in any
// order.
struct EdgesByLargerEnd {
  std::vector<std::int64_t> start;
  std::unique_ptr<std::int32_t[]> smaller_end;
};

// The last four events of a pixel, latest first.
using Latest = std::array<std::int32_t, 4>;

// Plays the events in order.  When event j arrives at a pixel, its edges to earlier events are: its
// predecessor there, and at each neighbouring pixel the last event so far (j's "before"), and further back
// every event since that predecessor (j is their "after").  Each edge arises once, when its larger end
// arrives.
EdgesByLargerEnd play_events(const PixelGraph& graph) {
  const std::span<const std::int32_t> pixel_of_event = graph.pixel_of_event;
  const std::size_t n = pixel_of_event.size();
  std::int64_t most_edges = static_cast<std::int64_t>(n);  // to predecessors, and two per neighbouring pixel
  for (const std::int32_t pixel : pixel_of_event) {
    most_edges += 2 * static_cast<std::int64_t>(graph.neighbours_of(pixel).size());
  }
  EdgesByLargerEnd edges;
  edges.start.resize(n + 1);
  edges.smaller_end =
      std::make_unique_for_overwrite<std::int32_t[]>(static_cast<std::size_t>(most_edges) + Latest{}.size());
  std::vector<Latest> latest_of_pixel(graph.pixels.size(), Latest{none, none, none, none});
  std::vector<std::int32_t> predecessor(n);  // at the same pixel, by event
  std::int32_t* end = edges.smaller_end.get();
  for (std::size_t j = 0; j < n; ++j) {
    Latest& here = latest_of_pixel[pixel_of_event[j]];
    const std::int32_t previous = here[0];
    *end = previous;
    end += previous != none;
    for (const std::int32_t neighbour : graph.neighbours_of(pixel_of_event[j])) {
      // How many events lie since `previous` cannot be predicted, so four are copied and the right ones kept.
      const Latest there = latest_of_pixel[neighbour];
      std::copy(there.begin(), there.end(), end);
      end += (there[0] != none) + (there[1] > previous) + (there[2] > previous) + (there[3] > previous);
      if (there[3] > previous) {
        for (std::int32_t i = predecessor[there[3]]; i > previous; i = predecessor[i]) *end++ = i;
      }
    }
    predecessor[j] = previous;
    here = {static_cast<std::int32_t>(j), here[0], here[1], here[2]};
    edges.start[j + 1] = end - edges.smaller_end.get();
  }
  return edges;
}

// Moves every edge into the row of its smaller end.  Larger ends are visited in order, so rows come out
// sorted.
EventGraph transpose(const EdgesByLargerEnd& edges) {
  const std::size_t n = edges.start.size() - 1;
  const std::int64_t edge_count = edges.start[n];
  EventGraph graph;
  graph.indptr.resize(n + 2);  // filled one place late, as in add_neighbours
  for (std::int64_t e = 0; e < edge_count; ++e) ++graph.indptr[edges.smaller_end[e] + 2];
  accumulate_counts(graph.indptr);
  graph.indices.resize(static_cast<std::size_t>(edge_count));
  for (std::size_t j = 0; j < n; ++j) {
    for (std::int64_t e = edges.start[j]; e < edges.start[j + 1]; ++e) {
      graph.indices[graph.indptr[edges.smaller_end[e] + 1]++] = static_cast<std::int32_t>(j);
    }
  }
  graph.indptr.pop_back();
  return graph;
}

}  // namespace

PixelGraph build_pixel_graph(const EventView& events, ImageSize size) {
  check_input(events, size);
  PixelGraph graph;
  find_active_pixels(events, size, graph);
  add_neighbours(delaunay_edges(graph.pixels), graph);
  return graph;
}

EventGraph join_events(const PixelGraph& graph) { return transpose(play_events(graph)); }

EventGraph build_event_graph(const EventView& events, ImageSize size) {
  return join_events(build_pixel_graph(events, size));
}

}  // namespace emseg
