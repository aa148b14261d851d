#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <set>
#include <utility>

#include "emseg/pixel_footprint.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

// Events all over a sensor, later ones no earlier.
RecordedEvents random_events(std::uint32_t seed, int count) {
  std::mt19937 random(seed);
  RecordedEvents events;
  std::int64_t t = -1'000'000;
  for (int k = 0; k < count; ++k) {
    t += static_cast<std::int64_t>(random() % 3);
    events.add(static_cast<int>(random() % 640), static_cast<int>(random() % 480), t,
               static_cast<int>(random() % 2));
  }
  return events;
}

Points scattered(const RecordedEvents& events, std::int64_t t_ref = 0) {
  Points points = make_points(events.view(), t_ref);
  scatter_over_pixels(events.view(), t_ref, points);
  return points;
}

// Mean and variance of the ways that points have gone, and the products of ways x and y.
struct Moments {
  double mean_x = 0, mean_y = 0, square_x = 0, square_y = 0, product = 0;
};

Moments moments_of(const RecordedEvents& events) {
  const Points points = scattered(events);
  Moments sum;
  const auto n = static_cast<double>(events.size());
  for (std::size_t k = 0; k < events.size(); ++k) {
    const double dx = points.x[k] - events.x[k], dy = points.y[k] - events.y[k];
    sum.mean_x += dx / n;
    sum.mean_y += dy / n;
    sum.square_x += dx * dx / n;
    sum.square_y += dy * dy / n;
    sum.product += dx * dy / n;
  }
  return sum;
}

// Of n values, uniform over a pixel and independent: five standard deviations of each moment's estimate.
void check_uniform(const Moments& found, double n) {
  CHECK(std::abs(found.mean_x) < 5 * std::sqrt(1 / 12.0 / n));
  CHECK(std::abs(found.mean_y) < 5 * std::sqrt(1 / 12.0 / n));
  CHECK(std::abs(found.square_x - 1 / 12.0) < 5 * std::sqrt(1 / 180.0 / n));
  CHECK(std::abs(found.square_y - 1 / 12.0) < 5 * std::sqrt(1 / 180.0 / n));
  CHECK(std::abs(found.product) < 5 / 12.0 / std::sqrt(n));
}

}  // namespace

TEST_CASE("events stay on their pixels, and in their times") {
  const RecordedEvents events = random_events(1, 50'000);
  const Points before = make_points(events.view(), 0), after = scattered(events);
  REQUIRE(after.size() == events.size());
  CHECK(after.dt == before.dt);
  CHECK(after.sign.empty());
  for (std::size_t k = 0; k < events.size(); ++k) {
    REQUIRE(std::abs(after.x[k] - before.x[k]) <= 0.5f);
    REQUIRE(std::abs(after.y[k] - before.y[k]) <= 0.5f);
  }
}

TEST_CASE("places are uniform over the pixel: over events anywhere, along a row, a column and in time") {
  constexpr int n = 40'000;
  check_uniform(moments_of(random_events(2, n)), n);
  RecordedEvents one_pixel, one_time;
  for (int k = 0; k < n; ++k) {
    one_pixel.add(17, 40, k);
    one_time.add(k % 200, k / 200, 123'456'789);
  }
  check_uniform(moments_of(one_pixel), n);
  check_uniform(moments_of(one_time), n);
}

TEST_CASE("an event goes the same way in whatever part of a window it comes, and by any clock") {
  const RecordedEvents events = random_events(3, 1000);
  const Points all = scattered(events);
  CHECK(scattered(events).x == all.x);
  Points part = make_points(events.view().slice(300, 700), 0);
  scatter_over_pixels(events.view().slice(300, 700), 0, part);
  for (std::size_t k = 0; k < part.size(); ++k) {
    REQUIRE(part.x[k] == all.x[300 + k]);
    REQUIRE(part.y[k] == all.y[300 + k]);
  }
  for (const std::int64_t shift : {std::int64_t{1}, std::int64_t{-12'345}, INT64_MAX - 1'000'000}) {
    RecordedEvents shifted = events;
    for (std::int64_t& t : shifted.t) t += shift;
    const Points there = scattered(shifted, shift);
    CHECK(there.x == all.x);
    CHECK(there.y == all.y);
    CHECK(scattered(shifted, 0).x != all.x);
  }
}

TEST_CASE("events go ways of their own") {
  // Neighbours in place and time, and the ends of what columns hold.
  RecordedEvents events;
  for (int k = 0; k < 4000; ++k) events.add(k % 20, k / 20 % 20, k / 400);
  events.add(65'535, 65'535, INT64_MAX);
  const Points points = scattered(events);
  std::set<std::pair<float, float>> ways;
  for (std::size_t k = 0; k < events.size(); ++k)
    ways.insert({points.x[k] - events.x[k], points.y[k] - events.y[k]});
  // Of 2^32 ways, some of which floats round to one.
  CHECK(ways.size() > events.size() - 10);
  Points none;
  scatter_over_pixels({}, 0, none);
  CHECK(none.size() == 0);
}
