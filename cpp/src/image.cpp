#include "emseg/image.hpp"

#include <cmath>
#include <stdexcept>
#include <string>

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
  const int width = image.region.width;
  const int height = image.region.height;
  if (radius == 0 || width == 0 || height == 0) return;

  // Along rows: a padded copy of the row keeps the inner loop free of borders.
  workspace.rows.resize(std::max(image.pixels.size(), static_cast<std::size_t>(width + 2 * radius)));
  {
    float* padded = workspace.rows.data();
    std::fill(padded, padded + radius, 0.0f);
    std::fill(padded + radius + width, padded + width + 2 * radius, 0.0f);
    for (int y = 0; y < height; ++y) {
      float* row = image.row(y);
      std::copy(row, row + width, padded + radius);
      const float* centre = padded + radius;
      for (int x = 0; x < width; ++x) row[x] = taps[0] * centre[x];
      for (int d = 1; d <= radius; ++d) {
        const float tap = taps[static_cast<std::size_t>(d)];
        for (int x = 0; x < width; ++x) row[x] += tap * (centre[x - d] + centre[x + d]);
      }
    }
  }
  // Along columns: whole rows are added up, so that the inner loop runs along memory again.
  std::copy(image.pixels.begin(), image.pixels.end(), workspace.rows.begin());
  const auto source = [&](int y) {
    return workspace.rows.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
  };
  for (int y = 0; y < height; ++y) {
    float* row = image.row(y);
    const float* centre = source(y);
    for (int x = 0; x < width; ++x) row[x] = taps[0] * centre[x];
    for (int d = 1; d <= radius; ++d) {
      const float tap = taps[static_cast<std::size_t>(d)];
      if (y - d >= 0) {
        const float* above = source(y - d);
        for (int x = 0; x < width; ++x) row[x] += tap * above[x];
      }
      if (y + d < height) {
        const float* below = source(y + d);
        for (int x = 0; x < width; ++x) row[x] += tap * below[x];
      }
    }
  }
}

}  // namespace emseg
