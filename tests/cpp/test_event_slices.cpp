#include <doctest/doctest.h>

#include <limits>
#include <stdexcept>
#include <vector>

#include "emseg/event_slices.hpp"

using namespace emseg;

namespace {

struct Events {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;
  std::vector<std::uint8_t> p;

  void add(int px, int py, std::int64_t time, int polarity) {
    x.push_back(static_cast<std::uint16_t>(px));
    y.push_back(static_cast<std::uint16_t>(py));
    t.push_back(time);
    p.push_back(static_cast<std::uint8_t>(polarity));
  }
  EventView view() const { return {x, y, t, p}; }
};

}  // namespace

TEST_CASE("counts, mean time and saturation of a slice by hand") {
  Events events;
  events.add(1, 0, 99, 1);   // before the slice of 100 .. 199
  events.add(1, 0, 100, 1);  // its first instant belongs to it
  events.add(1, 0, 150, 0);
  for (int k = 0; k < 6; ++k) events.add(2, 1, 175, 1);
  events.add(0, 1, 200, 0);  // its last does not
  const std::vector<std::int64_t> times = {150};
  const std::vector<std::uint8_t> image = event_slices(events.view(), {3, 2}, times, {100, 1});
  const std::vector<std::uint8_t> rises = {0, 50, 0, 0, 0, 255};
  const std::vector<std::uint8_t> mean_times = {0, 64, 0, 0, 0, 191};  // 255/4 and 255·3/4, rounded
  const std::vector<std::uint8_t> falls = {0, 50, 0, 0, 0, 0};
  std::vector<std::uint8_t> expected = rises;
  expected.insert(expected.end(), mean_times.begin(), mean_times.end());
  expected.insert(expected.end(), falls.begin(), falls.end());
  CHECK(image == expected);
}

TEST_CASE("pixels taken together add up; what fills no pixel is left out") {
  Events events;
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 5; ++x) events.add(x, y, 10, 1);
  }
  const std::vector<std::int64_t> times = {10, 10};
  const std::vector<std::uint8_t> images = event_slices(events.view(), {5, 5}, times, {20, 2});
  REQUIRE(images.size() == 2 * 3 * 2 * 2);
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(images[k] == 200);
    CHECK(images[4 + k] == 128);  // in the middle of the slice
    CHECK(images[8 + k] == 0);
    CHECK(images[12 + k] == 200);
  }
}

TEST_CASE("times at the ends of the range, and no events at all") {
  Events events;
  constexpr std::int64_t least = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t most = std::numeric_limits<std::int64_t>::max();
  const std::vector<std::int64_t> times = {least, 0, most};
  for (const std::uint8_t value : event_slices(events.view(), {2, 2}, times, {100, 1})) CHECK(value == 0);
  events.add(0, 0, least, 1);
  events.add(1, 1, most - 1, 0);
  const std::vector<std::uint8_t> images = event_slices(events.view(), {2, 2}, times, {100, 1});
  CHECK(images[0] == 50);
  CHECK(images[24 + 8 + 3] == 50);
}

TEST_CASE("bad settings are refused") {
  const Events events;
  const std::vector<std::int64_t> times = {0};
  CHECK_THROWS_WITH_AS(event_slices(events.view(), {4, 3}, times, {0, 1}), "width is 0 us, expected > 0",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(event_slices(events.view(), {4, 3}, times, {10, 4}), "shrink is 4, expected 1 .. 3",
                       std::invalid_argument);
  CHECK_THROWS_AS(event_slices(events.view(), {0, 3}, times, {10, 1}), std::invalid_argument);
}
