#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "emseg/model_selection.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

using Costs = std::vector<std::vector<float>>;

Costs random_costs(std::mt19937& random, std::size_t candidates, std::size_t blocks) {
  Costs costs(candidates);
  for (auto& row : costs) {
    for (std::size_t b = 0; b < blocks; ++b) row.push_back(static_cast<float>(uniform(random, 0, 100)));
  }
  return costs;
}

// The definition of the objective.
double cost_of(const Costs& costs, const std::vector<std::size_t>& chosen, double label_cost) {
  double sum = label_cost * static_cast<double>(chosen.size());
  for (std::size_t b = 0; b < costs.front().size(); ++b) {
    float least = std::numeric_limits<float>::infinity();
    for (const std::size_t m : chosen) least = std::min(least, costs[m][b]);
    sum += least;
  }
  return sum;
}

std::vector<std::size_t> members(unsigned subset, std::size_t candidates) {
  std::vector<std::size_t> chosen;
  for (std::size_t m = 0; m < candidates; ++m) {
    if (subset >> m & 1u) chosen.push_back(m);
  }
  return chosen;
}

double least_cost(const Costs& costs, double label_cost) {
  double least = std::numeric_limits<double>::infinity();
  for (unsigned subset = 1; subset < 1u << costs.size(); ++subset) {
    least = std::min(least, cost_of(costs, members(subset, costs.size()), label_cost));
  }
  return least;
}

// Whether candidates are distinct, the cost is that of its definition, and every block is with its cheapest.
bool consistent(const Selection& selection, const Costs& costs, double label_cost) {
  auto sorted = selection.chosen;
  std::sort(sorted.begin(), sorted.end());
  if (sorted.empty() || std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return false;
  if (selection.cost != doctest::Approx(cost_of(costs, selection.chosen, label_cost)).epsilon(1e-9))
    return false;
  for (std::size_t b = 0; b < selection.of_block.size(); ++b) {
    const float own = costs[selection.chosen[static_cast<std::size_t>(selection.of_block[b])]][b];
    for (const std::size_t m : selection.chosen) {
      if (costs[m][b] < own) return false;
    }
  }
  return selection.of_block.size() == costs.front().size();
}

}  // namespace

TEST_CASE("a selection is consistent, never worse than one model alone, and no single change betters it") {
  std::mt19937 random(1);
  int optimal = 0;
  constexpr int trials = 300;
  for (int trial = 0; trial < trials; ++trial) {
    CAPTURE(trial);
    const std::size_t candidates = 1 + random() % 8;
    const Costs costs = random_costs(random, candidates, 1 + random() % 12);
    const double label_cost = uniform(random, 0, 150);
    const Selection selection = select_models(costs, label_cost);
    REQUIRE(consistent(selection, costs, label_cost));
    const double tolerance = 2e-6 * selection.cost;
    REQUIRE(selection.cost >= least_cost(costs, label_cost) - tolerance);
    optimal += selection.cost <= least_cost(costs, label_cost) + tolerance;
    for (std::size_t m = 0; m < candidates; ++m)
      REQUIRE(selection.cost <= cost_of(costs, {m}, label_cost) + tolerance);
    unsigned found = 0;
    for (const std::size_t m : selection.chosen) found |= 1u << m;
    for (unsigned subset = 1; subset < 1u << candidates; ++subset) {
      // One added, one dropped, or one for another.
      const unsigned added = subset & ~found, dropped = found & ~subset;
      if ((added & (added - 1)) != 0 || (dropped & (dropped - 1)) != 0) continue;
      REQUIRE(selection.cost <= cost_of(costs, members(subset, candidates), label_cost) + tolerance);
    }
  }
  // Local search promises no optimum in general, but this small it is nearly always there.
  CHECK(optimal >= trials * 9 / 10);
}

TEST_CASE("after swaps, additions are tried again") {
  // Costs on a few levels, so that swaps are common: in one of a thousand of these an addition pays only
  // after one.
  std::mt19937 random(3);
  bool pays = false;
  for (int trial = 0; trial < 5000 && !pays; ++trial) {
    Costs costs = random_costs(random, 2 + random() % 7, 1 + random() % 12);
    for (auto& row : costs) {
      for (float& cost : row) cost = static_cast<float>(40 * (random() % 3) + random() % 5);
    }
    const double label_cost = uniform(random, 0, 150);
    const Selection selection = select_models(costs, label_cost);
    for (std::size_t m = 0; m < costs.size(); ++m) {
      auto more = selection.chosen;
      if (std::find(more.begin(), more.end(), m) != more.end()) continue;
      more.push_back(m);
      pays = pays || cost_of(costs, more, label_cost) < selection.cost * (1 - 2e-6);
    }
  }
  CHECK(!pays);
}

TEST_CASE("where theory promises the optimum, it is found") {
  std::mt19937 random(2);
  for (int trial = 0; trial < 100; ++trial) {
    const Costs costs = random_costs(random, 1 + random() % 8, 10);
    // Free labels: a candidate that is cheapest anywhere betters every choice without it.
    REQUIRE(select_models(costs, 0).cost == doctest::Approx(least_cost(costs, 0)).epsilon(1e-9));
    // Labels dearer than all data: one, the cheapest.
    const Selection one = select_models(costs, 1e6);
    REQUIRE(one.chosen.size() == 1);
    REQUIRE(one.cost == doctest::Approx(least_cost(costs, 1e6)).epsilon(1e-9));
    // Two candidates: every choice is one change away from every other.
    const Costs two{costs.front(), costs.back()};
    const double label_cost = uniform(random, 0, 200);
    REQUIRE(select_models(two, label_cost).cost ==
            doctest::Approx(least_cost(two, label_cost)).epsilon(1e-5));
  }
}

TEST_CASE("models that explain a part each, and one that half explains all") {
  Costs costs(4, std::vector<float>(30, 200.0f));
  for (std::size_t b = 0; b < 30; ++b) {
    costs[b / 10][b] = 0;
    costs[3][b] = 90;
  }
  const Selection apart = select_models(costs, 100);
  auto chosen = apart.chosen;
  std::sort(chosen.begin(), chosen.end());
  CHECK(chosen == std::vector<std::size_t>{0, 1, 2});
  CHECK(apart.cost == 300);
  CHECK(select_models(costs, 2000).chosen == std::vector<std::size_t>{3});
}

TEST_CASE("copies of a model are chosen once, even for nothing") {
  const Costs costs(3, std::vector<float>(5, 7.0f));
  CHECK(select_models(costs, 0).chosen.size() == 1);
  const Costs nothing(2, std::vector<float>(5, 0.0f));
  const Selection free = select_models(nothing, 0);
  CHECK(free.chosen.size() == 1);
  CHECK(free.cost == 0);
}

TEST_CASE("every event belongs to the block it lies in, the last ones narrower") {
  const Points points{{-2, 5.9f, 6, 13.5f, 16, 5}, {3, 3, 3, 10.9f, 11, 10.9f}, {0, 0, 0, 0, 0, 0}};
  const BlockGrid grid = make_block_grid(points.view(), {-2, 3, 19, 9}, 8);
  CHECK(grid.columns == 3);
  CHECK(grid.rows == 2);
  CHECK(grid.count() == 6);
  CHECK(grid.of_event == std::vector<std::int32_t>{0, 0, 1, 1, 5, 0});
}

TEST_CASE("the cost of a block is that of its events and half its neighbours'") {
  BlockGrid grid;
  grid.plane = {0, 0, 24, 16};
  grid.columns = 3;
  grid.rows = 2;
  grid.of_event = {0, 0, 1, 5, 4, 4, 4};
  ModelSupport support;
  support.sharpness = {0, 0.5f, 1, 0.25f, 0.1f, 2, 0.9f};
  for (const DataTerm term : {DataTerm::published, DataTerm::logarithmic}) {
    std::vector<double> own(6, 0.0);
    for (std::size_t k = 0; k < 7; ++k) {
      own[static_cast<std::size_t>(grid.of_event[k])] += 3.0 * event_cost(term, support.sharpness[k], 1.5f);
    }
    const auto costs = block_costs(grid, support, term, 1.5, 3.0);
    const auto mean = [](double centre, std::initializer_list<double> neighbours) {
      double sum = centre, weight = 1;
      for (const double cost : neighbours) sum += 0.5 * cost, weight += 0.5;
      return sum / weight;
    };
    CHECK(costs[0] == doctest::Approx(mean(own[0], {own[1], own[3]})));
    CHECK(costs[1] == doctest::Approx(mean(own[1], {own[0], own[2], own[4]})));
    CHECK(costs[2] == doctest::Approx(mean(own[2], {own[1], own[5]})));
    CHECK(costs[3] == doctest::Approx(mean(own[3], {own[0], own[4]})));
    CHECK(costs[4] == doctest::Approx(mean(own[4], {own[1], own[3], own[5]})));
    CHECK(costs[5] == doctest::Approx(mean(own[5], {own[2], own[4]})));
  }
}
