#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <queue>
#include <random>
#include <stdexcept>
#include <vector>

#include "../../cpp/src/local_order.hpp"
#include "emseg/max_flow.hpp"

using namespace emseg;

namespace {

struct OwnedGraph {
  std::vector<std::int32_t> tail;
  std::vector<std::int32_t> head;
  std::vector<std::int64_t> capacity;
  std::vector<std::int64_t> reverse;
  std::vector<std::int64_t> source;
  std::vector<std::int64_t> sink;

  FlowGraph view() const { return {tail, head, capacity, reverse, source, sink}; }
  void join(std::int32_t u, std::int32_t v, std::int64_t along, std::int64_t against) {
    tail.push_back(u);
    head.push_back(v);
    capacity.push_back(along);
    reverse.push_back(against);
  }
};

OwnedGraph random_graph(std::mt19937& random, int nodes, int edges, std::int64_t top, double terminals) {
  auto upto = [&random](std::int64_t most) {
    return std::uniform_int_distribution<std::int64_t>(0, most)(random);
  };
  OwnedGraph graph;
  for (int e = 0; e < edges; ++e) {
    graph.join(static_cast<std::int32_t>(upto(nodes - 1)), static_cast<std::int32_t>(upto(nodes - 1)),
               upto(top), upto(2) == 0 ? 0 : upto(top));
  }
  for (int v = 0; v < nodes; ++v) {
    graph.source.push_back(std::bernoulli_distribution(terminals)(random) ? upto(2 * top) : 0);
    graph.sink.push_back(std::bernoulli_distribution(terminals)(random) ? upto(2 * top) : 0);
  }
  return graph;
}

std::int64_t cut_value(const OwnedGraph& graph, const std::vector<std::uint8_t>& sink_side) {
  std::int64_t value = 0;
  for (std::size_t e = 0; e < graph.tail.size(); ++e) {
    const bool from = sink_side[static_cast<std::size_t>(graph.tail[e])] != 0;
    const bool to = sink_side[static_cast<std::size_t>(graph.head[e])] != 0;
    if (!from && to) value += graph.capacity[e];
    if (from && !to) value += graph.reverse[e];
  }
  for (std::size_t v = 0; v < graph.source.size(); ++v)
    value += sink_side[v] != 0 ? graph.source[v] : graph.sink[v];
  return value;
}

// Least cut over all bipartitions, and the fewest nodes on the sink's side of such a cut.
std::pair<std::int64_t, int> best_cut(const OwnedGraph& graph) {
  const std::size_t n = graph.source.size();
  std::pair<std::int64_t, int> best{std::numeric_limits<std::int64_t>::max(), 0};
  for (unsigned choice = 0; choice < (1U << n); ++choice) {
    std::vector<std::uint8_t> side(n);
    int count = 0;
    for (std::size_t v = 0; v < n; ++v) count += side[v] = (choice >> v) & 1U;
    best = std::min(best, {cut_value(graph, side), count});
  }
  return best;
}

// Edmonds and Karp on an adjacency matrix with the terminals as nodes: slow, and shares nothing with the
// library.
std::int64_t plain_max_flow(const OwnedGraph& graph) {
  const std::size_t n = graph.source.size();
  const std::size_t s = n;
  const std::size_t t = n + 1;
  std::vector<std::vector<std::int64_t>> residual(n + 2, std::vector<std::int64_t>(n + 2, 0));
  for (std::size_t e = 0; e < graph.tail.size(); ++e) {
    residual[static_cast<std::size_t>(graph.tail[e])][static_cast<std::size_t>(graph.head[e])] +=
        graph.capacity[e];
    residual[static_cast<std::size_t>(graph.head[e])][static_cast<std::size_t>(graph.tail[e])] +=
        graph.reverse[e];
  }
  for (std::size_t v = 0; v < n; ++v) {
    residual[s][v] = graph.source[v];
    residual[v][t] = graph.sink[v];
  }
  std::int64_t flow = 0;
  while (true) {
    std::vector<std::size_t> parent(n + 2, n + 2);
    std::queue<std::size_t> queue({s});
    parent[s] = s;
    while (!queue.empty() && parent[t] == n + 2) {
      const std::size_t v = queue.front();
      queue.pop();
      for (std::size_t w = 0; w < n + 2; ++w) {
        if (residual[v][w] > 0 && parent[w] == n + 2) {
          parent[w] = v;
          queue.push(w);
        }
      }
    }
    if (parent[t] == n + 2) return flow;
    std::int64_t amount = std::numeric_limits<std::int64_t>::max();
    for (std::size_t v = t; v != s; v = parent[v]) amount = std::min(amount, residual[parent[v]][v]);
    for (std::size_t v = t; v != s; v = parent[v]) {
      residual[parent[v]][v] -= amount;
      residual[v][parent[v]] += amount;
    }
    flow += amount;
  }
}

}  // namespace

TEST_CASE("flow and cut are the best of all bipartitions, with the smallest sink side") {
  std::mt19937 random(1);
  for (int trial = 0; trial < 800; ++trial) {
    const int nodes = 1 + trial % 10;
    const std::int64_t top = trial % 4 == 0 ? std::int64_t{1} << 40 : 1 + trial % 9;
    const OwnedGraph graph = random_graph(random, nodes, trial % 31, top, 0.2 + 0.2 * (trial % 4));
    const MaxFlowResult result = max_flow(graph.view());
    const auto [value, count] = best_cut(graph);
    CHECK(result.flow == value);
    CHECK(cut_value(graph, result.sink_side) == value);
    CHECK(std::count(result.sink_side.begin(), result.sink_side.end(), 1) == count);
  }
}

// Few terminals make long paths, deep forests and many orphans.
TEST_CASE("flow equals that of shortest augmenting paths on larger graphs") {
  std::mt19937 random(2);
  for (int trial = 0; trial < 60; ++trial) {
    const int nodes = 100;
    OwnedGraph graph =
        random_graph(random, nodes, 60 + 10 * (trial % 20), 1 + trial % 30, 0.03 * (1 + trial % 4));
    for (std::int32_t v = 0; v + 1 < nodes; ++v) graph.join(v, v + 1, 3, 3);
    const MaxFlowResult result = max_flow(graph.view());
    CHECK(result.flow == plain_max_flow(graph));
    CHECK(result.flow == cut_value(graph, result.sink_side));
  }
}

TEST_CASE("residuals that 32 bits cannot hold are kept in 64") {
  OwnedGraph graph;
  graph.source = {std::int64_t{1} << 31, 0, 0};
  graph.sink = {0, 0, std::int64_t{1} << 33};
  graph.join(0, 1, std::int64_t{1} << 34, std::int64_t{1} << 34);
  graph.join(1, 2, (std::int64_t{1} << 31) - 1, (std::int64_t{1} << 31) - 1);
  CHECK(max_flow(graph.view()).flow == (std::int64_t{1} << 31) - 1);
}

TEST_CASE("a long chain is carried from end to end") {
  constexpr std::int32_t kLength = 20000;
  OwnedGraph graph;
  graph.source.assign(kLength, 0);
  graph.sink.assign(kLength, 0);
  graph.source.front() = 9;
  graph.sink.back() = 8;
  for (std::int32_t v = 0; v + 1 < kLength; ++v) graph.join(v, v + 1, v == 7 ? 5 : 6, 0);
  const MaxFlowResult result = max_flow(graph.view());
  CHECK(result.flow == 5);
  CHECK(std::count(result.sink_side.begin(), result.sink_side.end(), 1) == kLength - 8);
}

TEST_CASE("bad graphs are refused") {
  OwnedGraph good;
  good.source = {4, 0};
  good.sink = {0, 4};
  good.join(0, 1, 3, 0);
  CHECK(max_flow(good.view()).flow == 3);
  CHECK(max_flow({}).flow == 0);
  auto refuses = [&good](auto spoil) {
    OwnedGraph bad = good;
    spoil(bad);
    CHECK_THROWS_AS(max_flow(bad.view()), std::invalid_argument);
  };
  refuses([](auto& g) { g.head = {2}; });
  refuses([](auto& g) { g.tail = {-1}; });
  refuses([](auto& g) { g.capacity = {-1}; });
  refuses([](auto& g) { g.reverse = {-1}; });
  refuses([](auto& g) { g.reverse.clear(); });
  refuses([](auto& g) { g.sink.push_back(1); });
  refuses([](auto& g) { g.source = {-1, 0}; });
  refuses([](auto& g) { g.source = {std::int64_t{1} << 62, 1}; });
  refuses([](auto& g) { g.reverse = g.capacity = {std::int64_t{1} << 62}; });
}

TEST_CASE("the local order is a permutation, also of loose nodes") {
  std::mt19937 random(3);
  for (const int nodes : {1, 7, 300, 2000}) {
    const OwnedGraph graph = random_graph(random, nodes, nodes, 1, 0);
    std::vector<std::int32_t> order = local_order(static_cast<std::size_t>(nodes), graph.tail, graph.head);
    std::sort(order.begin(), order.end());
    REQUIRE(order.size() == static_cast<std::size_t>(nodes));
    for (std::int32_t v = 0; v < nodes; ++v) CHECK(order[static_cast<std::size_t>(v)] == v);
  }
}
