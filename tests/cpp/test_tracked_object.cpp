#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "emseg/iwe.hpp"
#include "emseg/tracked_object.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr Region plane{-3, -2, 167, 125};
const WarpFrame frame = make_warp_frame({160, 120});

struct Cell {
  double column, row;  // of 4 px
};

Cell cell_of(Place at) {
  const Region canvas = canvas_of(plane);
  return {std::floor((at.x - canvas.x0) / 4), std::floor((at.y - canvas.y0) / 4)};
}

bool on_canvas(Place at) {
  const Region canvas = canvas_of(plane);
  return at.x >= canvas.x0 && at.x < canvas.x0 + canvas.width && at.y >= canvas.y0 &&
         at.y < canvas.y0 + canvas.height;
}

// So near to the border of a cell that a float may take it for the other.
bool on_a_border(Place at) {
  const auto near = [](double value) { return std::abs(value / 4 - std::round(value / 4)) < 1e-4; };
  const Region canvas = canvas_of(plane);
  return near(at.x - canvas.x0) || near(at.y - canvas.y0) || near(at.x - canvas.x0 - canvas.width) ||
         near(at.y - canvas.y0 - canvas.height);
}

// Places and points in double precision, moved to t_ref by the object's motion.
struct Moved {
  std::vector<Place> places, points;
};

Moved moved(const PointView& points, const TrackedObject& object) {
  Moved result;
  for (const Vec2f place : object.places)
    result.places.push_back(reference_warp(object.model, frame, {place.x, place.y}, object.seen));
  for (std::size_t k = 0; k < points.size(); ++k)
    result.points.push_back(reference_warp(object.model, frame, {points.x[k], points.y[k]}, points.dt[k]));
  return result;
}

// By the definition: the cell of a point is that of a place, or next to it.
bool defined(Place point, const std::vector<Place>& places) {
  const Cell own = cell_of(point);
  return on_canvas(point) && std::ranges::any_of(places, [&](Place place) {
           const Cell cell = cell_of(place);
           return on_canvas(place) && std::abs(own.column - cell.column) <= 1 &&
                  std::abs(own.row - cell.row) <= 1;
         });
}

double distance(Place point, const std::vector<Place>& places) {
  double least = std::numeric_limits<double>::infinity();
  for (const Place place : places)
    least = std::min(least, std::max(std::abs(point.x - place.x), std::abs(point.y - place.y)));
  return least;
}

MotionModel random_motion(std::mt19937& random, int kind) {
  const auto velocity = [&] { return uniform(random, -400, 400); };
  const auto rate = [&] { return uniform(random, -2, 2); };
  if (kind == 0) return Translation{{velocity(), velocity()}};
  if (kind == 1) return Rotation{{rate(), rate(), rate()}};
  if (kind == 2) return Similarity{{velocity(), velocity(), rate(), rate()}};
  return Homography{{velocity(), velocity(), rate(), rate(), rate(), rate(), rate(), rate()}};
}

Points random_points(std::mt19937& random, int count) {
  Points points;
  for (int k = 0; k < count; ++k) {
    points.x.push_back(static_cast<float>(uniform(random, plane.x0, plane.x0 + plane.width)));
    points.y.push_back(static_cast<float>(uniform(random, plane.y0, plane.y0 + plane.height)));
    points.dt.push_back(static_cast<float>(uniform(random, -0.02, 0.02)));
  }
  return points;
}

// Points that stand at some places.
Points standing(const std::vector<Vec2f>& places) {
  Points points;
  for (const Vec2f place : places) {
    points.x.push_back(place.x);
    points.y.push_back(place.y);
    points.dt.push_back(0);
  }
  return points;
}

using Flags = std::vector<std::uint8_t>;

}  // namespace

TEST_CASE("an object is expected in the cells about its places, both moved to t_ref") {
  std::mt19937 random(12);
  int expected = 0, unexpected = 0, skipped = 0;
  for (int trial = 0; trial < 120; ++trial) {
    CAPTURE(trial);
    TrackedObject object{random_motion(random, trial % 4), {}, trial % 3 ? uniform(random, -0.08, 0.02) : 0};
    const int count = trial % 5 ? 12 : 1;
    for (int i = 0; i < count; ++i) {
      // Some lie off the plane, and some off the canvas.
      object.places.push_back(
          {static_cast<float>(uniform(random, -110, 270)), static_cast<float>(uniform(random, -80, 200))});
    }
    const Points points = random_points(random, 1000);
    const Flags found = where_expected(points.view(), object, frame, plane);
    REQUIRE(found.size() == points.size());
    const auto [places, at] = moved(points.view(), object);
    if (std::ranges::any_of(places, on_a_border)) {
      ++skipped;
      continue;
    }
    for (std::size_t k = 0; k < points.size(); ++k) {
      if (on_a_border(at[k])) continue;
      CAPTURE(k);
      REQUIRE(found[k] == defined(at[k], places));
      // What is within a cell of a place on the canvas is there, and nothing beyond two.
      if (distance(at[k], places) >= 8) REQUIRE(found[k] == 0);
      if (on_canvas(at[k]) && distance(at[k], places) < 4 && std::ranges::all_of(places, on_canvas))
        REQUIRE(found[k] == 1);
      (found[k] ? expected : unexpected) += 1;
    }
  }
  CHECK(expected > 1000);
  CHECK(unexpected > 1000);
  CHECK(skipped < 20);
}

TEST_CASE("by hand: an object that was seen earlier is expected where it has gone since") {
  // 60 ms ago at (41, 51), at 200 px/s to the right and 100 px/s down: now in the middle of the cells from
  // (46, 52) to (58, 64).
  const TrackedObject object{Translation{{200, 100}}, {{41, 51}}, -0.06};
  const Points points =
      standing({{53, 57}, {41, 51}, {46.5f, 52.5f}, {57, 63}, {59, 57}, {53, 65}, {45, 57}, {53, 51}});
  CHECK(where_expected(points.view(), object, frame, plane) == Flags{1, 0, 1, 1, 0, 0, 0, 0});
  // Points are moved as well: what was at (41, 51) at that time was at the place.
  Points then = standing({{41, 51}, {53, 57}});
  then.dt.assign(2, -0.06f);
  CHECK(where_expected(then.view(), object, frame, plane) == Flags{1, 0});
}

TEST_CASE("off the plane an object is followed, beyond the canvas it is lost") {
  const Region canvas = canvas_of(plane);
  const auto left = static_cast<float>(canvas.x0), top = static_cast<float>(canvas.y0);
  const float right = left + static_cast<float>(canvas.width),
              bottom = top + static_cast<float>(canvas.height);
  const std::vector<Vec2f> corners{
      {left, top}, {right - 0.5f, top}, {left, bottom - 0.5f}, {right - 0.5f, bottom - 0.5f}};
  for (const Vec2f corner : corners) {
    const TrackedObject object{Translation{}, {corner}, 0};
    const Flags found = where_expected(standing(corners).view(), object, frame, plane);
    for (std::size_t k = 0; k < corners.size(); ++k)
      CHECK(found[k] == (corners[k].x == corner.x && corners[k].y == corner.y));
  }
  for (const Vec2f outside : {Vec2f{left - 0.5f, 40}, {right, 40}, {40, top - 0.5f}, {40, bottom}}) {
    const Points there = standing({outside});
    CHECK(where_expected(there.view(), {Translation{}, {outside}, 0}, frame, plane) == Flags{0});
    // Nor is what lies beyond it near a place within.
    CHECK(where_expected(there.view(), {Translation{}, {corners[0], corners[3]}, 0}, frame, plane) ==
          Flags{0});
  }
}

TEST_CASE("an object without places may be anywhere, which is not the same as nowhere") {
  const Points points = standing({{10, 10}, {80, 60}});
  CHECK(where_expected(points.view(), {Translation{{30, 0}}, {}, 0}, frame, plane).empty());
  CHECK(where_expected(points.view(), {Translation{{30, 0}}, {{1000, 0}}, 0}, frame, plane) == Flags{0, 0});
  CHECK(where_expected(Points{}.view(), {Translation{}, {{10, 10}}, 0}, frame, plane).empty());
}

TEST_CASE("places and motions without bounds are survived") {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const Points points = standing({{10, 10}, {80, 60}, {nan, 60}, {80, inf}});
  for (const Vec2f nowhere : {Vec2f{nan, 10}, {10, nan}, {inf, 10}, {-inf, -inf}, {1e30f, 1e30f}}) {
    CHECK(where_expected(points.view(), {Translation{}, {nowhere}, 0}, frame, plane) == Flags(4, 0));
    CHECK(where_expected(points.view(), {Translation{}, {nowhere, {80, 60}}, 0}, frame, plane) ==
          Flags{0, 1, 0, 0});
  }
  // Whatever stands at t_ref is where it is by any motion; what was seen before has gone.
  const MotionModel wild = Homography{{1e30, -1e30, 1e9, 0, 0, 1e9, 1e30, 1e30}};
  CHECK(where_expected(points.view(), {wild, {{80, 60}}, -1}, frame, plane) == Flags(4, 0));
  CHECK(where_expected(points.view(), {Translation{{100, 0}}, {{80, 60}}, 1e30}, frame, plane) ==
        Flags(4, 0));
}
