#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "emseg/image.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using emseg::testing::uniform;

namespace {

Image random_image(std::mt19937& random, Region region) {
  Image image(region);
  for (float& pixel : image.pixels) pixel = static_cast<float>(uniform(random, -1, 3));
  return image;
}

// The definition: a weighted sum over all pixels, each weight a product of two taps.
double convolved(const Image& image, const std::vector<float>& taps, int x, int y) {
  double sum = 0;
  for (int v = 0; v < image.region.height; ++v) {
    for (int u = 0; u < image.region.width; ++u) {
      const auto across = static_cast<std::size_t>(std::abs(u - x)),
                 down = static_cast<std::size_t>(std::abs(v - y));
      if (across < taps.size() && down < taps.size())
        sum += double(taps[across]) * taps[down] * image.row(v)[u];
    }
  }
  return sum;
}

double inner_product(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += double(a.pixels[i]) * b.pixels[i];
  return sum;
}

}  // namespace

TEST_CASE("Gaussian taps are samples of the bell, normalised, out to four sigma") {
  for (const double sigma : {0.3, 0.7, 1.0, 2.6}) {
    CAPTURE(sigma);
    const auto taps = gaussian_taps(sigma);
    CHECK(taps.size() == static_cast<std::size_t>(4 * sigma + 0.5) + 1);
    double sum = taps[0];
    for (std::size_t d = 1; d < taps.size(); ++d) {
      sum += 2.0 * taps[d];
      CHECK(taps[d] / taps[0] ==
            doctest::Approx(std::exp(-double(d * d) / (2 * sigma * sigma))).epsilon(1e-6));
    }
    CHECK(sum == doctest::Approx(1).epsilon(1e-6));
  }
  CHECK(gaussian_taps(0) == std::vector<float>{1.0f});
}

TEST_CASE("a blur that is negative, too wide or no number is refused") {
  for (const double sigma : {-0.1, 101.0, std::numeric_limits<double>::quiet_NaN()}) {
    CHECK_THROWS_AS(gaussian_taps(sigma), std::invalid_argument);
  }
}

TEST_CASE("the separable blur equals the two-dimensional convolution") {
  std::mt19937 random(3);
  BlurWorkspace workspace;  // shared, so that leftovers of larger images would show
  for (const Region region :
       {Region{0, 0, 19, 23}, {-4, 7, 31, 5}, {0, 0, 1, 17}, {0, 0, 2, 2}, {5, 5, 1, 1}}) {
    for (const double sigma : {0.0, 0.6, 1.0, 2.5}) {
      CAPTURE(region.width);
      CAPTURE(sigma);
      const auto taps = gaussian_taps(sigma);
      const Image image = random_image(random, region);
      Image blurred = image;
      gaussian_blur(blurred, taps, workspace);
      CHECK(blurred.region == region);
      for (int y = 0; y < region.height; ++y) {
        for (int x = 0; x < region.width; ++x) {
          REQUIRE(std::abs(blurred.row(y)[x] - convolved(image, taps, x, y)) < 2e-6);
        }
      }
    }
  }
}

TEST_CASE("an empty image stays empty") {
  Image image(Region{3, 4, 0, 5});
  BlurWorkspace workspace;
  gaussian_blur(image, gaussian_taps(1), workspace);
  CHECK(image.pixels.empty());
}

TEST_CASE("the blur is its own adjoint") {
  std::mt19937 random(4);
  BlurWorkspace workspace;
  for (int trial = 0; trial < 10; ++trial) {
    const Region region{0, 0, 1 + static_cast<int>(random() % 40), 1 + static_cast<int>(random() % 40)};
    const auto taps = gaussian_taps(uniform(random, 0.3, 3));
    const Image a = random_image(random, region), b = random_image(random, region);
    Image blurred_a = a, blurred_b = b;
    gaussian_blur(blurred_a, taps, workspace);
    gaussian_blur(blurred_b, taps, workspace);
    CHECK(inner_product(blurred_a, b) == doctest::Approx(inner_product(a, blurred_b)).epsilon(1e-6));
  }
}

TEST_CASE("resetting an image covers the new region with zeros") {
  Image image(Region{0, 0, 3, 2});
  image.row(1)[2] = 5;
  image.reset({1, 1, 2, 2});
  CHECK(image.region == Region{1, 1, 2, 2});
  CHECK(image.pixels == std::vector<float>(4, 0.0f));
  CHECK(expanded({2, 3, 4, 5}, 1, 2) == Region{1, 1, 6, 9});
}
