#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>

#include "emseg/part_features.hpp"
#include "emseg/warp_events.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{40, 20};

struct SomeEvents {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;
  EventView view() const { return {x, y, t, {}}; }
};

SomeEvents random_events(std::uint32_t seed, std::size_t count) {
  std::mt19937 random(seed);
  SomeEvents events;
  for (std::size_t k = 0; k < count; ++k) {
    events.x.push_back(static_cast<std::uint16_t>(random() % 40));
    events.y.push_back(static_cast<std::uint16_t>(random() % 20));
    events.t.push_back(static_cast<std::int64_t>(100 * k));
  }
  return events;
}

std::vector<std::int64_t> all_of(const SomeEvents& events) {
  std::vector<std::int64_t> own(events.t.size());
  std::iota(own.begin(), own.end(), 0);
  return own;
}

}  // namespace

TEST_CASE("tiles are won by most events, three at least, and by the first of equals") {
  const SomeEvents events{{1, 2, 3, 4, 5, 6, 20, 21, 39, 39, 39},
                          {0, 0, 0, 1, 1, 1, 3, 3, 19, 19, 19},
                          std::vector<std::int64_t>(11, 0)};
  const std::vector<std::int64_t> first{0, 1, 2, 6, 7}, second{3, 4, 5, 8, 9, 10};
  const std::vector<std::span<const std::int64_t>> groups{first, second};
  const TileGrid tiles = tiles_of(sensor, 16);
  CHECK(tiles.columns == 3);
  CHECK(tiles.rows == 2);
  CHECK(winners_of_tiles(events.view(), groups, tiles) == std::vector<std::int32_t>{0, -1, -1, -1, -1, 1});
  CHECK_THROWS_AS(winners_of_tiles(events.view(), groups, tiles_of({30, 20}, 10)), std::invalid_argument);
  CHECK_THROWS_AS(tiles_of(sensor, 0), std::invalid_argument);
}

TEST_CASE("boxes are those of sorted coordinates") {
  for (const std::size_t count : {1u, 2u, 49u, 50u, 101u, 700u}) {
    CAPTURE(count);
    SomeEvents events = random_events(3, count);
    const Box inner = inner_box(events.view(), all_of(events), sensor);
    std::mt19937 random(4);
    std::vector<Vec2f> places;
    for (std::size_t k = 0; k < count; ++k) {
      places.push_back({static_cast<float>(uniform(random, -50, 400)), static_cast<float>(random() % 3)});
    }
    const Box outer = outer_box(places);
    std::vector<double> x, y;
    for (const Vec2f place : places) {
      x.push_back(place.x);
      y.push_back(place.y);
    }
    for (auto* column : {&x, &y}) std::sort(column->begin(), column->end());
    std::sort(events.x.begin(), events.x.end());
    std::sort(events.y.begin(), events.y.end());
    const std::size_t low = count / 50, high = count - 1 - low;
    CHECK(inner.left == events.x[low]);
    CHECK(inner.top == events.y[low]);
    CHECK(inner.right == events.x[high]);
    CHECK(inner.bottom == events.y[high]);
    const auto between = [&](const std::vector<double>& sorted, double share) {
      const double rank = share * static_cast<double>(count - 1);
      const auto below = static_cast<std::size_t>(rank);
      const double next = sorted[std::min(below + 1, count - 1)];
      return sorted[below] + (rank - static_cast<double>(below)) * (next - sorted[below]);
    };
    CHECK(outer.left == doctest::Approx(between(x, 0.01)));
    CHECK(outer.top == doctest::Approx(between(y, 0.01)));
    CHECK(outer.right == doctest::Approx(between(x, 0.99)));
    CHECK(outer.bottom == doctest::Approx(between(y, 0.99)));
  }
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  constexpr float most = std::numeric_limits<float>::max();
  CHECK(outer_box(std::vector<Vec2f>{{nan, 1}}).right == 0);
  CHECK(outer_box(std::vector<Vec2f>{{-most, 1}, {most, 1}}).left < -0.9 * double{most});
  CHECK_THROWS_AS(inner_box(random_events(3, 5).view(), {}, sensor), std::invalid_argument);
}

TEST_CASE("the spread of all tiles is one, of one tile its share") {
  CHECK(spread_of_tiles(std::vector<std::uint8_t>(12, 1), 4) == doctest::Approx(1));
  std::vector<std::uint8_t> one(12, 0);
  CHECK(spread_of_tiles(one, 4) == 0);
  one[5] = 1;
  CHECK(spread_of_tiles(one, 4) == doctest::Approx(1.0 / 12));
}

TEST_CASE("what goes goes all the way, what stays none, and too little tells nothing") {
  SomeEvents events = random_events(5, 600);
  for (std::size_t k = 0; k < 600; ++k) {
    events.x[k] = static_cast<std::uint16_t>(5 + k / 30);
    events.y[k] = 7;
  }
  const auto own = all_of(events);
  CHECK(share_gone(events.view(), own, {20, 0}) == doctest::Approx(1).epsilon(0.1));
  CHECK(share_gone(events.view(), own, {0, 20}) == 0);
  CHECK(share_gone(events.view(), own, {-20, 0}) == -0.5);
  CHECK(share_gone(events.view(), own, {4, 0}) == 0.5);
  CHECK(share_gone(events.view(), std::span(own).first(29), {20, 0}) == 0.5);
}

TEST_CASE("velocities are what warps take back, times time") {
  const WarpFrame frame = make_warp_frame(sensor);
  constexpr float h = 1.0f / 128;
  for (const MotionModel& model :
       {MotionModel(Translation{{130, -70}}), MotionModel(Rotation{{0.3, -0.5, 2}}),
        MotionModel(Similarity{{60, 90, 0.4, -0.9}}), MotionModel(Affine{{10, 20, 0.5, -0.2, 0.3, 0.7}}),
        MotionModel(Homography{{40, -90, 0.6, -0.3, 0.8, -0.5, 0.9, -0.7}})}) {
    for (const Vec2f at : {Vec2f{0, 0}, {39, 3}, {17.5f, 19}}) {
      const auto [early, late] = std::visit(
          [&](const auto& motion) {
            const typename std::decay_t<decltype(motion)>::Warp warp(motion, frame);
            return std::pair(warp(at.x, at.y, -h), warp(at.x, at.y, h));
          },
          model);
      const Vec2d velocity = image_velocity(model, frame, {at.x, at.y});
      CHECK(velocity.x == doctest::Approx((early.x - late.x) / (2 * h)).epsilon(1e-3));
      CHECK(velocity.y == doctest::Approx((early.y - late.y) / (2 * h)).epsilon(1e-3));
    }
  }
}

TEST_CASE("some events are warped as all are, from undistorted pixels where there are any") {
  const WarpFrame frame = make_warp_frame(sensor);
  const MotionModel model = Affine{{10, 20, 0.5, -0.2, 0.3, 0.7}};
  const SomeEvents events = random_events(6, 50);
  std::vector<float> table_x(800), table_y(800);
  for (std::size_t k = 0; k < 800; ++k) {
    table_x[k] = static_cast<float>(k % 40) * 1.1f;
    table_y[k] = static_cast<float>(k) / 40;
  }
  const UndistortionTable table{sensor, table_x, table_y};
  const std::vector<std::int64_t> own{49, 0, 7, 7};
  for (const bool undistorted : {false, true}) {
    const Points points = make_points(events.view(), 2000, undistorted ? &table : nullptr);
    std::vector<float> x(50), y(50);
    warp_points(points.view(), model, frame, x, y);
    const auto found = warp_events(events.view(), own, 2000, model, frame,
                                   undistorted ? PixelPlaces{table_x, table_y, 40} : PixelPlaces{});
    REQUIRE(found.size() == own.size());
    for (std::size_t i = 0; i < own.size(); ++i) {
      CHECK(found[i].x == doctest::Approx(x[static_cast<std::size_t>(own[i])]));
      CHECK(found[i].y == doctest::Approx(y[static_cast<std::size_t>(own[i])]));
    }
  }
  const PixelPlaces few{std::span(table_x).first(3), std::span(table_y).first(3), 40};
  CHECK_THROWS_AS(warp_events(events.view(), own, 0, model, frame, few), std::invalid_argument);
  for (const std::int64_t wrong : {-1, 50}) {
    CHECK_THROWS_AS(warp_events(events.view(), std::vector{wrong}, 0, model, frame), std::invalid_argument);
  }
}

TEST_CASE("events at rising positions are taken, counted from the end where negative") {
  SomeEvents events = random_events(7, 10);
  const std::vector<std::uint8_t> p{0, 1, 0, 1, 0, 1, 0, 1, 0, 1};
  const EventView view{events.x, events.y, events.t, p};
  const EventColumns taken = take_events(view, std::vector<std::int64_t>{1, 1, 4, -1});
  CHECK(taken.t == std::vector<std::int64_t>{100, 100, 400, 900});
  CHECK(taken.p == std::vector<std::uint8_t>{1, 1, 0, 1});
  CHECK(taken.x[2] == events.x[4]);
  CHECK(taken.y[3] == events.y[9]);
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{10}), std::out_of_range);
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{-11}), std::out_of_range);
  CHECK_THROWS_AS(take_events(view, std::vector<std::int64_t>{4, 3}), std::invalid_argument);
}
