#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>

#include "synthetic_events.hpp"
#include "velocity_search.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{160, 120};
constexpr Region plane{0, 0, 160, 120};

Scene drifting(double vx, double vy, double duration, std::uint32_t seed) {
  return moving_dots({{Translation{{vx, vy}}, {10, 10, 140, 100}, 200, 14}}, make_warp_frame(sensor),
                     duration, seed);
}

}  // namespace

TEST_CASE("the velocity of one motion comes first, slow or fast, in short windows and long ones") {
  std::mt19937 random(1);
  for (const double duration : {0.01, 0.05, 0.3}) {
    for (const double speed : {0.0, 40.0, 300.0, 1500.0}) {
      if (speed * duration > 90) continue;  // dots would leave the sensor
      CAPTURE(duration);
      CAPTURE(speed);
      const double angle = uniform(random, 0, 6.28);
      const double vx = speed * std::cos(angle), vy = speed * std::sin(angle);
      const Scene scene = drifting(vx, vy, duration, 2);
      const auto found = find_velocities(scene.view(), scene.positive, plane, 5000);
      REQUIRE(!found.empty());
      // A pixel and a half between the first events and the last, from whole pixels at half the window apart.
      CHECK(std::hypot(found[0].vx - vx, found[0].vy - vy) * duration < 1.5);
      for (std::size_t i = 1; i < found.size(); ++i)
        CHECK(found[i].significance <= found[i - 1].significance);
    }
  }
}

TEST_CASE("two motions are both found") {
  const Translation left{{-400, 100}}, right{{350, 250}};
  const Scene scene = moving_dots({{left, {40, 20, 110, 80}, 120, 14}, {right, {10, 10, 110, 80}, 120, 14}},
                                  make_warp_frame(sensor), 0.04, 3);
  const auto found = find_velocities(scene.view(), scene.positive, plane, 5000);
  for (const Translation& motion : {left, right}) {
    const bool there = std::any_of(found.begin(), found.end(), [&](const FoundVelocity& v) {
      return std::hypot(v.vx - motion.params[0], v.vy - motion.params[1]) * 0.04 < 1.5;
    });
    CHECK(there);
  }
}

TEST_CASE("no velocity is above the largest, and events scattered at random have none") {
  const Scene scene = drifting(900, 0, 0.04, 4);
  for (const FoundVelocity& v : find_velocities(scene.view(), scene.positive, plane, 300)) {
    CHECK(std::abs(v.vx) <= 300);
    CHECK(std::abs(v.vy) <= 300);
  }
  std::mt19937 random(5);
  for (int trial = 0; trial < 10; ++trial) {
    Points noise;
    std::vector<std::uint8_t> positive;
    for (int k = 0; k < 3000; ++k) {
      noise.x.push_back(static_cast<float>(std::floor(uniform(random, 0, 160))));
      noise.y.push_back(static_cast<float>(std::floor(uniform(random, 0, 120))));
      noise.dt.push_back(static_cast<float>(k) * 1e-5f);
      positive.push_back(static_cast<std::uint8_t>(random() % 2));
    }
    CHECK(find_velocities(noise.view(), positive, plane, 5000).empty());
  }
}

TEST_CASE("no events, one time, or places that are none have no velocity") {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  CHECK(find_velocities({}, {}, plane, 5000).empty());
  const Points once{{3, 3, 3}, {4, 4, 4}, {0.5f, 0.5f, 0.5f}};
  CHECK(find_velocities(once.view(), std::vector<std::uint8_t>{1, 1, 1}, plane, 5000).empty());
  const Points odd{{nan, inf, -1e30f, 1e30f}, {1, 2, 3, nan}, {0, 0.1f, 0.2f, 0.3f}};
  CHECK(find_velocities(odd.view(), std::vector<std::uint8_t>{1, 1, 1, 0}, plane, 5000).empty());
  CHECK(count_coincidences(odd.view(), std::vector<std::uint8_t>{1, 1, 1, 0}, Translation{},
                           make_warp_frame(sensor), plane, 100) == 0);
}

TEST_CASE("coincidences are pairs of one polarity in one cell of two pixels") {
  const Points points{{10, 11, 11, 10, 12, 10}, {20, 21, 20, 21, 20, 22}, {0, 0, 0, 0, 0, 0}};
  const std::vector<std::uint8_t> positive{1, 1, 1, 0, 1, 1};
  const auto count = [&](std::size_t most) {
    return count_coincidences(points.view(), positive, Translation{}, make_warp_frame(sensor), plane, most);
  };
  CHECK(count(100) == 3);  // of the first three events
  CHECK(count(2) == 0);    // events 0 and 3
  CHECK(count(0) == 0);
}
