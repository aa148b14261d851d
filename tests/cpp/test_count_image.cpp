#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "emseg/count_image.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();
const WarpFrame frame = make_warp_frame({64, 48});
const MotionModel still = Translation{};

std::vector<std::uint16_t> counted(const Points& points, const MotionModel& model, Region canvas) {
  CountWorkspace workspace;
  std::vector<std::uint16_t> sharpness(points.size(), 12345);
  count_sharpness(points.view(), model, frame, canvas, workspace, sharpness);
  return sharpness;
}

// The definition, pixel by pixel; exact as long as the warped places are.
std::vector<int> defined_counts(const Points& points, const MotionModel& model, Region canvas) {
  constexpr std::array weight{1, 4, 6, 4, 1};
  std::map<std::pair<long, long>, int> votes;
  std::vector<std::pair<long, long>> pixel_of;
  const auto sign = [&](std::size_t k) { return points.sign.empty() ? 1 : static_cast<int>(points.sign[k]); };
  const auto on_canvas = [&](const std::pair<long, long>& pixel) {
    return pixel.first >= canvas.x0 && pixel.first < canvas.x0 + canvas.width && pixel.second >= canvas.y0 &&
           pixel.second < canvas.y0 + canvas.height;
  };
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Place place =
        reference_warp(model, frame, {points.x[k], points.y[k]}, static_cast<double>(points.dt[k]));
    const auto nearest = [](double value) {
      return std::abs(value) < 1e9 ? static_cast<long>(std::floor(value + 0.5)) : 1'000'000'000L;
    };
    pixel_of.emplace_back(nearest(place.x), nearest(place.y));
    if (on_canvas(pixel_of.back())) votes[pixel_of.back()] += sign(k);
  }
  for (auto& [pixel, sum] : votes) sum = std::clamp(sum, -127, 127);
  std::vector<int> counts;
  for (std::size_t k = 0; k < points.size(); ++k) {
    const auto [x, y] = pixel_of[k];
    int sum = 0;
    for (int j = -2; j <= 2; ++j) {
      for (int i = -2; i <= 2; ++i) {
        const auto found = votes.find({x + i, y + j});
        if (found != votes.end()) {
          sum += weight[static_cast<std::size_t>(j + 2)] * weight[static_cast<std::size_t>(i + 2)] *
                 found->second;
        }
      }
    }
    counts.push_back(on_canvas({x, y}) ? std::max(0, sign(k) * sum) / (256 / counts_per_event) : 0);
  }
  return counts;
}

void check_counts(const Points& points, const MotionModel& model, Region canvas) {
  const auto found = counted(points, model, canvas);
  const auto expected = defined_counts(points, model, canvas);
  for (std::size_t k = 0; k < found.size(); ++k) {
    CAPTURE(points.x[k]);
    CAPTURE(points.y[k]);
    REQUIRE(found[k] == expected[k]);
    REQUIRE(found[k] < count_levels);
  }
}

void add(Points& points, float x, float y, float dt = 0) {
  points.x.push_back(x);
  points.y.push_back(y);
  points.dt.push_back(dt);
}

// Places and times in 64ths, which floats add up without rounding.
Points random_points(std::mt19937& random, std::size_t count, Region within) {
  Points points;
  const auto sixty_fourths = [&](int begin, int length) {
    return static_cast<float>(begin) +
           static_cast<float>(random() % (64u * static_cast<unsigned>(length))) / 64;
  };
  for (std::size_t k = 0; k < count; ++k) {
    add(points, sixty_fourths(within.x0, within.width), sixty_fourths(within.y0, within.height),
        sixty_fourths(-1, 2));
  }
  return points;
}

}  // namespace

TEST_CASE("counts are votes of the nearest pixels under a binomial, on the canvas and off it") {
  std::mt19937 random(1);
  // The points lie all over the canvas, beyond its edges, in a corner of it, and nowhere near.
  const Region canvas{-20, -15, 70, 50};
  for (const Region within :
       {canvas, Region{-30, -25, 90, 70}, {-20, -15, 3, 3}, {47, 33, 6, 5}, {500, 500, 9, 9}}) {
    for (const std::size_t count : {1u, 2u, 30u, 400u, 3000u}) {
      for (const MotionModel& model : {still, MotionModel(Translation{{16, -8}})}) {
        Points points = random_points(random, count, within);
        check_counts(points, model, canvas);
        points.sign = random_signs(random, count);
        check_counts(points, model, canvas);
      }
    }
  }
}

TEST_CASE("canvases of one pixel, one row and one column") {
  std::mt19937 random(2);
  for (const Region canvas : {Region{5, 6, 1, 1}, {0, 3, 40, 1}, {-7, 0, 1, 30}}) {
    check_counts(random_points(random, 500, expanded(canvas, 3, 3)), still, canvas);
  }
}

TEST_CASE("a pixel's area is half-open: its left and upper edges are its own") {
  const Region canvas{10, 20, 4, 3};
  Points points;
  for (const float x : {9.499999f, 9.5f, 13.0f, 13.499999f, 13.5f}) add(points, x, 21);
  for (const float y : {19.499998f, 19.5f, 22.499998f, 22.5f}) add(points, 11, y);
  check_counts(points, still, canvas);
  const auto counts = counted(points, still, canvas);
  for (const std::size_t off : {0u, 4u, 5u, 8u}) CHECK(counts[off] == 0);
  for (const std::size_t on : {1u, 2u, 3u, 6u, 7u}) CHECK(counts[on] > 0);
}

TEST_CASE("an event alone counts 36/256 of an event, coinciding ones as many times that") {
  for (int events = 1; events <= 20; ++events) {
    Points points;
    for (int k = 0; k < events; ++k) add(points, 7.2f, 30.4f);
    CHECK(counted(points, still, {0, 0, 64, 48}).back() == 36 * events / 16);
  }
}

TEST_CASE("hot pixels count as 127 events and leave their neighbours' counts in range") {
  for (const int events : {126, 127, 128, 255, 65'535, 65'536, 70'000}) {
    Points points;
    for (int k = 0; k < events; ++k) add(points, 20, 20);
    add(points, 21, 20);
    check_counts(points, still, {0, 0, 64, 48});
  }
  // A neighbourhood of nothing but hot pixels reaches the last level.
  Points points;
  for (int k = 0; k < 300; ++k) {
    for (int j = -2; j <= 2; ++j) {
      for (int i = -2; i <= 2; ++i) add(points, static_cast<float>(20 + i), static_cast<float>(20 + j));
    }
  }
  const auto counts = counted(points, still, {0, 0, 64, 48});
  CHECK(*std::max_element(counts.begin(), counts.end()) == count_levels - 1);
  check_counts(points, still, {0, 0, 64, 48});
  // As do falls.
  points.sign.assign(points.size(), -1.0f);
  CHECK(counted(points, still, {0, 0, 64, 48}) == counts);
}

TEST_CASE("of hot pixels the excess of one sign counts, whatever came first") {
  std::mt19937 random(8);
  for (const std::size_t rises : {0, 100, 127, 500, 20'000}) {
    for (const std::size_t falls : {1, 300, 10'000}) {
      Points points;
      for (std::size_t k = 0; k <= rises + falls; ++k) add(points, k == 0 ? 21 : 20, 20);
      points.sign.assign(rises + 1, 1.0f);
      points.sign.resize(points.size(), -1.0f);
      check_counts(points, still, {0, 0, 64, 48});
      std::shuffle(points.sign.begin() + 1, points.sign.end(), random);
      check_counts(points, still, {0, 0, 64, 48});
    }
  }
}

TEST_CASE("rises and falls take each other away, and neither counts for more") {
  std::mt19937 random(5);
  const Region canvas{0, 0, 64, 48};
  Points points = random_points(random, 2000, {10, 10, 20, 15});
  const auto unsigned_counts = counted(points, still, canvas);
  points.sign.assign(points.size(), 1.0f);
  CHECK(counted(points, still, canvas) == unsigned_counts);
  points.sign.assign(points.size(), -1.0f);
  CHECK(counted(points, still, canvas) == unsigned_counts);
  points.sign = random_signs(random, points.size());
  const auto counts = counted(points, still, canvas);
  for (float& sign : points.sign) sign = -sign;
  CHECK(counted(points, still, canvas) == counts);
  for (std::size_t k = 0; k < counts.size(); ++k) REQUIRE(counts[k] <= unsigned_counts[k]);
  CHECK(std::count(counts.begin(), counts.end(), 0) > 100);

  Points pair;
  add(pair, 20, 20);
  add(pair, 20, 20);
  pair.sign = {1, -1};
  CHECK(counted(pair, still, canvas) == std::vector<std::uint16_t>{0, 0});
}

TEST_CASE("undefined and infinite places count nothing and disturb nobody") {
  std::mt19937 random(3);
  const Region canvas{0, 0, 64, 48};
  Points sound = random_points(random, 200, canvas);
  for (float& dt : sound.dt) dt = 0;  // so that no motion takes them anywhere
  const std::size_t n = sound.size();
  const auto expected = counted(sound, still, canvas);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  Points points = sound;
  for (const float bad : {nan, infinity, -infinity, 3e38f, -3e38f}) {
    add(points, bad, 10);
    add(points, 10, bad);
    add(points, bad, bad);
  }
  add(points, 10, 10, 1e30f);  // thrown infinitely far
  for (const MotionModel& model : {still, MotionModel(Translation{{1e30, -1e30}})}) {
    const auto found = counted(points, model, canvas);
    for (std::size_t k = 0; k < n; ++k) REQUIRE(found[k] == expected[k]);
    for (std::size_t k = n; k < n + 15; ++k) REQUIRE(found[k] == 0);
    if (kind_of(model) == MotionKind::translation && params_of(model)[0] != 0) CHECK(found.back() == 0);
  }
}

TEST_CASE("no points have no counts; a workspace remembers nothing") {
  CHECK(counted({}, still, {0, 0, 64, 48}).empty());
  std::mt19937 random(4);
  CountWorkspace workspace;
  // Larger and smaller images in turn.
  for (const Region within : {Region{0, 0, 64, 48}, {30, 30, 4, 4}, {-40, -40, 120, 120}, {5, 5, 20, 2}}) {
    const Points points = random_points(random, 300, within);
    std::vector<std::uint16_t> sharpness(points.size());
    count_sharpness(points.view(), still, frame, {-50, -50, 160, 160}, workspace, sharpness);
    CHECK(sharpness == counted(points, still, {-50, -50, 160, 160}));
  }
}
