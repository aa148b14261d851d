#include "window_labeling.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "checked_sum.hpp"
#include "label_merging.hpp"

namespace emseg {
namespace {

[[noreturn]] void fail(const std::string& what) { throw std::invalid_argument(what); }

void check_shapes(const PixelGraph& graph, const WindowLabeling& problem) {
  if (problem.label_count() == 0) fail("the problem has no labels, expected at least 1");
  for (std::size_t l = 0; l < problem.label_count(); ++l) {
    if (problem.unary[l].size() != graph.event_count()) {
      fail("unary[" + std::to_string(l) + "] has " + std::to_string(problem.unary[l].size()) +
           " entries, expected " + std::to_string(graph.event_count()) + ", one per event");
    }
  }
  if (problem.label_cost.size() != 1 && problem.label_cost.size() != problem.label_count()) {
    fail("label_cost has " + std::to_string(problem.label_cost.size()) + " entries, expected 1 or " +
         std::to_string(problem.label_count()) + ", one per label");
  }
  if (problem.smooth_cost < 0) {
    fail("smooth_cost is " + std::to_string(problem.smooth_cost) + ", expected at least 0");
  }
  for (const std::int64_t cost : problem.label_cost) {
    if (cost < 0) fail("label_cost holds " + std::to_string(cost) + ", expected at least 0");
  }
}

// Two pixels with n and m events have fewer than 2 (n + m) edges.
std::int64_t edge_bound(const PixelGraph& graph) {
  auto bound = static_cast<std::int64_t>(graph.event_count());
  for (std::int32_t p = 0; p < graph.pixel_count(); ++p) {
    bound += 2 * static_cast<std::int64_t>(graph.events_of(p).size() * graph.neighbours_of(p).size());
  }
  return bound;
}

}  // namespace

std::int64_t check_window_labeling(const PixelGraph& graph, const WindowLabeling& problem) {
  check_shapes(graph, problem);
  std::int32_t least = 0, most = 0;
  for (const std::span<const std::int32_t> costs : problem.unary) {
    for (const std::int32_t cost : costs) {
      least = std::min(least, cost);
      most = std::max(most, cost);
    }
  }
  CheckedSum widest("the largest energy of the problem");
  widest.add_product(static_cast<std::int64_t>(graph.event_count()), std::int64_t{most} - least);
  widest.add_product(2 * edge_bound(graph), problem.smooth_cost);
  CheckedSum total = widest;
  for (std::size_t l = 0; l < problem.label_count(); ++l) total.add(problem.cost_of_label(l));
  return widest.total();
}

void check_window_labels(const PixelGraph& graph, const WindowLabeling& problem,
                         std::span<const std::int32_t> labels) {
  if (labels.size() != graph.event_count()) {
    fail("labels have " + std::to_string(labels.size()) + " entries, expected " +
         std::to_string(graph.event_count()) + ", one per event");
  }
  const auto count = static_cast<std::int32_t>(problem.label_count());
  for (std::size_t k = 0; k < labels.size(); ++k) {
    if (labels[k] < 0 || labels[k] >= count) {
      fail("labels[" + std::to_string(k) + "] is " + std::to_string(labels[k]) + ", expected 0.." +
           std::to_string(count - 1));
    }
  }
}

namespace {

// visit(a, b, n) for n edges between events of two labels, for all such edges.
template <typename Visit>
void visit_cut(const PixelGraph& graph, std::span<const std::int32_t> labels, const Visit& visit) {
  // Pixels of one label need no look at their events where they meet.
  constexpr std::int32_t mixed = -1;
  std::vector<std::int32_t> pixel_label(graph.pixels.size());
  for (std::int32_t p = 0; p < graph.pixel_count(); ++p) {
    const auto own = graph.events_of(p);
    pixel_label[p] = labels[own.front()];
    for (std::size_t i = 1; i < own.size(); ++i) {
      if (labels[own[i]] == labels[own[i - 1]]) continue;
      pixel_label[p] = mixed;
      visit(labels[own[i - 1]], labels[own[i]], 1);
    }
  }
  for (std::int32_t p = 0; p < graph.pixel_count(); ++p) {
    for (const std::int32_t q : graph.neighbours_of(p)) {
      if (q < p || (pixel_label[p] == pixel_label[q] && pixel_label[p] != mixed)) continue;
      const auto own = graph.events_of(p), other = graph.events_of(q);
      if (pixel_label[p] != mixed && pixel_label[q] != mixed) {
        visit(pixel_label[p], pixel_label[q], count_event_edges(own, other));
      } else {
        visit_event_edges(own, other, [&](std::size_t i, std::size_t j) {
          if (labels[own[i]] != labels[other[j]]) visit(labels[own[i]], labels[other[j]], 1);
        });
      }
    }
  }
}

}  // namespace

std::int64_t evaluate_window(const PixelGraph& graph, const WindowLabeling& problem,
                             std::span<const std::int32_t> labels) {
  std::int64_t cut = 0;
  visit_cut(graph, labels, [&](std::int32_t, std::int32_t, std::int32_t edges) { cut += edges; });
  std::int64_t energy = cut * problem.smooth_cost;
  std::vector<std::uint8_t> used(problem.label_count(), 0);
  for (std::size_t k = 0; k < labels.size(); ++k) {
    const auto l = static_cast<std::size_t>(labels[k]);
    used[l] = 1;
    energy += problem.unary[l][k];
  }
  for (std::size_t l = 0; l < used.size(); ++l) energy += used[l] != 0 ? problem.cost_of_label(l) : 0;
  return energy;
}

MergedLabels merge_window_labels(const PixelGraph& graph, const WindowLabeling& problem,
                                 std::span<const std::int32_t> labels) {
  const auto count = static_cast<std::int32_t>(problem.label_count());
  std::vector<std::int64_t> label_cost;
  for (std::int32_t l = 0; l < count; ++l) label_cost.push_back(problem.cost_of_label(l));
  LabelTotals totals(std::move(label_cost));
  for (const std::int32_t label : labels) totals.add_site(label);
  std::vector<std::int64_t> by_label(count);
  for (std::int32_t l = 0; l < count; ++l) {
    std::fill(by_label.begin(), by_label.end(), 0);
    for (std::size_t k = 0; k < labels.size(); ++k) by_label[labels[k]] += problem.unary[l][k];
    for (std::int32_t own = 0; own < count; ++own) totals.add_data(own, l, by_label[own]);
  }
  visit_cut(graph, labels, [&](std::int32_t a, std::int32_t b, std::int32_t edges) {
    totals.add_cut(a, b, std::int64_t{edges} * problem.smooth_cost);
  });
  MergedLabels merged{{labels.begin(), labels.end()}, totals.energy(), 0};
  const auto [becomes, gain] = totals.merge();
  merged.gain = gain;
  if (gain > 0) {
    for (std::int32_t& label : merged.labels) label = becomes[label];
  }
  return merged;
}

std::int64_t window_energy(const PixelGraph& graph, const WindowLabeling& problem,
                           std::span<const std::int32_t> labels) {
  check_window_labeling(graph, problem);
  check_window_labels(graph, problem, labels);
  return evaluate_window(graph, problem, labels);
}

}  // namespace emseg
