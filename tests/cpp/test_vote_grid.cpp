#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "emseg/iwe.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

struct Spots {
  std::vector<float> x, y;
};

// In, on and around the region; some at whole pixels, some nowhere.
Spots spots(std::mt19937& random, Region region, std::size_t count) {
  Spots places;
  for (std::size_t k = 0; k < count; ++k) {
    auto x = static_cast<float>(uniform(random, region.x0 - 2.5, region.x0 + region.width + 1.5));
    auto y = static_cast<float>(uniform(random, region.y0 - 2.5, region.y0 + region.height + 1.5));
    if (k % 5 == 0) x = std::round(x);
    if (k % 7 == 0) y = std::round(y);
    if (k % 31 == 0) x = std::numeric_limits<float>::quiet_NaN();
    if (k % 37 == 0) y = -std::numeric_limits<float>::infinity();
    places.x.push_back(x);
    places.y.push_back(y);
  }
  return places;
}

// The grid's votes as an image over its region.
Image taken(VoteGrid& grid, Region region) {
  Image image(region);
  const Region voted = grid.voted();
  for (int y = voted.y0; y < voted.y0 + voted.height; ++y) grid.take_row(y, image.row(y) + voted.x0);
  return image;
}

}  // namespace

TEST_CASE("a grid collects what single votes add up to, one region after the other") {
  std::mt19937 random(1);
  VoteGrid grid;  // one for all: leftovers would show
  VotePlaces places;
  for (const Region region :
       {Region{0, 0, 40, 30}, {-7, 3, 61, 12}, {5, 5, 1, 1}, {0, 0, 1, 25}, {2, -9, 33, 1}}) {
    for (const std::size_t count : {1u, 15u, 700u}) {
      CAPTURE(region.width);
      CAPTURE(count);
      const Spots at = spots(random, region, count);
      // Without signs, with signs, and with some in the first part alone, as if all others were 1.
      for (const std::size_t signed_votes : {std::size_t{0}, count, count / 2}) {
        std::vector<float> sign = random_signs(random, count);
        std::fill(sign.begin() + static_cast<std::ptrdiff_t>(signed_votes), sign.end(), 1.0f);
        Image expected(region);
        for (std::size_t k = 0; k < count; ++k) bilinear_vote(expected, at.x[k], at.y[k], sign[k]);
        places.resize(count);
        grid.reset(region);
        // In two parts, which the places are kept of.
        const std::size_t half = count / 2;
        const auto signs = [&](std::size_t first, std::size_t n) {
          return signed_votes > first ? std::span<const float>(sign).subspan(first, n)
                                      : std::span<const float>{};
        };
        grid.vote(std::span(at.x).first(half), std::span(at.y).first(half), signs(0, half), places);
        grid.vote(std::span(at.x).subspan(half), std::span(at.y).subspan(half), signs(half, count - half),
                  places, half);
        const Image image = taken(grid, region);
        for (std::size_t i = 0; i < image.pixels.size(); ++i) {
          REQUIRE(std::abs(image.pixels[i] - expected.pixels[i]) < 2e-5f);
        }
        CHECK(grid.voted().area() == 0);
      }
    }
  }
}

TEST_CASE("votes that were not taken are gone after a reset") {
  VoteGrid grid;
  VotePlaces places;
  places.resize(2);
  grid.reset({0, 0, 20, 20});
  grid.vote(std::vector{3.5f, 19.5f}, std::vector{4.5f, 19.5f}, {}, places);
  CHECK(grid.voted() == Region{3, 4, 17, 16});
  grid.reset({0, 0, 9, 20});
  CHECK(grid.voted().area() == 0);
  grid.vote(std::vector{8.25f, -9.0f}, std::vector{0.0f, 0.0f}, {}, places);
  const Image image = taken(grid, {0, 0, 9, 20});
  for (int i = 0; i < 9 * 20; ++i)
    CHECK(image.pixels[static_cast<std::size_t>(i)] == (i == 8 ? 0.75f : 0.0f));
}

TEST_CASE("the sampled image of warped events is the image's value at their places, seen by their signs") {
  const WarpFrame frame = make_warp_frame({48, 36});
  const Region canvas{-10, -8, 68, 52};
  const MotionModel truth = Similarity{{120, -60, 0.4, 0.8}};
  const Scene scene = moving_dots({{truth, {4, 4, 40, 28}, 30, 8}}, frame, 0.05, 9);
  std::mt19937 random(9);
  IweWorkspace workspace;
  enum class Signs { none, mixed, falls };
  for (const Signs signs : {Signs::none, Signs::mixed, Signs::falls}) {
    CAPTURE(static_cast<int>(signs));
    Points points = scene.points;
    if (signs == Signs::mixed) points.sign = random_signs(random, scene.size());
    if (signs == Signs::falls) points.sign.assign(scene.size(), -1.0f);
    const auto sign = [&](std::size_t k) { return points.sign.empty() ? 1.0f : points.sign[k]; };
    for (const double sigma : {0.0, 0.7, 1.3}) {
      CAPTURE(sigma);
      const auto taps = gaussian_taps(sigma);
      for (const MotionModel& model :
           {truth, MotionModel(Rotation{{0.5, 1, 2}}), MotionModel(Translation{{2000, 0}}),
            MotionModel(Translation{{1e30, 0}})}) {
        std::vector<float> values(points.size(), -1.0f);
        const float peak = sample_iwe(points.view(), model, frame, canvas, taps, workspace, values);
        Image image(canvas);
        std::vector<float> x(points.size()), y(points.size());
        warp_points(points.view(), model, frame, x, y);
        for (std::size_t k = 0; k < points.size(); ++k) bilinear_vote(image, x[k], y[k], sign(k));
        gaussian_blur(image, taps, workspace.blur);
        // A blur that reaches beyond where the events are loses what falls there; within, nothing differs.
        for (std::size_t k = 0; k < points.size(); ++k) {
          REQUIRE(values[k] >= 0);
          const float own = std::max(0.0f, sign(k) * bilinear_value(image, x[k], y[k]));
          REQUIRE(values[k] == doctest::Approx(own).epsilon(1e-4));
        }
        float largest = 0;
        for (const float pixel : image.pixels) largest = std::max(largest, std::abs(pixel));
        CHECK(peak == doctest::Approx(largest).epsilon(1e-4));
      }
    }
  }
}
