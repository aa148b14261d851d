#include "emseg/max_flow.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>

#include "checked_sum.hpp"
#include "flow_solver.hpp"

namespace emseg {
namespace {

void check_length(const char* name, std::size_t length, std::size_t expected, const char* per) {
  if (length == expected) return;
  throw std::invalid_argument(std::string(name) + " has " + std::to_string(length) + " entries, expected " +
                              std::to_string(expected) + ", one per " + per);
}

void check_not_negative(const char* name, std::span<const std::int64_t> values) {
  const auto found = std::find_if(values.begin(), values.end(), [](std::int64_t value) { return value < 0; });
  if (found == values.end()) return;
  throw std::invalid_argument(std::string(name) + "[" + std::to_string(found - values.begin()) + "] is " +
                              std::to_string(*found) + ", expected at least 0");
}

void check_nodes(const char* name, std::span<const std::int32_t> nodes, std::int64_t node_count) {
  const auto found = std::find_if(nodes.begin(), nodes.end(),
                                  [node_count](std::int32_t v) { return v < 0 || v >= node_count; });
  if (found == nodes.end()) return;
  throw std::invalid_argument(std::string(name) + "[" + std::to_string(found - nodes.begin()) + "] is " +
                              std::to_string(*found) + ", expected a node in 0.." +
                              std::to_string(node_count - 1));
}

template <typename Capacity>
MaxFlowResult solve(const FlowGraph& graph) {
  ArcRows rows;
  rows.begin(graph.source.size());
  for (std::size_t e = 0; e < graph.tail.size(); ++e) {
    if (graph.tail[e] != graph.head[e]) rows.count_edge(graph.tail[e], graph.head[e]);
  }
  rows.allocate();
  std::vector<Residuals<Capacity>> residuals(rows.arc_count());
  for (std::size_t e = 0; e < graph.tail.size(); ++e) {
    if (graph.tail[e] == graph.head[e]) continue;
    const auto along = static_cast<Capacity>(graph.capacity[e]);
    const auto against = static_cast<Capacity>(graph.reverse[e]);
    const std::int32_t a = rows.add_edge(graph.tail[e], graph.head[e]);
    residuals[static_cast<std::size_t>(a)] = {along, against};
    residuals[static_cast<std::size_t>(rows.arc(a).sister)] = {against, along};
  }
  std::vector<Capacity> excess(graph.source.size());

  MaxFlowResult result;
  for (std::size_t v = 0; v < graph.source.size(); ++v) {
    result.flow += std::min(graph.source[v], graph.sink[v]);  // straight through the node
    excess[v] = static_cast<Capacity>(graph.source[v] - graph.sink[v]);
  }
  FlowSolver<Capacity> solver;
  solver.attach(rows, residuals, excess);
  solver.start();
  result.flow += solver.maximise();
  result.sink_side.resize(graph.source.size());
  for (std::size_t v = 0; v < graph.source.size(); ++v) result.sink_side[v] = solver.on_sink_side(v) ? 1 : 0;
  return result;
}

}  // namespace

MaxFlowResult max_flow(const FlowGraph& graph) {
  constexpr auto kMax32 = static_cast<std::int64_t>(std::numeric_limits<std::int32_t>::max());
  const std::size_t node_count = graph.source.size();
  const std::size_t edge_count = graph.tail.size();
  if (node_count >= static_cast<std::size_t>(kMax32)) {
    throw std::invalid_argument("the graph has " + std::to_string(node_count) +
                                " nodes, expected less than 2^31 - 1");
  }
  if (edge_count > static_cast<std::size_t>(kMax32 / 2)) {
    throw std::invalid_argument("the graph has " + std::to_string(edge_count) +
                                " edges, expected less than 2^30");
  }
  check_length("sink", graph.sink.size(), node_count, "node");
  check_length("head", graph.head.size(), edge_count, "edge");
  check_length("capacity", graph.capacity.size(), edge_count, "edge");
  check_length("reverse", graph.reverse.size(), edge_count, "edge");
  check_nodes("tail", graph.tail, static_cast<std::int64_t>(node_count));
  check_nodes("head", graph.head, static_cast<std::int64_t>(node_count));
  check_not_negative("capacity", graph.capacity);
  check_not_negative("reverse", graph.reverse);
  check_not_negative("source", graph.source);
  check_not_negative("sink", graph.sink);

  CheckedSum source_total("the sum of source capacities");
  CheckedSum sink_total("the sum of sink capacities");
  std::int64_t widest = 0;
  for (std::size_t v = 0; v < node_count; ++v) {
    source_total.add(graph.source[v]);
    sink_total.add(graph.sink[v]);
    widest = std::max({widest, graph.source[v], graph.sink[v]});
  }
  for (std::size_t e = 0; e < edge_count; ++e) {
    CheckedSum both("capacity + reverse of an edge");
    both.add(graph.capacity[e]);
    both.add(graph.reverse[e]);
    widest = std::max(widest, both.total());
  }
  return widest <= kMax32 ? solve<std::int32_t>(graph) : solve<std::int64_t>(graph);
}

}  // namespace emseg
