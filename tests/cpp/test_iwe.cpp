#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "central_differences.hpp"
#include "emseg/iwe.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr float no_number = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

// The definition of the bilinear vote: a hat of one pixel's half-width in either direction.
double hat(double x, double y, int column, int row) {
  return std::max(0.0, 1 - std::abs(x - column)) * std::max(0.0, 1 - std::abs(y - row));
}

double mass(const Image& image) { return std::accumulate(image.pixels.begin(), image.pixels.end(), 0.0); }

Image random_image(std::mt19937& random, Region region) {
  Image image(region);
  for (float& pixel : image.pixels) pixel = static_cast<float>(uniform(random, -1, 1));
  return image;
}

}  // namespace

TEST_CASE("a vote is a hat around its place, cut at the border") {
  std::mt19937 random(1);
  for (const Region region : {Region{0, 0, 7, 5}, {-3, 4, 6, 6}, {10, -20, 1, 1}, {0, 0, 1, 8}}) {
    for (int trial = 0; trial < 300; ++trial) {
      auto x = static_cast<float>(uniform(random, region.x0 - 2, region.x0 + region.width + 1));
      auto y = static_cast<float>(uniform(random, region.y0 - 2, region.y0 + region.height + 1));
      if (trial % 3 == 0) x = std::round(x);
      if (trial % 4 == 0) y = std::round(y);
      Image image(region);
      bilinear_vote(image, x, y, 2.5f);
      for (int row = 0; row < region.height; ++row) {
        for (int column = 0; column < region.width; ++column) {
          REQUIRE(std::abs(image.row(row)[column] - 2.5 * hat(x, y, region.x0 + column, region.y0 + row)) <
                  5e-6);
        }
      }
    }
  }
}

TEST_CASE("inside, no part of a vote is lost") {
  std::mt19937 random(2);
  Image image(Region{-8, 3, 40, 30});
  for (int k = 0; k < 1000; ++k) {
    bilinear_vote(image, static_cast<float>(uniform(random, -8, 31)),
                  static_cast<float>(uniform(random, 3, 32)));
  }
  CHECK(mass(image) == doctest::Approx(1000).epsilon(1e-6));
}

TEST_CASE("places far outside, infinite or undefined neither vote nor have a value") {
  Image image(Region{0, 0, 6, 6});
  for (const float odd : {no_number, infinity, -infinity, 3e38f, -3e38f, 1e10f, -1.0f, 6.0f}) {
    CAPTURE(odd);
    bilinear_vote(image, odd, 2);
    bilinear_vote(image, 2, odd);
    CHECK(mass(image) == 0);
    Image ones(Region{0, 0, 6, 6});
    ones.pixels.assign(36, 1.0f);
    CHECK(bilinear_value(ones, odd, 2) == 0);
    const BilinearSample sample = bilinear_sample(ones, 2, odd);
    CHECK((sample.value == 0 && sample.dx == 0 && sample.dy == 0));
  }
}

TEST_CASE("the last place before the border, where floats round up to it, votes inside") {
  // Next below a power of two, adding 1 rounds to the power of two plus 1.
  for (const int side : {1, 2, 4, 64, 512}) {
    CAPTURE(side);
    const float last = std::nextafter(static_cast<float>(side), 0.0f);
    Image image(Region{0, 0, side, side});
    bilinear_vote(image, last, last);
    bilinear_vote(image, 0, last);
    bilinear_vote(image, last, 0);
    CHECK(std::abs(mass(image)) < 1e-4);
    const double middle = mass(image);
    bilinear_vote(image, std::nextafter(-1.0f, 0.0f), 0);
    CHECK(mass(image) - middle < 1e-6);
  }
}

TEST_CASE("sampling is the adjoint of voting") {
  std::mt19937 random(5);
  const Region region{-2, 6, 9, 7};
  const Image image = random_image(random, region);
  for (int trial = 0; trial < 500; ++trial) {
    const auto x = static_cast<float>(uniform(random, -4, 9)), y = static_cast<float>(uniform(random, 4, 15));
    double expected = 0;
    for (int row = 0; row < region.height; ++row) {
      for (int column = 0; column < region.width; ++column) {
        expected += hat(x, y, region.x0 + column, region.y0 + row) * image.row(row)[column];
      }
    }
    REQUIRE(std::abs(bilinear_value(image, x, y) - expected) < 2e-6);
  }
}

TEST_CASE("slopes of a sample are those of the interpolation") {
  std::mt19937 random(6);
  const Region region{3, -5, 8, 6};
  const Image image = random_image(random, region);
  for (int trial = 0; trial < 300; ++trial) {
    // A step of 1/16 from the middle of a pixel stays within it; the interpolation is bilinear there, so the
    // difference is exact but for rounding.
    const double x = std::floor(uniform(random, 2, 11)) + uniform(random, 0.1, 0.9);
    const double y = std::floor(uniform(random, -6, 1)) + uniform(random, 0.1, 0.9);
    const auto slopes = central_differences(
        [&](const std::vector<double>& at) {
          return bilinear_value(image, static_cast<float>(at[0]), static_cast<float>(at[1]));
        },
        {x, y}, {1.0 / 16, 1.0 / 16});
    const BilinearSample sample = bilinear_sample(image, static_cast<float>(x), static_cast<float>(y));
    REQUIRE(std::abs(sample.dx - slopes[0]) < 2e-5);
    REQUIRE(std::abs(sample.dy - slopes[1]) < 2e-5);
  }
}

TEST_CASE("the image of warped events is the blurred sum of signed votes at the warped places") {
  const WarpFrame frame = make_warp_frame({48, 36});
  const MotionModel model = Similarity{{120, -60, 0.4, 0.8}};
  // More than a chunk of the warp.
  Scene scene = moving_dots({{model, {4, 4, 40, 28}, 75, 8}}, frame, 0.05, 9);
  std::mt19937 random(10);
  for (const bool is_signed : {false, true}) {
    CAPTURE(is_signed);
    if (is_signed) scene.points.sign = random_signs(random, scene.size());
    Image image(Region{-6, -4, 60, 44});
    const Region region = image.region;
    image.row(0)[0] = 100;  // what was there before goes
    IweWorkspace workspace;
    make_iwe(image, scene.view(), model, frame, gaussian_taps(0), workspace);
    for (int row = 0; row < region.height; ++row) {
      for (int column = 0; column < region.width; ++column) {
        double expected = 0;
        for (std::size_t k = 0; k < scene.size(); ++k) {
          const Place at =
              reference_warp(model, frame, {scene.points.x[k], scene.points.y[k]}, scene.points.dt[k]);
          const double vote = is_signed ? scene.points.sign[k] : 1;
          expected += vote * hat(at.x, at.y, region.x0 + column, region.y0 + row);
        }
        REQUIRE(std::abs(image.row(row)[column] - expected) < 2e-4);
      }
    }
    Image blurred = image, made(region);
    gaussian_blur(blurred, gaussian_taps(1.2), workspace.blur);
    make_iwe(made, scene.view(), model, frame, gaussian_taps(1.2), workspace);
    CHECK(made.pixels == blurred.pixels);
  }
}

TEST_CASE("a bounding region is the smallest that holds all votes") {
  std::mt19937 random(8);
  const Region limit{-20, -10, 60, 50};
  for (int trial = 0; trial < 200; ++trial) {
    const std::size_t count = 1 + random() % 5;
    const int margin = static_cast<int>(random() % 4);
    std::vector<float> x, y;
    int left = 1000, right = -1000, top = 1000, bottom = -1000;
    for (std::size_t k = 0; k < count; ++k) {
      x.push_back(static_cast<float>(std::floor(uniform(random, -20, 39)) + uniform(random, 0.1, 0.9)));
      y.push_back(static_cast<float>(std::floor(uniform(random, -10, 39)) + uniform(random, 0.1, 0.9)));
      left = std::min(left, static_cast<int>(std::floor(x[k])));
      right = std::max(right, static_cast<int>(std::ceil(x[k])));
      top = std::min(top, static_cast<int>(std::floor(y[k])));
      bottom = std::max(bottom, static_cast<int>(std::ceil(y[k])));
    }
    left = std::max(left - margin, -20);
    right = std::min(right + margin, 39);
    top = std::max(top - margin, -10);
    bottom = std::min(bottom + margin, 39);
    REQUIRE(bounding_region(x, y, margin, limit) == Region{left, top, right - left + 1, bottom - top + 1});
  }
}

TEST_CASE("a bounding region stays within its limit whatever the places are") {
  const Region limit{-3, 2, 8, 9};
  const auto within = [&](const Region& r) {
    return r.x0 >= limit.x0 && r.y0 >= limit.y0 && r.x0 + r.width <= limit.x0 + limit.width &&
           r.y0 + r.height <= limit.y0 + limit.height && r.width >= 0 && r.height >= 0;
  };
  const std::vector<float> odd{no_number, infinity, -infinity, 3e38f, -3e38f, 0.5f, -100, 100};
  for (const float x : odd) {
    for (const float y : odd) {
      CHECK(within(bounding_region(std::vector{x}, std::vector{y}, 2, limit)));
      CHECK(within(bounding_region(std::vector{x, y}, std::vector{y, x}, 0, limit)));
    }
  }
  CHECK(bounding_region({}, {}, 5, limit).area() == 0);
  CHECK(bounding_region(std::vector{1.0f}, std::vector{1.0f}, 5, {0, 0, 0, 7}).area() == 0);
  // Votes of an event that left the region to one side still fall on its border.
  const Region border = bounding_region(std::vector{-3.5f}, std::vector{4.5f}, 0, limit);
  CHECK((border.x0 == -3 && border.width >= 1));
}

TEST_CASE("the image plane holds every undistorted pixel; the canvas half as much again") {
  CHECK(image_plane({30, 20}) == Region{0, 0, 30, 20});
  const UndistortionTable table{{2, 2}, {-1.25f, 2.0f, 0.0f, 3.5f}, {-0.5f, 0.0f, 4.0f, 4.25f}};
  CHECK(image_plane({2, 2}, &table) == Region{-2, -1, 7, 7});
  CHECK(canvas_of({-2, 0, 11, 20}) == Region{-7, -10, 21, 40});
}
