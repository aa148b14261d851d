#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "central_differences.hpp"
#include "emseg/motion_model.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{346, 260};
constexpr Region plane{0, 0, 346, 260};
constexpr std::array kinds{MotionKind::translation, MotionKind::rotation, MotionKind::similarity,
                           MotionKind::affine, MotionKind::homography};

WarpFrame calibrated_frame() {
  Camera camera;
  camera.size = sensor;
  camera.fx = 257.7;
  camera.fy = 255.1;
  camera.cx = 188.3;
  camera.cy = 131.6;
  return make_warp_frame(sensor, &camera);
}

std::vector<double> random_params(std::mt19937& random, MotionKind kind) {
  std::vector<double> params;
  for (int d = 0; d < dof_of(kind); ++d) {
    const bool velocity = kind != MotionKind::rotation && d < 2;
    params.push_back(velocity ? uniform(random, -800, 800) : uniform(random, -1.2, 1.2));
  }
  return params;
}

MotionModel random_motion(std::mt19937& random, MotionKind kind) {
  return make_motion(kind, random_params(random, kind));
}

Place random_place(std::mt19937& random) { return {uniform(random, 0, 345), uniform(random, 0, 259)}; }

Vec2f warped(const MotionModel& model, const WarpFrame& frame, Place at, double dt) {
  return std::visit(
      [&](const auto& m) {
        return typename std::decay_t<decltype(m)>::Warp(m, frame)(
            static_cast<float>(at.x), static_cast<float>(at.y), static_cast<float>(dt));
      },
      model);
}

// Largest distance between two models' warps over the sensor, px.
double largest_distance(const MotionModel& a, const MotionModel& b, const WarpFrame& frame, double dt) {
  double largest = 0;
  for (int y = 0; y < 260; y += 37) {
    for (int x = 0; x < 346; x += 43) {
      const Place p = reference_warp(a, frame, {double(x), double(y)}, dt);
      const Place q = reference_warp(b, frame, {double(x), double(y)}, dt);
      largest = std::max(largest, std::hypot(p.x - q.x, p.y - q.y));
    }
  }
  return largest;
}

// What a model makes of places all over the sensor, for a fit to find the model again.
std::vector<Correspondence> correspondences(const MotionModel& model, const WarpFrame& frame, double dt) {
  std::vector<Correspondence> pairs;
  for (int y = 5; y < 260; y += 50) {
    for (int x = 5; x < 346; x += 55) {
      const Place to = reference_warp(model, frame, {double(x), double(y)}, dt);
      pairs.push_back({float(x), float(y), float(dt), static_cast<float>(to.x), static_cast<float>(to.y), 1});
    }
  }
  return pairs;
}

bool finite(const MotionModel& model) {
  const auto params = params_of(model);
  return std::all_of(params.begin(), params.end(), [](double value) { return std::isfinite(value); });
}

}  // namespace

TEST_CASE("warps are those of the definitions") {
  std::mt19937 random(1);
  for (const WarpFrame& frame : {make_warp_frame(sensor), calibrated_frame()}) {
    for (const MotionKind kind : kinds) {
      CAPTURE(name_of(kind));
      for (int trial = 0; trial < 200; ++trial) {
        const MotionModel model = random_motion(random, kind);
        // Whole pixels and a time that float holds, so that only the warp rounds.
        const Place at{std::floor(uniform(random, 0, 346)), std::floor(uniform(random, 0, 260))};
        const double dt = std::round(uniform(random, -128, 128)) / 1024;
        const Vec2f made = warped(model, frame, at, dt);
        const Place expected = reference_warp(model, frame, at, dt);
        REQUIRE(std::abs(made.x - expected.x) < 2e-4);
        REQUIRE(std::abs(made.y - expected.y) < 2e-4);
      }
    }
  }
}

TEST_CASE("a rotation turns bearings exactly, by large angles too") {
  std::mt19937 random(2);
  const WarpFrame frame = calibrated_frame();
  for (int trial = 0; trial < 300; ++trial) {
    Eigen::Vector3d w(uniform(random, -1, 1), uniform(random, -1, 1), uniform(random, -30, 30));
    if (trial % 10 == 0) w *= 1e-6;
    const double dt = std::round(uniform(random, -64, 64)) / 512;
    const Place at = random_place(random);
    const float x = static_cast<float>(at.x), y = static_cast<float>(at.y);
    const Eigen::Vector3d bearing((x - frame.px) / frame.fx, (y - frame.py) / frame.fy, 1);
    const Eigen::Vector3d turned = Eigen::AngleAxisd(-dt * w.norm(), w.normalized()) * bearing;
    const Vec2f made = warped(Rotation{{w.x(), w.y(), w.z()}}, frame, {x, y}, dt);
    REQUIRE(std::abs(made.x - (frame.fx * turned.x() / turned.z() + frame.px)) < 1e-3);
    REQUIRE(std::abs(made.y - (frame.fy * turned.y() / turned.z() + frame.py)) < 1e-3);
  }
}

TEST_CASE("derivatives of the warps agree with central differences") {
  std::mt19937 random(3);
  for (const WarpFrame& frame : {make_warp_frame(sensor), calibrated_frame()}) {
    for (const MotionKind kind : kinds) {
      CAPTURE(name_of(kind));
      for (int trial = 0; trial < 100; ++trial) {
        auto params = random_params(random, kind);
        if (trial == 0) params.assign(params.size(), 0.0);
        const Place at = random_place(random);
        const double dt = uniform(random, -0.2, 0.2);
        std::vector<double> steps;  // of about 1e-3 px each: differences of doubles keep seven digits
        for (std::size_t d = 0; d < params.size(); ++d) {
          steps.push_back(kind != MotionKind::rotation && d < 2 ? 1e-2 : 1e-4);
        }
        const auto along_x = central_differences(
            [&](const std::vector<double>& q) { return reference_warp(kind, q, frame, at, dt).x; }, params,
            steps);
        const auto along_y = central_differences(
            [&](const std::vector<double>& q) { return reference_warp(kind, q, frame, at, dt).y; }, params,
            steps);
        std::visit(
            [&](const auto& m) {
              const typename std::decay_t<decltype(m)>::Warp warp(m, frame);
              const auto jacobian =
                  warp.jacobian(static_cast<float>(at.x), static_cast<float>(at.y), static_cast<float>(dt));
              for (std::size_t d = 0; d < params.size(); ++d) {
                CAPTURE(d);
                // An entry is dt times a length of up to the sensor's: floats hold that to 1e-5 of it.
                REQUIRE(std::abs(jacobian.dx[d] - along_x[d]) <
                        1e-5 * (std::abs(along_x[d]) + 400 * std::abs(dt)));
                REQUIRE(std::abs(jacobian.dy[d] - along_y[d]) <
                        1e-5 * (std::abs(along_y[d]) + 400 * std::abs(dt)));
              }
            },
            make_motion(kind, params));
      }
    }
  }
}

TEST_CASE("without parameters, and at t_ref, nothing moves") {
  std::mt19937 random(4);
  const WarpFrame frame = calibrated_frame();
  for (const MotionKind kind : kinds) {
    for (int trial = 0; trial < 20; ++trial) {
      const Place at{std::floor(uniform(random, 0, 346)), std::floor(uniform(random, 0, 260))};
      for (const auto& [model, dt] :
           {std::pair{make_motion(kind), 0.1}, {random_motion(random, kind), 0.0}}) {
        const Vec2f to = warped(model, frame, at, dt);
        REQUIRE(std::abs(to.x - at.x) < 1e-4);
        REQUIRE(std::abs(to.y - at.y) < 1e-4);
      }
    }
  }
}

TEST_CASE("kinds have names, and models check their parameters") {
  for (const MotionKind kind : kinds) {
    CHECK(motion_kind(name_of(kind)) == kind);
    CHECK(kind_of(make_motion(kind)) == kind);
    const MotionModel made = make_motion(kind);
    CHECK(params_of(made).size() == static_cast<std::size_t>(dof_of(kind)));
  }
  const std::vector<double> four{1, 2, 3, 4};
  const auto made = make_motion(MotionKind::similarity, four);
  CHECK(std::equal(four.begin(), four.end(), params_of(made).begin()));
  CHECK_THROWS_AS(make_motion(MotionKind::affine, four), std::invalid_argument);
  const std::vector<double> odd{0, std::numeric_limits<double>::infinity()};
  CHECK_THROWS_AS(make_motion(MotionKind::translation, odd), std::invalid_argument);
  try {
    motion_kind("spiral");
    FAIL("no error");
  } catch (const std::invalid_argument& error) {
    CHECK(std::string(error.what()) ==
          "unknown motion model 'spiral', expected one of translation, rotation, similarity, affine, "
          "homography");
  }
}

TEST_CASE("correspondences that a model made lead back to it") {
  std::mt19937 random(5);
  const WarpFrame frame = calibrated_frame();
  for (const MotionKind kind : kinds) {
    CAPTURE(name_of(kind));
    for (int trial = 0; trial < 20; ++trial) {
      const MotionModel model = random_motion(random, kind);
      const MotionModel fitted = fit_correspondences(kind, correspondences(model, frame, 0.0625), frame);
      CHECK(largest_distance(model, fitted, frame, 0.0625) < 1e-3);
    }
  }
}

TEST_CASE("weights tell a fit what counts") {
  const WarpFrame frame = make_warp_frame(sensor);
  std::vector<Correspondence> pairs;
  for (const float x : {10.0f, 100.0f, 300.0f}) pairs.push_back({x, 50, 1, x - 20, 53, 2});
  pairs.push_back({200, 200, 1, 0, 0, 0});  // of no weight
  const MotionModel fitted = fit_correspondences(MotionKind::translation, pairs, frame);
  const auto params = params_of(fitted);
  CHECK(params[0] == doctest::Approx(20));
  CHECK(params[1] == doctest::Approx(-3));
  // The weighted mean, where places disagree.
  const std::vector<Correspondence> two{{0, 0, 1, -10, 0, 3}, {0, 0, 1, -50, 0, 1}};
  const MotionModel mean = fit_correspondences(MotionKind::translation, two, frame);
  CHECK(params_of(mean)[0] == doctest::Approx(20));
}

TEST_CASE("what correspondences do not determine stays at no motion") {
  const WarpFrame frame = calibrated_frame();
  for (const MotionKind kind : kinds) {
    CAPTURE(name_of(kind));
    const auto still = [](const MotionModel& model) {
      const auto params = params_of(model);
      return std::all_of(params.begin(), params.end(), [](double value) { return value == 0; });
    };
    CHECK(still(fit_correspondences(kind, {}, frame)));
    CHECK(still(
        fit_correspondences(kind, std::vector<Correspondence>{{50, 60, 0, 70, 90, 1}}, frame)));  // dt = 0
    CHECK(still(fit_correspondences(kind, std::vector<Correspondence>{{50, 60, 0.1f, 70, 90, 0}}, frame)));
    // One pair: its own displacement is met, with no larger a motion than that takes.
    const Correspondence one{50, 60, 0.1f, 52, 57, 1};
    const MotionModel fitted = fit_correspondences(kind, std::vector{one}, frame);
    const Vec2f to = warped(fitted, frame, {50, 60}, 0.1);
    CHECK(std::abs(to.x - 52) < 1e-2);
    CHECK(std::abs(to.y - 57) < 1e-2);
    CHECK(largest_distance(fitted, make_motion(kind), frame, 0.1) < 40);
    // At the image centre only velocities count, and the rest stays.
    if (kind == MotionKind::similarity || kind == MotionKind::affine || kind == MotionKind::homography) {
      const auto cx = static_cast<float>(frame.cx), cy = static_cast<float>(frame.cy);
      const std::vector<Correspondence> centre{{cx, cy, 0.1f, cx - 1, cy + 2, 1}};
      const MotionModel moved = fit_correspondences(kind, centre, frame);
      CHECK(params_of(moved)[0] == doctest::Approx(10));
      CHECK(params_of(moved)[1] == doctest::Approx(-20));
      for (const double rest : params_of(moved).subspan(2)) CHECK(rest == 0);
    }
  }
}

TEST_CASE("a correspondence that is no number does not spoil the fit") {
  const WarpFrame frame = calibrated_frame();
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  const MotionModel model = Similarity{{100, -50, 0.2, 0.3}};
  for (const MotionKind kind : kinds) {
    auto pairs = correspondences(model, frame, 0.0625);
    const MotionModel clean = fit_correspondences(kind, pairs, frame);
    pairs.push_back({10, 10, 0.1f, nan, 3, 1});
    pairs.push_back({10, 10, 0.1f, 3, std::numeric_limits<float>::infinity(), 1});
    const MotionModel fitted = fit_correspondences(kind, pairs, frame);
    REQUIRE(finite(fitted));
    CHECK(largest_distance(clean, fitted, frame, 0.1) == 0);
  }
}

TEST_CASE("a motion stays the same as a model of a kind that contains its own") {
  std::mt19937 random(6);
  const WarpFrame frame = calibrated_frame();
  const std::vector<std::pair<MotionKind, MotionKind>> contained{
      {MotionKind::translation, MotionKind::translation}, {MotionKind::translation, MotionKind::similarity},
      {MotionKind::translation, MotionKind::affine},      {MotionKind::translation, MotionKind::homography},
      {MotionKind::similarity, MotionKind::affine},       {MotionKind::similarity, MotionKind::homography},
      {MotionKind::affine, MotionKind::homography}};
  for (const auto& [from, to] : contained) {
    CAPTURE(name_of(from));
    CAPTURE(name_of(to));
    for (int trial = 0; trial < 20; ++trial) {
      const MotionModel model = random_motion(random, from);
      const MotionModel converted = convert_motion(model, to, frame, plane);
      REQUIRE(kind_of(converted) == to);
      // Targets are floats of up to 1000 px, 10 ms away: a tenth of a second later their rounding has grown
      // tenfold.
      REQUIRE(largest_distance(model, converted, frame, 0.1) < 2e-3);
    }
  }
}

TEST_CASE("a motion that a kind does not contain becomes its nearest") {
  std::mt19937 random(7);
  const WarpFrame frame = calibrated_frame();
  const MotionModel affine = Affine{{120, -80, 0.3, -0.5, 0.9, 0.1}};
  const auto params = params_of(affine);
  // Least squares over a symmetric grid: the mean velocity (which is that of the centre)...
  const MotionModel translation = convert_motion(affine, MotionKind::translation, frame, plane);
  const auto velocity = params_of(translation);
  CHECK(velocity[0] == doctest::Approx(params[0]).epsilon(1e-3));
  CHECK(velocity[1] == doctest::Approx(params[1]).epsilon(1e-3));
  // ... and no other model of the kind comes nearer.
  for (const MotionKind kind : {MotionKind::translation, MotionKind::rotation, MotionKind::similarity}) {
    const MotionModel nearest = convert_motion(affine, kind, frame, plane);
    const auto error = [&](const std::vector<double>& q) {
      double sum = 0;
      for (int i = 0; i < 5; ++i) {
        for (int j = 0; j < 5; ++j) {
          const Place at{345 * j / 4.0, 259 * i / 4.0};
          const Place a = reference_warp(affine, frame, at, 0.01),
                      b = reference_warp(kind, q, frame, at, 0.01);
          sum += (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
        }
      }
      return sum;
    };
    const std::vector<double> found(params_of(nearest).begin(), params_of(nearest).end());
    const double least = error(found);
    for (int trial = 0; trial < 50; ++trial) {
      auto other = found;
      for (std::size_t d = 0; d < other.size(); ++d) {
        const double unit = kind != MotionKind::rotation && d < 2 ? 2.0 : 0.02;
        other[d] += uniform(random, -unit, unit);
      }
      REQUIRE(error(other) > least);
    }
  }
  // A slow camera rotation is nearly planar flow.
  const MotionModel turn = Rotation{{0.3, -0.2, 0.4}};
  CHECK(largest_distance(turn, convert_motion(turn, MotionKind::homography, frame, plane), frame, 0.01) <
        0.01);
}

TEST_CASE("points are where the lens did not bend them, in seconds from t_ref, however far apart") {
  constexpr std::int64_t earliest = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t latest = std::numeric_limits<std::int64_t>::max();
  RecordedEvents events;
  events.add(2, 1, earliest);
  events.add(0, 0, -1500000);
  events.add(1, 1, 250);
  events.add(2, 0, latest);
  UndistortionTable table{{3, 2}, {10, 11, 12, 13, 14, 15}, {20, 21, 22, 23, 24, 25}};
  const Points plain = make_points(events.view(), 0);
  CHECK(plain.x == std::vector<float>{2, 0, 1, 2});
  CHECK(plain.y == std::vector<float>{1, 0, 1, 0});
  CHECK(plain.dt == std::vector<float>{-9.223372e12f, -1.5f, 250e-6f, 9.223372e12f});
  CHECK(make_points(events.view(), latest).dt.front() == doctest::Approx(-1.8446744e13));
  CHECK(make_points(events.view(), earliest).dt.back() == doctest::Approx(1.8446744e13));
  const Points table_points = make_points(events.view(), 0, &table);
  CHECK(table_points.x == std::vector<float>{15, 10, 14, 12});
  CHECK(table_points.y == std::vector<float>{25, 20, 24, 22});
  // Far from zero, microseconds still count.
  RecordedEvents late;
  late.add(0, 0, latest - 3);
  CHECK(make_points(late.view(), latest).dt.front() == -3e-6f);
}

TEST_CASE("the distance of two motions is the root mean square over the points") {
  const WarpFrame frame = make_warp_frame(sensor);
  const Points points{{10, 20, 30}, {5, 5, 5}, {-0.1f, 0.2f, 0.1f}};
  const MotionModel a = Translation{{100, 0}}, b = Translation{{100, 30}};
  CHECK(motion_distance(a, b, frame, points.view()) == doctest::Approx(std::sqrt((9 + 36 + 9) / 3.0)));
  CHECK(motion_distance(a, a, frame, points.view()) == 0);
  CHECK(motion_distance(a, b, frame, {}) == 0);
  std::vector<float> x(3), y(3);
  warp_points(points.view(), a, frame, x, y);
  CHECK(x[0] == doctest::Approx(20));
  CHECK(x[1] == doctest::Approx(0));
  CHECK(y[2] == 5);
}
