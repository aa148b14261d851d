#include <doctest/doctest.h>

#include <limits>
#include <random>
#include <stdexcept>

#include "emseg/split_apart.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

TEST_CASE("components are those of the definition: cells that a chain of neighbours joins") {
  std::mt19937 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const int rows = 1 + static_cast<int>(random() % 7), columns = 1 + static_cast<int>(random() % 7);
    std::vector<std::uint8_t> occupied(static_cast<std::size_t>(rows * columns));
    for (std::uint8_t& cell : occupied) cell = random() % 2 ? 1 : 0;
    // Every cell takes the least name around it until nothing changes.
    std::vector<int> name(occupied.size());
    for (std::size_t k = 0; k < name.size(); ++k) name[k] = static_cast<int>(k);
    for (bool changed = true; changed;) {
      changed = false;
      for (int a = 0; a < rows * columns; ++a) {
        for (int b = 0; b < rows * columns; ++b) {
          const auto from = static_cast<std::size_t>(a), to = static_cast<std::size_t>(b);
          const bool touch =
              std::abs(a / columns - b / columns) <= 1 && std::abs(a % columns - b % columns) <= 1;
          if (!occupied[from] || !occupied[to] || !touch || name[from] >= name[to]) continue;
          name[to] = name[from];
          changed = true;
        }
      }
    }
    const auto found = connected_components(occupied, columns);
    std::vector<int> number(occupied.size(), -1);  // of a name, by its first cell
    int count = 0;
    for (std::size_t k = 0; k < occupied.size(); ++k) {
      if (!occupied[k]) {
        CHECK(found[k] == -1);
        continue;
      }
      int& own = number[static_cast<std::size_t>(name[k])];
      if (own < 0) own = count++;
      CHECK(found[k] == own);
    }
  }
  CHECK(connected_components({}, 0).empty());
}

TEST_CASE("clumps are parts, largest first, and the fewest of them crumbs") {
  std::mt19937 random(2);
  std::vector<Vec2f> places;
  std::vector<std::int32_t> expected;
  const auto clump = [&](float x, int count, std::int32_t part) {
    for (int k = 0; k < count; ++k) {
      places.push_back(
          {x + static_cast<float>(uniform(random, 0, 5)), static_cast<float>(uniform(random, -9, -4))});
      expected.push_back(part);
    }
  };
  clump(-300, 60, 1);
  clump(0, 1000, 0);
  clump(300, 39, -1);  // under a twenty-fifth
  places.push_back({std::numeric_limits<float>::quiet_NaN(), 0});
  expected.push_back(-1);
  CHECK(split_apart(places, 10) == expected);
  CHECK(split_apart({}, 10).empty());
  CHECK_THROWS_AS(split_apart(places, 0), std::invalid_argument);
}

TEST_CASE("places as far out as floats go are parts too") {
  std::vector<Vec2f> places(40, Vec2f{0, 0});
  for (const float far : {1e30f, -1e30f}) places.insert(places.end(), 35, Vec2f{far, -far});
  const auto parts = split_apart(places, 4);
  CHECK(parts.front() == 0);
  CHECK(parts.back() != parts[40]);
  CHECK(parts.back() > 0);
}

TEST_CASE("positions of values") {
  const std::vector<std::int32_t> values{2, -1, 0, 2, 3};
  const auto positions = positions_of_values(values, 3);
  CHECK(positions == std::vector<std::vector<std::int64_t>>{{2}, {}, {0, 3}});
  CHECK(positions_of_values(values, 0).empty());
}
