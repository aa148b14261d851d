#include "emseg/image.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

#include "row_blur.hpp"

namespace emseg {

std::vector<float> gaussian_taps(double sigma) {
  if (!(sigma >= 0) || sigma > 100) {
    throw std::invalid_argument("blur sigma is " + std::to_string(sigma) + " px, expected 0..100");
  }
  if (sigma == 0) return {1.0f};
  const int radius = static_cast<int>(4 * sigma + 0.5);
  std::vector<double> samples(static_cast<std::size_t>(radius) + 1);
  double sum = 0;
  for (int d = 0; d <= radius; ++d) {
    samples[static_cast<std::size_t>(d)] = std::exp(-0.5 * d * d / (sigma * sigma));
    sum += (d == 0 ? 1 : 2) * samples[static_cast<std::size_t>(d)];
  }
  std::vector<float> taps;
  for (const double sample : samples) taps.push_back(static_cast<float>(sample / sum));
  return taps;
}

void gaussian_blur(Image& image, std::span<const float> taps, BlurWorkspace& workspace) {
  const int radius = static_cast<int>(taps.size()) - 1;
  if (radius == 0 || image.region.area() == 0) return;
  const auto width = static_cast<std::size_t>(image.region.width);
  RowBlur blur(width, taps, workspace);
  // A row leaves the second pass `radius` rows after it has entered the first: in place, and while its
  // neighbours are still in the cache.
  for (int y = 0; y < image.region.height + radius; ++y) {
    if (y < image.region.height) {
      std::copy_n(image.row(y), width, blur.input());
      blur.push();
    } else {
      blur.push_zeros();
    }
    if (y >= radius) blur.pull(image.row(y - radius));
  }
}

}  // namespace emseg
