#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "emseg/count_image.hpp"
#include "emseg/motion_evidence.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{96, 72};
constexpr Region canvas{-48, -36, 192, 144};
constexpr double window = 0.05;
const WarpFrame frame = make_warp_frame(sensor);
const MotionModel still = Translation{};

// Dots of one motion, each of one sign.
Points moving(const MotionModel& model, std::uint32_t seed) {
  Scene scene = moving_dots({{model, {20, 15, 50, 40}, 80, 12}}, frame, window, seed);
  for (const std::uint8_t positive : scene.positive) scene.points.sign.push_back(positive ? 1.0f : -1.0f);
  return scene.points;
}

std::vector<std::uint16_t> sharpness_of(const Points& points, const MotionModel& model) {
  CountWorkspace workspace;
  std::vector<std::uint16_t> sharpness(points.size());
  count_sharpness(points.view(), model, frame, canvas, workspace, sharpness);
  return sharpness;
}

// The definition: a mean of logarithms of ratios, for a motion that is a translation whatever is added to it.
double direct_loss(const Points& points, const MotionModel& own, const MotionModel& moved) {
  const auto before = sharpness_of(points, own), after = sharpness_of(points, moved);
  auto sorted = before;
  std::sort(sorted.begin(), sorted.end());
  const double quantile = sorted[static_cast<std::size_t>(0.95 * static_cast<double>(sorted.size() - 1))];
  const double floor = std::max(quantile, double{counts_per_event}) / 5;
  double sum = 0;
  for (std::size_t k = 0; k < points.size(); ++k) sum += std::log((before[k] + floor) / (after[k] + floor));
  return sum / static_cast<double>(points.size());
}

std::vector<double> losses(const Points& points, const MotionModel& own, const MotionModel& other,
                           const std::vector<Vec2f>& offsets) {
  return sharpness_losses(points.view(), own, other, offsets, window, frame, canvas);
}

// Places, times and velocities whose warps floats hold without rounding, so that both ways of adding an
// offset to a motion reach the same pixels.
Points exact_points(std::mt19937& random, std::size_t count) {
  Points points;
  for (std::size_t k = 0; k < count; ++k) {
    const double home_x = 20 + static_cast<double>(random() % 1600) / 64;
    const double home_y = 10 + static_cast<double>(random() % 1600) / 64;
    const double dt = (static_cast<double>(random() % 65) - 32) / 1024;
    for (int i = 0; i < 3; ++i) {
      points.x.push_back(static_cast<float>(home_x + 128 * dt));
      points.y.push_back(static_cast<float>(home_y - 64 * dt));
      points.dt.push_back(static_cast<float>(dt));
    }
  }
  return points;
}

}  // namespace

TEST_CASE("a motion loses nothing against itself, of whatever kind") {
  for (const MotionModel& model :
       {MotionModel(Translation{{130, -70}}), MotionModel(Rotation{{0.3, -0.5, 2}}),
        MotionModel(Similarity{{60, 90, 0.4, -0.9}}),
        MotionModel(Homography{{40, -90, 0.6, -0.3, 0.8, -0.5, 0.9, -0.7}})}) {
    const auto own = losses(moving(model, 1), model, model, {{0, 0}, {0, 0}});
    REQUIRE(own.size() == 2);
    for (const double loss : own) CHECK(loss == 0);
  }
}

TEST_CASE("losses are those of the definition, whichever motion the offset is added to") {
  std::mt19937 random(2);
  const MotionModel own = Translation{{128, -64}};
  constexpr double power = 1.0 / 16;  // window, s
  for (const bool is_signed : {false, true}) {
    CAPTURE(is_signed);
    Points points = exact_points(random, 300);
    if (is_signed) points.sign = random_signs(random, points.size());
    for (const Vec2f base : {Vec2f{128, -64}, {96, 0}, {0, 0}}) {
      const std::vector<Vec2f> offsets{{0, 0}, {1, 0}, {0, -2}, {4, 3}, {-8, 8}};
      const auto found =
          sharpness_losses(points.view(), own, Translation{{base.x, base.y}}, offsets, power, frame, canvas);
      REQUIRE(found.size() == offsets.size());
      for (std::size_t i = 0; i < offsets.size(); ++i) {
        const MotionModel moved = Translation{{base.x + offsets[i].x / power, base.y + offsets[i].y / power}};
        CHECK(found[i] == doctest::Approx(direct_loss(points, own, moved)).epsilon(1e-9));
      }
    }
  }
}

TEST_CASE("the further from the true motion, the more is lost, until nothing is left to lose") {
  const MotionModel truth = Translation{{150, -80}};
  const Points points = moving(truth, 3);
  for (const Vec2f way : {Vec2f{1, 0}, {0, 1}, {-0.6f, 0.8f}}) {
    std::vector<Vec2f> offsets;
    for (const float length : {0.0f, 2.0f, 4.0f, 8.0f}) offsets.push_back({length * way.x, length * way.y});
    const auto found = losses(points, truth, truth, offsets);
    for (std::size_t i = 1; i < found.size(); ++i) CHECK(found[i] > found[i - 1] + 0.02);
    // What is left of one event of each dot: no motion can lose more than all but the floor.
    CHECK(found.back() < std::log(6.0 / 0.2));
  }
  // An offset that makes up for what the other motion lacks loses nothing but what rounding moves.
  const MotionModel slow = Translation{{150 - 3 / window, -80 + 2 / window}};
  const auto made_up = losses(points, truth, slow, {{0, 0}, {3, -2}});
  CHECK(made_up[0] > 0.2);
  CHECK(std::abs(made_up[1]) < 1e-3);
}

TEST_CASE("no points, no losses; no offsets, none either; off the canvas all is lost alike") {
  CHECK(sharpness_losses({}, still, still, std::vector<Vec2f>{{0, 0}}, window, frame, canvas).empty());
  const Points points = moving(still, 4);
  CHECK(losses(points, still, still, {}).empty());
  const auto gone = losses(points, still, Translation{{1e9, 1e9}}, {{0, 0}, {5, 5}});
  const auto sharpness = sharpness_of(points, still);
  CHECK(gone[0] == doctest::Approx(gone[1]));
  CHECK(gone[0] > 1);
  CHECK(std::isfinite(gone[0]));
}
