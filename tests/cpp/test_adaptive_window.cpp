#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "emseg/adaptive_window.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{192, 128};
constexpr std::int64_t latest = std::numeric_limits<std::int64_t>::max();

// Dots all over the sensor that move alike for `seconds`.
EventColumns moving_scene(double speed, double seconds, std::int64_t t_first) {
  const WarpFrame frame = make_warp_frame(sensor);
  const int flashes =
      static_cast<int>(std::max(6.0, 2 * speed * seconds));  // one for each half pixel of the way
  const Region far{-static_cast<int>(speed * seconds) - 2, 0, 196 + 2 * static_cast<int>(speed * seconds),
                   128};
  const Scene scene = moving_dots({{Translation{{speed, 0}}, far, far.width, flashes}}, frame, seconds, 1);
  return recorded(scene, sensor, t_first + static_cast<std::int64_t>(5e5 * seconds) + 1);
}

}  // namespace

TEST_CASE("a window is as long as the motion takes for the wanted displacement") {
  const AdaptiveWindowOptions options;
  ThreadPool pool(2);
  for (const double speed : {150.0, 400.0, 1500.0}) {
    CAPTURE(speed);
    const EventColumns events = moving_scene(speed, 30 / speed, 0);
    const std::int64_t duration = judge_duration(events.view(), 0, sensor, options, pool);
    const double displacement = speed * 1e-6 * static_cast<double>(duration);
    CHECK(displacement > 0.6 * options.displacement);
    CHECK(displacement < 1.6 * options.displacement);
    for (const int threads : {1, 7}) {
      ThreadPool other(threads);
      CHECK(judge_duration(events.view(), 0, sensor, options, other) == duration);
    }
  }
}

TEST_CASE("a later beginning is judged from what follows it") {
  EventColumns events = moving_scene(150, 0.2, 0);
  const std::size_t begin = events.size();
  const EventColumns fast = moving_scene(1500, 0.02, 300'000);
  for (std::size_t k = 0; k < fast.size(); ++k) events.add(fast.x[k], fast.y[k], fast.t[k], fast.p[k]);
  ThreadPool pool(2);
  const AdaptiveWindowOptions options;
  for (const auto& [from, speed] : {std::pair{std::size_t{0}, 150.0}, {begin, 1500.0}}) {
    const std::int64_t duration = judge_duration(events.view(), from, sensor, options, pool);
    const double displacement = speed * 1e-6 * static_cast<double>(duration);
    CHECK(displacement > 0.6 * options.displacement);
    CHECK(displacement < 1.6 * options.displacement);
  }
}

TEST_CASE("too few events to judge by ask for the longest window") {
  EventColumns events;
  ThreadPool pool(1);
  const AdaptiveWindowOptions options;
  for (int k = 0; k < 20; ++k) {
    events.add(k, k, 1000 * k);
    REQUIRE(judge_duration(events.view(), 0, sensor, options, pool) == options.max_duration_us);
  }
}

TEST_CASE("times at the ends of 64 bits are judged as any other") {
  ThreadPool pool(1);
  const AdaptiveWindowOptions options;
  EventColumns events = moving_scene(400, 0.05, 0);
  const std::int64_t duration = judge_duration(events.view(), 0, sensor, options, pool);
  const std::int64_t shift = latest - events.t.back();
  for (std::int64_t& t : events.t) t += shift;
  CHECK(judge_duration(events.view(), 0, sensor, options, pool) == duration);
  EventColumns ends;
  ends.add(0, 0, std::numeric_limits<std::int64_t>::min());
  for (int k = 0; k < 300; ++k) ends.add(k % 100, 5, latest);
  CHECK(judge_duration(ends.view(), 0, sensor, options, pool) == options.max_duration_us);
  CHECK(judge_duration(ends.view(), 1, sensor, options, pool) > 0);
}

TEST_CASE("durations follow the motion, by a factor of two at the most and within their bounds") {
  AdaptiveWindowOptions options;
  options.displacement = 4;
  options.min_duration_us = 1'000;
  options.max_duration_us = 200'000;
  CHECK(next_duration(10'000, 4, options) == 10'000);
  CHECK(next_duration(10'000, 5, options) == 8'000);
  CHECK(next_duration(10'000, 3, options) == 13'333);
  CHECK(next_duration(10'000, 1, options) == 20'000);
  CHECK(next_duration(10'000, 100, options) == 5'000);
  CHECK(next_duration(10'000, 0, options) == 20'000);
  CHECK(next_duration(1'500, 100, options) == 1'000);
  CHECK(next_duration(150'000, 1, options) == 200'000);
  CHECK(next_duration(0, 1, options) == 1'000);
  CHECK(next_duration(latest, 0.1, options) == 200'000);
  CHECK(next_duration(10'000, std::numeric_limits<double>::infinity(), options) == 5'000);
  CHECK(next_duration(10'000, std::numeric_limits<double>::quiet_NaN(), options) == 20'000);
}
