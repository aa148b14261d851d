#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "emseg/model_selection.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

using Costs = std::vector<std::vector<std::int32_t>>;
using LabelCosts = std::vector<std::int64_t>;

std::int32_t whole(std::mt19937& random, int below) {
  return static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(below));
}

Costs random_costs(std::mt19937& random, std::size_t candidates, std::size_t blocks) {
  Costs costs(candidates);
  for (auto& row : costs) {
    for (std::size_t b = 0; b < blocks; ++b) row.push_back(whole(random, 10'000));
  }
  return costs;
}

// All the same, or each its own.
LabelCosts random_label_costs(std::mt19937& random, std::size_t candidates, int below) {
  LabelCosts label_costs(candidates, whole(random, below));
  if (random() % 2) {
    for (std::int64_t& cost : label_costs) cost = whole(random, below);
  }
  return label_costs;
}

// The definition of the objective.
std::int64_t cost_of(const Costs& costs, const std::vector<std::size_t>& chosen,
                     const LabelCosts& label_costs) {
  std::int64_t sum = 0;
  for (const std::size_t m : chosen) sum += label_costs[m];
  for (std::size_t b = 0; b < costs.front().size(); ++b) {
    std::int32_t least = std::numeric_limits<std::int32_t>::max();
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

std::int64_t least_cost(const Costs& costs, const LabelCosts& label_costs) {
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  for (unsigned subset = 1; subset < 1u << costs.size(); ++subset) {
    least = std::min(least, cost_of(costs, members(subset, costs.size()), label_costs));
  }
  return least;
}

// Whether candidates are distinct, the cost is that of its definition, and every block is with its cheapest.
bool consistent(const Selection& selection, const Costs& costs, const LabelCosts& label_costs) {
  auto sorted = selection.chosen;
  std::sort(sorted.begin(), sorted.end());
  if (sorted.empty() || std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) return false;
  if (selection.cost != cost_of(costs, selection.chosen, label_costs)) return false;
  for (std::size_t b = 0; b < selection.of_block.size(); ++b) {
    const std::int32_t own = costs[selection.chosen[static_cast<std::size_t>(selection.of_block[b])]][b];
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
    const LabelCosts label_costs = random_label_costs(random, candidates, 15'000);
    const Selection selection = select_models(costs, label_costs);
    REQUIRE(consistent(selection, costs, label_costs));
    REQUIRE(selection.cost >= least_cost(costs, label_costs));
    optimal += selection.cost == least_cost(costs, label_costs);
    for (std::size_t m = 0; m < candidates; ++m) REQUIRE(selection.cost <= cost_of(costs, {m}, label_costs));
    unsigned found = 0;
    for (const std::size_t m : selection.chosen) found |= 1u << m;
    for (unsigned subset = 1; subset < 1u << candidates; ++subset) {
      // One added, one dropped, or one for another.
      const unsigned added = subset & ~found, dropped = found & ~subset;
      if ((added & (added - 1)) != 0 || (dropped & (dropped - 1)) != 0) continue;
      REQUIRE(selection.cost <= cost_of(costs, members(subset, candidates), label_costs));
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
      for (std::int32_t& cost : row) cost = 40 * whole(random, 3) + whole(random, 5);
    }
    const LabelCosts label_costs = random_label_costs(random, costs.size(), 150);
    const Selection selection = select_models(costs, label_costs);
    for (std::size_t m = 0; m < costs.size(); ++m) {
      auto more = selection.chosen;
      if (std::find(more.begin(), more.end(), m) != more.end()) continue;
      more.push_back(m);
      pays = pays || cost_of(costs, more, label_costs) < selection.cost;
    }
  }
  CHECK(!pays);
}

TEST_CASE("where theory promises the optimum, it is found") {
  std::mt19937 random(2);
  for (int trial = 0; trial < 100; ++trial) {
    const Costs costs = random_costs(random, 1 + random() % 8, 10);
    // Free labels: a candidate that is cheapest anywhere betters every choice without it.
    const LabelCosts free(costs.size(), 0);
    REQUIRE(select_models(costs, free).cost == least_cost(costs, free));
    // Labels dearer than all data: one, the cheapest.
    LabelCosts dear = random_label_costs(random, costs.size(), 100'000);
    for (std::int64_t& cost : dear) cost += 1'000'000;
    const Selection one = select_models(costs, dear);
    REQUIRE(one.chosen.size() == 1);
    REQUIRE(one.cost == least_cost(costs, dear));
    // Two candidates: every choice is one change away from every other.
    const Costs two{costs.front(), costs.back()};
    const LabelCosts label_costs = random_label_costs(random, 2, 20'000);
    REQUIRE(select_models(two, label_costs).cost == least_cost(two, label_costs));
  }
}

TEST_CASE("models that explain a part each, and one that half explains all") {
  Costs costs(4, std::vector<std::int32_t>(30, 200));
  for (std::size_t b = 0; b < 30; ++b) {
    costs[b / 10][b] = 0;
    costs[3][b] = 90;
  }
  const Selection apart = select_models(costs, LabelCosts(4, 100));
  auto chosen = apart.chosen;
  std::sort(chosen.begin(), chosen.end());
  CHECK(chosen == std::vector<std::size_t>{0, 1, 2});
  CHECK(apart.cost == 300);
  CHECK(select_models(costs, LabelCosts(4, 2000)).chosen == std::vector<std::size_t>{3});
  // One that is half the price pays where the others do not.
  const Selection mixed = select_models(costs, LabelCosts{2000, 600, 2000, 2000});
  chosen = mixed.chosen;
  std::sort(chosen.begin(), chosen.end());
  CHECK(chosen == std::vector<std::size_t>{1, 3});
  CHECK(mixed.cost == 2600 + 20 * 90);
}

TEST_CASE("copies of a model are chosen once, even for nothing") {
  const Costs costs(3, std::vector<std::int32_t>(5, 7));
  CHECK(select_models(costs, LabelCosts(3, 0)).chosen.size() == 1);
  CHECK(select_models(costs, LabelCosts{3, 2, 3}).chosen == std::vector<std::size_t>{1});
  const Costs nothing(2, std::vector<std::int32_t>(5, 0));
  const Selection free = select_models(nothing, LabelCosts(2, 0));
  CHECK(free.chosen.size() == 1);
  CHECK(free.cost == 0);
}

TEST_CASE("sums as large as 32 bits hold, and label costs far beyond") {
  // Each candidate's costs add up to one less than 2^31, its smallest the other's largest.
  constexpr std::int32_t much = std::numeric_limits<std::int32_t>::max() - 10;
  const Costs costs{{much, 10}, {10, much}};
  for (const std::int64_t label_cost : {std::int64_t{0}, std::int64_t{1'000'000'000'000'000}}) {
    const LabelCosts label_costs(2, label_cost);
    const Selection selection = select_models(costs, label_costs);
    CHECK(consistent(selection, costs, label_costs));
    CHECK(selection.cost == (label_cost == 0 ? 20 : label_cost + much + 10));
  }
}

TEST_CASE("every event belongs to the block it lies in, the last ones narrower") {
  const Points points{{-2, 5.9f, 6, 13.5f, 16, 5}, {3, 3, 3, 10.9f, 11, 10.9f}, {0, 0, 0, 0, 0, 0}};
  const BlockGrid grid = make_block_grid(points.view(), {-2, 3, 19, 9}, 8);
  CHECK(grid.columns == 3);
  CHECK(grid.rows == 2);
  CHECK(grid.count() == 6);
  CHECK(grid.of_event == std::vector<std::int32_t>{0, 0, 1, 1, 5, 0});
  CHECK(grid.event_count == std::vector<std::int32_t>{3, 2, 0, 0, 0, 1});
}

TEST_CASE("the cost of a block is that of its events and half its neighbours', rounded down") {
  std::mt19937 random(4);
  std::vector<std::uint8_t> cost_of(301);
  for (std::uint8_t& cost : cost_of) cost = static_cast<std::uint8_t>(random() % 256);
  for (const auto& [columns, rows] : {std::pair{1, 1}, {1, 4}, {5, 1}, {3, 2}, {7, 6}}) {
    BlockGrid grid;
    grid.plane = {0, 0, 8 * columns, 8 * rows};
    grid.columns = columns;
    grid.rows = rows;
    std::vector<std::uint16_t> sharpness;
    grid.event_count.assign(grid.count(), 0);
    std::vector<std::int32_t> own(grid.count(), 0);
    // Without doubts, or with some for every event of a block.
    std::vector<std::int32_t> doubts;
    for (std::size_t b = 0; columns != 3 && b < grid.count(); ++b) doubts.push_back(whole(random, 60));
    for (int k = 0; k < 200; ++k) {
      grid.of_event.push_back(whole(random, columns * rows));
      sharpness.push_back(static_cast<std::uint16_t>(random() % cost_of.size()));
      const auto block = static_cast<std::size_t>(grid.of_event.back());
      ++grid.event_count[block];
      own[block] += cost_of[sharpness.back()] + (doubts.empty() ? 0 : doubts[block]);
    }
    const auto costs = block_costs(grid, sharpness, cost_of, doubts);
    REQUIRE(costs.size() == grid.count());
    for (int block = 0; block < columns * rows; ++block) {
      double sum = 0, weight = 0;
      for (int other = 0; other < columns * rows; ++other) {
        const int apart =
            std::abs(block % columns - other % columns) + std::abs(block / columns - other / columns);
        if (apart > 1) continue;
        const double share = apart == 0 ? 1 : 0.5;
        sum += share * own[static_cast<std::size_t>(other)];
        weight += share;
      }
      REQUIRE(costs[static_cast<std::size_t>(block)] == std::floor(sum / weight));
    }
  }
}
