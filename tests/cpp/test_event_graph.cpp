#include <doctest/doctest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <stdexcept>
#include <string>

#include "emseg/event_graph.hpp"

using namespace emseg;

namespace {

struct Events {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;
  std::vector<std::uint8_t> p;

  void add(int px, int py) {
    x.push_back(static_cast<std::uint16_t>(px));
    y.push_back(static_cast<std::uint16_t>(py));
    t.push_back(static_cast<std::int64_t>(t.size() / 3));  // three events share each time
    p.push_back(static_cast<std::uint8_t>(t.size() % 2));
  }
  EventView view() const { return {x, y, t, p}; }
};

using Edges = std::set<std::pair<int, int>>;

Edges edges_of(const EventGraph& graph) {
  Edges edges;
  for (std::size_t i = 0; i < graph.site_count(); ++i) {
    for (std::int64_t e = graph.indptr[i]; e < graph.indptr[i + 1]; ++e) {
      edges.emplace(static_cast<int>(i), graph.indices[e]);
    }
  }
  return edges;
}

// The definition, word for word: every event looks for its neighbours among all events.
Edges brute_force(const Events& events) {
  const int n = static_cast<int>(events.t.size());
  std::map<std::pair<int, int>, std::vector<int>> at;  // raster order, as the triangulation is asked for it
  for (int k = 0; k < n; ++k) at[{events.y[k], events.x[k]}].push_back(k);
  std::vector<Pixel> pixels;
  std::vector<const std::vector<int>*> lists;
  for (const auto& [yx, list] : at) {
    pixels.push_back({yx.second, yx.first});
    lists.push_back(&list);
  }
  std::vector<std::pair<int, int>> places;
  for (const auto& [a, b] : delaunay_edges(pixels)) {
    places.emplace_back(a, b);
    places.emplace_back(b, a);
  }
  for (int a = 0; a < static_cast<int>(pixels.size()); ++a) places.emplace_back(a, a);
  Edges edges;
  for (const auto& [here, there] : places) {
    for (const int k : *lists[here]) {
      int before = -1, after = -1;
      for (const int m : *lists[there]) {
        if (m < k) before = m;
        if (m > k && after < 0) after = m;
      }
      if (before >= 0) edges.emplace(before, k);
      if (after >= 0) edges.emplace(k, after);
    }
  }
  return edges;
}

// Rows sorted strictly, only larger ends, bounds in order: then each edge is stored once.
bool well_formed(const EventGraph& graph, std::size_t sites) {
  if (graph.indptr.size() != sites + 1 || graph.indptr.front() != 0) return false;
  if (graph.indptr.back() != static_cast<std::int64_t>(graph.edge_count())) return false;
  for (std::size_t i = 0; i < sites; ++i) {
    std::int32_t last = static_cast<std::int32_t>(i);
    if (graph.indptr[i] > graph.indptr[i + 1]) return false;
    for (std::int64_t e = graph.indptr[i]; e < graph.indptr[i + 1]; ++e) {
      if (graph.indices[e] <= last || graph.indices[e] >= static_cast<std::int32_t>(sites)) return false;
      last = graph.indices[e];
    }
  }
  return true;
}

}  // namespace

TEST_CASE("random windows agree with the definition") {
  std::mt19937 random(7);
  for (int trial = 0; trial < 150; ++trial) {
    CAPTURE(trial);
    const int width = 1 + static_cast<int>(random() % 9), height = 1 + static_cast<int>(random() % 9);
    const int count = static_cast<int>(random() % 120);
    Events events;
    for (int k = 0; k < count; ++k)
      events.add(static_cast<int>(random() % width), static_cast<int>(random() % height));
    const EventGraph graph = build_event_graph(events.view(), {width, height});
    REQUIRE(well_formed(graph, events.t.size()));
    REQUIRE(edges_of(graph) == brute_force(events));
  }
}

TEST_CASE("no event, one event") {
  const EventGraph nothing = build_event_graph({}, {240, 180});
  CHECK(nothing.site_count() == 0);
  CHECK(nothing.indptr == std::vector<std::int64_t>{0});
  CHECK(nothing.indices.empty());
  Events events;
  events.add(239, 179);
  const EventGraph one = build_event_graph(events.view(), {240, 180});
  CHECK(one.indptr == std::vector<std::int64_t>{0, 0});
  CHECK(one.indices.empty());
}

TEST_CASE("all events on one pixel form a path in time") {
  Events events;
  for (int k = 0; k < 5; ++k) events.add(3, 3);
  CHECK(edges_of(build_event_graph(events.view(), {8, 8})) == Edges{{0, 1}, {1, 2}, {2, 3}, {3, 4}});
}

TEST_CASE("two pixels: nearest before and nearest after, ties by position") {
  Events events;  // a a b b a, all at one or two times
  for (const int x : {0, 0, 1, 1, 0}) events.add(x, 0);
  // own pixel: 0-1, 1-4, 2-3; after: 0-2, 1-2, 2-4, 3-4; before: 1-2, 1-3, 3-4
  CHECK(edges_of(build_event_graph(events.view(), {2, 1})) ==
        Edges{{0, 1}, {1, 4}, {2, 3}, {0, 2}, {1, 2}, {1, 3}, {2, 4}, {3, 4}});
}

TEST_CASE("events on a line") {
  Events events;
  for (const int x : {7, 0, 3}) events.add(x, x);
  CHECK(edges_of(build_event_graph(events.view(), {8, 8})) == Edges{{0, 2}, {1, 2}});
}

TEST_CASE("the far corners of the largest sensor") {
  Events events;
  events.add(0, 0);
  events.add(65535, 65535);
  events.add(65535, 0);
  CHECK(edges_of(build_event_graph(events.view(), {65536, 65536})) == Edges{{0, 1}, {0, 2}, {1, 2}});
}

TEST_CASE("a window of sensor size is well formed and every event has its neighbours in time") {
  std::mt19937 random(11);
  Events events;
  for (int k = 0; k < 30000; ++k)
    events.add(static_cast<int>(random() % 240), static_cast<int>(random() % 180));
  const EventGraph graph = build_event_graph(events.view(), {240, 180});
  CHECK(well_formed(graph, 30000));
  std::map<std::pair<int, int>, int> latest;
  bool joined = true;
  for (int k = 0; k < 30000; ++k) {
    const std::pair pixel(int{events.x[k]}, int{events.y[k]});
    if (const auto previous = latest.find(pixel); previous != latest.end()) {
      const std::int32_t* row = graph.indices.data();
      joined = joined && std::binary_search(row + graph.indptr[previous->second],
                                            row + graph.indptr[previous->second + 1], k);
    }
    latest[pixel] = k;
  }
  CHECK(joined);
}

TEST_CASE("events off the sensor and columns of different lengths are refused by name") {
  Events events;
  events.add(1, 1);
  events.add(4, 1);
  try {
    build_event_graph(events.view(), {4, 4});
    FAIL("no error");
  } catch (const std::invalid_argument& error) {
    CHECK(std::string(error.what()).find("event 1 lies at (4, 1), outside the sensor of 4x4") == 0);
  }
  events.y.pop_back();
  CHECK_THROWS_AS(build_event_graph(events.view(), {8, 8}), std::invalid_argument);
}
