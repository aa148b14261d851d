#include <doctest/doctest.h>

#include <stdexcept>

#include "emseg/event_columns.hpp"

using namespace emseg;

TEST_CASE("events at rising positions are taken, counted from the end where negative") {
  const std::vector<std::uint16_t> x{3, 1, 4, 1, 5, 9, 2, 6, 5, 3}, y{2, 7, 1, 8, 2, 8, 1, 8, 2, 8};
  const std::vector<std::int64_t> t{0, 10, 20, 30, 40, 50, 60, 70, 80, 90};
  const std::vector<std::uint8_t> p{0, 1, 0, 1, 0, 1, 0, 1, 0, 1};
  const EventView view{x, y, t, p};
  const EventColumns taken = take_events(view, std::vector<std::int64_t>{1, 1, 4, -1});
  CHECK(taken.t == std::vector<std::int64_t>{10, 10, 40, 90});
  CHECK(taken.p == std::vector<std::uint8_t>{1, 1, 0, 1});
  CHECK(taken.x == std::vector<std::uint16_t>{1, 1, 5, 3});
  CHECK(taken.y == std::vector<std::uint16_t>{7, 7, 2, 8});
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{10}), std::out_of_range);
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{-11}), std::out_of_range);
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{4, 3}), std::invalid_argument);
}
