// Single-channel images and the regions of the image plane that they cover.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "emseg/aligned.hpp"

namespace emseg {

// A rectangle of whole pixels: columns x0 .. x0+width-1, rows y0 .. y0+height-1.  It may reach beyond the
// sensor.
struct Region {
  int x0 = 0;
  int y0 = 0;
  int width = 0;
  int height = 0;

  std::size_t area() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  friend bool operator==(const Region&, const Region&) = default;
};

// The region with `x` more columns on either side and `y` more rows.
inline Region expanded(Region region, int x, int y) {
  return {region.x0 - x, region.y0 - y, region.width + 2 * x, region.height + 2 * y};
}

// Row-major float image over a region.  Pixel centres lie on whole coordinates.
struct Image {
  Region region;
  std::vector<float> pixels;

  Image() = default;
  explicit Image(Region covered) { reset(covered); }

  // Covers `covered` with zeros, keeping the memory it has.
  void reset(Region covered) {
    region = covered;
    pixels.assign(covered.area(), 0.0f);
  }

  float* row(int y) {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(region.width);
  }
  const float* row(int y) const {
    return pixels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(region.width);
  }
};

// Normalised samples of a Gaussian, the middle one first: taps[0], taps[1] = taps[-1], ...  Radius
// int(4 sigma + 0.5), as scipy.ndimage; sigma 0 gives the single tap 1.
std::vector<float> gaussian_taps(double sigma);

// Scratch of gaussian_blur.
struct BlurWorkspace {
  LineFloats padded;  // one row with zeros on either side
  LineFloats rows;    // the last rows after the first pass, as many as the taps of the second reach
};

// Separable Gaussian blur in place, zero outside the image.  The operator is its own adjoint.
void gaussian_blur(Image& image, std::span<const float> taps, BlurWorkspace& workspace);

}  // namespace emseg
