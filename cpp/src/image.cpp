#include "emseg/image.hpp"

#include <array>
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

namespace {

// Both passes with the radius known to the compiler, so that all taps of a pixel are added up in registers.
// The first writes to `rows`, the second back to the image; a row of zeros stands for those outside.
template <int Radius>
void blur_passes(Image& image, std::span<const float> taps, BlurWorkspace& workspace) {
  const auto width = static_cast<std::size_t>(image.region.width);
  const auto height = static_cast<std::size_t>(image.region.height);
  constexpr std::size_t radius = Radius;
  std::array<float, radius + 1> tap{};
  std::copy(taps.begin(), taps.end(), tap.begin());

  workspace.rows.resize(width * height);
  workspace.padded.assign(width + 2 * radius, 0.0f);
  float* const centre = workspace.padded.data() + radius;
  for (std::size_t y = 0; y < height; ++y) {
    std::copy_n(image.pixels.data() + y * width, width, centre);
    float* const out = workspace.rows.data() + y * width;
    for (std::size_t x = 0; x < width; ++x) {
      float sum = tap[0] * centre[x];
      for (std::size_t d = 1; d <= radius; ++d)
        sum += tap[d] * ((centre + x)[-static_cast<std::ptrdiff_t>(d)] + centre[x + d]);
      out[x] = sum;
    }
  }

  workspace.padded.assign(width + 2 * radius, 0.0f);
  for (std::size_t y = 0; y < height; ++y) {
    std::array<const float*, 2 * radius + 1> row{};
    for (std::size_t i = 0; i < row.size(); ++i) {
      const bool inside = y + i >= radius && y + i - radius < height;
      row[i] = inside ? workspace.rows.data() + (y + i - radius) * width : workspace.padded.data();
    }
    float* const out = image.pixels.data() + y * width;
    for (std::size_t x = 0; x < width; ++x) {
      float sum = tap[0] * row[radius][x];
      for (std::size_t d = 1; d <= radius; ++d) sum += tap[d] * (row[radius - d][x] + row[radius + d][x]);
      out[x] = sum;
    }
  }
}

template <int Radius>
void blur_of_radius(int radius, Image& image, std::span<const float> taps, BlurWorkspace& workspace) {
  if constexpr (Radius <= 8) {
    if (radius == Radius) return blur_passes<Radius>(image, taps, workspace);
    return blur_of_radius<Radius + 1>(radius, image, taps, workspace);
  } else {
    // Wide kernels are rare: the taps are added one after the other.
    const auto width = static_cast<std::size_t>(image.region.width);
    const auto height = static_cast<std::size_t>(image.region.height);
    const auto add_shifted = [&](const std::vector<float>& from, std::size_t step, std::size_t length,
                                 auto position_of) {
      for (std::size_t i = 0; i < from.size(); ++i) {
        const std::size_t position = position_of(i);
        float sum = taps[0] * from[i];
        for (std::size_t d = 1; d < taps.size(); ++d) {
          if (position >= d) sum += taps[d] * from[i - d * step];
          if (position + d < length) sum += taps[d] * from[i + d * step];
        }
        image.pixels[i] = sum;
      }
    };
    workspace.rows = image.pixels;
    add_shifted(workspace.rows, 1, width, [&](std::size_t i) { return i % width; });
    workspace.rows = image.pixels;
    add_shifted(workspace.rows, width, height, [&](std::size_t i) { return i / width; });
  }
}

}  // namespace

void gaussian_blur(Image& image, std::span<const float> taps, BlurWorkspace& workspace) {
  const int radius = static_cast<int>(taps.size()) - 1;
  if (radius == 0 || image.region.area() == 0) return;
  blur_of_radius<1>(radius, image, taps, workspace);
}

}  // namespace emseg
