#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "emseg/band_expansion.hpp"
#include "label_merging.hpp"
#include "synthetic_events.hpp"
#include "window_labeling.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

struct OwnedWindow {
  ImageSize size;
  PixelGraph graph;
  std::vector<std::vector<std::int32_t>> unary;  // per label
  std::int32_t smooth_cost = 0;
  std::vector<std::int64_t> label_cost;

  std::size_t event_count() const { return graph.event_count(); }
  std::int32_t label_count() const { return static_cast<std::int32_t>(unary.size()); }
};

// Spans of its costs live as long as it does.
class View {
 public:
  explicit View(const OwnedWindow& window)
      : spans_(window.unary.begin(), window.unary.end()),
        problem_{spans_, window.smooth_cost, window.label_cost} {}
  operator const WindowLabeling&() const { return problem_; }

 private:
  std::vector<std::span<const std::int32_t>> spans_;
  WindowLabeling problem_;
};

// The same problem for `expansion`, on the event graph.
struct OnEvents {
  EventGraph graph;
  std::vector<std::int32_t> unary;
  LabelingProblem problem;

  explicit OnEvents(const OwnedWindow& window) : graph(join_events(window.graph)) {
    for (std::size_t k = 0; k < window.event_count(); ++k) {
      for (const auto& costs : window.unary) unary.push_back(costs[k]);
    }
    problem = {window.label_count(), unary, graph.indptr, graph.indices, {&window.smooth_cost, 1},
               window.label_cost};
  }
};

PixelGraph graph_of(const RecordedEvents& events, ImageSize size) {
  return build_pixel_graph(events.view(), size);
}

OwnedWindow random_window(std::mt19937& random) {
  OwnedWindow window;
  const auto upto = [&random](std::uint32_t most) { return static_cast<int>(random() % (most + 1)); };
  window.size = {1 + upto(19), 1 + upto(19)};
  RecordedEvents events;
  for (int k = upto(200); k >= 0; --k)
    events.add(upto(window.size.width - 1), upto(window.size.height - 1), 0);
  window.graph = graph_of(events, window.size);
  const int labels = 1 + upto(4);
  window.unary.resize(labels);
  for (auto& costs : window.unary) {
    for (std::size_t k = 0; k < events.size(); ++k) costs.push_back(upto(255) - 60);
    window.label_cost.push_back(upto(900));
  }
  window.smooth_cost = upto(40);
  return window;
}

std::vector<std::int32_t> random_labels(std::mt19937& random, const OwnedWindow& window) {
  std::vector<std::int32_t> labels(window.event_count());
  for (auto& label : labels) label = static_cast<std::int32_t>(random() % window.unary.size());
  return labels;
}

// A scene of discs on a ground, every region with a label of its own; costs are noisy, and labels beyond the
// regions' fit nowhere in particular.
struct Disc {
  double x, y, radius;
};

OwnedWindow scene(const std::vector<Disc>& discs, int events, ImageSize size, int labels, std::uint32_t seed,
                  std::vector<std::int32_t>& truth) {
  std::mt19937 random(seed);
  RecordedEvents columns;
  for (int k = 0; k < events; ++k) {
    // Contours: events crowd along wavy lines, as those of textures do.
    double x = uniform(random, 0, size.width - 1);
    double y = uniform(random, 0, size.height - 1);
    if (random() % 8 != 0)
      y = std::min(size.height - 1.0, 9 * std::floor(y / 9) + 3 * (1 + std::sin(0.11 * x)));
    std::int32_t label = 0;
    for (std::size_t d = 0; d < discs.size(); ++d) {
      if (std::hypot(x - discs[d].x, y - discs[d].y) < discs[d].radius)
        label = static_cast<std::int32_t>(d) + 1;
    }
    columns.add(static_cast<int>(x), static_cast<int>(y), k, 1, label);
  }
  truth = columns.source;
  OwnedWindow window;
  window.size = size;
  window.graph = graph_of(columns, size);
  for (std::int32_t l = 0; l < labels; ++l) {
    std::vector<std::int32_t> costs;
    for (const std::int32_t own : truth) {
      costs.push_back(
          static_cast<std::int32_t>(own == l ? uniform(random, 0, 200) : uniform(random, 60, 255)));
    }
    window.unary.push_back(std::move(costs));
  }
  window.smooth_cost = 30;
  window.label_cost.assign(labels, events / 5);
  return window;
}

// Every label in the place of every other, the best one first, by the energies of whole labellings.  What
// that adds to the data costs is at least nothing, and at most two of the label's own cost.
std::vector<std::int32_t> merged_by_definition(const OwnedWindow& window, std::vector<std::int32_t> labels) {
  const OnEvents on_events(window);
  const auto data_cost = [&](const std::vector<std::int32_t>& of_events) {
    std::int64_t sum = 0;
    for (std::size_t k = 0; k < of_events.size(); ++k)
      sum += window.unary[static_cast<std::size_t>(of_events[k])][k];
    return sum;
  };
  const auto price = [&](std::int32_t label) {
    return window.label_cost[window.label_cost.size() == 1 ? 0 : static_cast<std::size_t>(label)];
  };
  while (true) {
    std::vector<std::int32_t> best = labels;
    std::int64_t least = labeling_energy(on_events.problem, labels);
    for (std::int32_t from = 0; from < window.label_count(); ++from) {
      for (std::int32_t to = 0; to < window.label_count(); ++to) {
        std::vector<std::int32_t> trial = labels;
        std::replace(trial.begin(), trial.end(), from, to);
        const std::int64_t energy = labeling_energy(on_events.problem, trial);
        const std::int64_t loss = data_cost(trial) - data_cost(labels);
        if (loss < 0 || loss > 2 * price(from)) continue;
        if (energy < least) best = trial, least = energy;
      }
    }
    if (best == labels) return labels;
    labels = best;
  }
}

double share_of_different(const std::vector<std::int32_t>& a, const std::vector<std::int32_t>& b) {
  int different = 0;
  for (std::size_t k = 0; k < a.size(); ++k) different += a[k] != b[k] ? 1 : 0;
  return static_cast<double>(different) / static_cast<double>(a.size());
}

}  // namespace

TEST_CASE("the energy of a window is that of its event graph") {
  std::mt19937 random(5);
  for (int trial = 0; trial < 300; ++trial) {
    const OwnedWindow window = random_window(random);
    const auto labels = random_labels(random, window);
    REQUIRE(window_energy(window.graph, View(window), labels) ==
            labeling_energy(OnEvents(window).problem, labels));
  }
}

TEST_CASE("labels are merged whole as by trying all, on windows and on event graphs") {
  std::mt19937 random(8);
  int merged = 0, to_unused = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    OwnedWindow window = random_window(random);
    if (trial % 2 == 0) window.label_cost.assign(1, 900);
    auto labels = random_labels(random, window);
    if (trial % 3 == 0) std::replace(labels.begin(), labels.end(), window.label_count() - 1, 0);
    const auto expected = merged_by_definition(window, labels);
    const OnEvents on_events(window);
    const std::int64_t before = labeling_energy(on_events.problem, labels);
    const std::int64_t gain = before - labeling_energy(on_events.problem, expected);

    const MergedLabels of_window = merge_window_labels(window.graph, View(window), labels);
    REQUIRE(of_window.labels == expected);
    REQUIRE(of_window.energy == before);
    REQUIRE(of_window.gain == gain);

    auto of_events = labels;
    REQUIRE(merge_labels(on_events.problem, of_events) == gain);
    REQUIRE(of_events == expected);
    merged += gain > 0 ? 1 : 0;
    to_unused += std::any_of(expected.begin(), expected.end(), [&](std::int32_t label) {
      return std::find(labels.begin(), labels.end(), label) == labels.end();
    });
  }
  CHECK(merged > 100);
  CHECK(to_unused > 10);
}

TEST_CASE("a band over the whole window gives expansion's labels") {
  std::mt19937 random(6);
  ExpansionWorkspace workspace;
  int moved = 0;
  for (int trial = 0; trial < 400; ++trial) {
    OwnedWindow window = random_window(random);
    for (std::int64_t& cost : window.label_cost) cost %= 50;
    // A third at random, the others cheap, so that labels are not all merged.
    auto initial = random_labels(random, window);
    for (std::size_t k = 0; k < initial.size(); ++k) {
      for (std::int32_t l = 0; k % 3 != 0 && l < window.label_count(); ++l) {
        const auto& costs = window.unary;
        if (costs[static_cast<std::size_t>(l)][k] < costs[static_cast<std::size_t>(initial[k])][k])
          initial[k] = l;
      }
    }
    for (std::size_t l = 0; l < window.unary.size(); ++l)
      initial[l % initial.size()] = static_cast<std::int32_t>(l);
    if (window.event_count() < window.unary.size()) continue;
    const OnEvents exact(window);
    const auto start = merged_by_definition(window, initial);
    bool all_used = true;  // no block needs to bring a label back
    for (std::int32_t l = 0; l < window.label_count(); ++l)
      all_used = all_used && std::find(start.begin(), start.end(), l) != start.end();
    if (!all_used) continue;
    const ExpansionResult expected = expansion(exact.problem, start, {.max_sweeps = 2});
    BandExpansion band(window.graph, workspace, {.hops = 1000, .max_sweeps = 2});
    const ExpansionResult found = band.minimise(View(window), initial);
    if (window.unary.size() > 1) REQUIRE(found.labels == expected.labels);
    REQUIRE(found.energy == window_energy(window.graph, View(window), found.labels));
    moved += found.labels != initial ? 1 : 0;
  }
  CHECK(moved > 100);
}

TEST_CASE("energies are those of the labels, and never above the initial ones") {
  std::mt19937 random(7);
  ExpansionWorkspace workspace;
  for (int trial = 0; trial < 300; ++trial) {
    OwnedWindow window = random_window(random);
    if (trial % 10 == 0) {  // beyond 32 bits
      window.smooth_cost *= 10'000'000;
      for (auto& costs : window.unary)
        for (auto& cost : costs) cost *= 8'000'000;
    }
    const View problem(window);
    BandExpansion band(window.graph, workspace, {.block_side = 1 + trial % 5, .hops = 1 + trial % 3});
    const ExpansionResult cold = band.minimise(problem);
    REQUIRE(cold.energy == window_energy(window.graph, problem, cold.labels));
    const auto initial = random_labels(random, window);
    const ExpansionResult warm = band.minimise(problem, initial);
    REQUIRE(warm.energy == window_energy(window.graph, problem, warm.labels));
    REQUIRE(warm.energy_trace.front() == window_energy(window.graph, problem, initial));
    REQUIRE(warm.energy <= warm.energy_trace.front());
  }
}

TEST_CASE("on made scenes energy and labels are those of expansion on all events, nearly") {
  ExpansionWorkspace workspace;
  const std::vector<std::vector<Disc>> scenes{
      {{60, 60, 30}},
      {{40, 50, 18}, {120, 90, 35}, {130, 30, 12}},
      {{30, 30, 8}, {90, 30, 9}, {150, 30, 10}, {60, 90, 11}},  // small ones
  };
  for (std::size_t s = 0; s < scenes.size(); ++s) {
    CAPTURE(s);
    std::vector<std::int32_t> truth;
    const OwnedWindow window = scene(scenes[s], 12000, {180, 130}, 8, static_cast<std::uint32_t>(s), truth);
    const View problem(window);
    const OnEvents on_events(window);
    const ExpansionResult exact = expansion(on_events.problem);
    BandExpansion band(window.graph, workspace);
    const ExpansionResult cold = band.minimise(problem);
    const auto gap = [&](std::int64_t energy) {
      return static_cast<double>(energy - exact.energy) / static_cast<double>(exact.energy);
    };
    CHECK(gap(cold.energy) < 2e-4);
    CHECK(share_of_different(cold.labels, exact.labels) < 2e-3);
    CHECK(share_of_different(exact.labels, truth) < 0.05);  // the scene can be told apart

    // From labels that are off by a few pixels and miss an object.
    std::vector<std::int32_t> initial;
    for (std::size_t k = 0; k < truth.size(); ++k) {
      const Pixel pixel = window.graph.pixels[window.graph.pixel_of_event[k]];
      std::int32_t label = 0;
      for (std::size_t d = 0; d + 1 < scenes[s].size(); ++d) {
        if (std::hypot(pixel.x - 4 - scenes[s][d].x, pixel.y - scenes[s][d].y) < scenes[s][d].radius) {
          label = static_cast<std::int32_t>(d) + 1;
        }
      }
      initial.push_back(label);
    }
    const ExpansionResult warm = band.minimise(problem, initial);
    CHECK(gap(warm.energy) < 2e-4);
    CHECK(share_of_different(warm.labels, exact.labels) < 2e-3);
  }
}

TEST_CASE("a label that does not pay for itself goes, wherever its events are") {
  std::vector<std::int32_t> truth;
  OwnedWindow window = scene({{60, 60, 25}, {110, 30, 6}}, 8000, {160, 120}, 3, 4, truth);
  ExpansionWorkspace workspace;
  BandExpansion band(window.graph, workspace);
  window.label_cost = {0, 0, 1'000'000};
  const ExpansionResult cold = band.minimise(View(window));
  CHECK(std::count(cold.labels.begin(), cold.labels.end(), 2) == 0);
  const ExpansionResult warm = band.minimise(View(window), truth);
  CHECK(std::count(warm.labels.begin(), warm.labels.end(), 2) == 0);
  CHECK(std::count(warm.labels.begin(), warm.labels.end(), 1) > 0);
}

TEST_CASE("windows without events and with one") {
  OwnedWindow window;
  window.graph = build_pixel_graph({}, {8, 8});
  window.unary = {{}, {}};
  window.label_cost = {5};
  ExpansionWorkspace workspace;
  CHECK(BandExpansion(window.graph, workspace).minimise(View(window)).labels.empty());
  CHECK(BandExpansion(window.graph, workspace).minimise(View(window)).energy == 0);
  RecordedEvents events;
  events.add(3, 4, 0);
  window.graph = graph_of(events, {8, 8});
  window.unary = {{9}, {2}};
  const ExpansionResult one = BandExpansion(window.graph, workspace).minimise(View(window));
  CHECK(one.labels == std::vector<std::int32_t>{1});
  CHECK(one.energy == 7);
}

TEST_CASE("bad problems are refused") {
  OwnedWindow good;
  RecordedEvents events;
  for (int k = 0; k < 6; ++k) events.add(k % 3, k / 3, k);
  good.graph = graph_of(events, {8, 8});
  good.unary.assign(2, std::vector<std::int32_t>(6, 1));
  good.label_cost = {1, 2};
  good.smooth_cost = 3;
  ExpansionWorkspace workspace;
  CHECK_NOTHROW(BandExpansion(good.graph, workspace).minimise(View(good)));
  const auto refuses = [&](auto spoil) {
    OwnedWindow bad = good;
    spoil(bad);
    const std::vector<std::int32_t> zeros(6, 0);
    CHECK_THROWS_AS(BandExpansion(bad.graph, workspace).minimise(View(bad)), std::invalid_argument);
    CHECK_THROWS_AS(window_energy(bad.graph, View(bad), zeros), std::invalid_argument);
  };
  refuses([](auto& w) { w.unary.clear(); });
  refuses([](auto& w) { w.unary[1].pop_back(); });
  refuses([](auto& w) { w.label_cost = {1, 2, 3}; });
  refuses([](auto& w) { w.label_cost = {1, -2}; });
  refuses([](auto& w) { w.smooth_cost = -1; });
  refuses([](auto& w) { w.label_cost = {std::int64_t{1} << 61, std::int64_t{1} << 62}; });
  BandExpansion band(good.graph, workspace);
  CHECK_THROWS_AS(band.minimise(View(good), std::vector<std::int32_t>(5, 0)), std::invalid_argument);
  CHECK_THROWS_AS(band.minimise(View(good), std::vector<std::int32_t>(6, 2)), std::invalid_argument);
  for (const BandOptions& options :
       {BandOptions{.block_side = 0}, BandOptions{.hops = 0}, BandOptions{.max_sweeps = -1},
        BandOptions{.max_bands = -1}, BandOptions{.lenient_smoothness = -0.5}}) {
    CHECK_THROWS_AS(BandExpansion(good.graph, workspace, options), std::invalid_argument);
  }
}
