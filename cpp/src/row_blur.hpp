// A separable blur that rows of an image run through one by one.
#pragma once

#include <cassert>

#include "emseg/image.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {

// Rows go in at the top and come out, blurred both ways, `radius` rows later; above and below the image lie
// zeros.  Only 2 radius + 1 rows are held, so that they stay in the first-level cache.
class RowBlur {
 public:
  RowBlur(std::size_t width, std::span<const float> taps, BlurWorkspace& workspace)
      : width_(width),
        taps_(taps),
        radius_(static_cast<int>(taps.size()) - 1),
        height_(2 * taps.size() - 1),
        stride_(rounded_up(width, line_floats)),
        margin_(rounded_up(taps.size() - 1, line_floats)),
        padded_(workspace.padded),
        rows_(workspace.rows) {
    padded_.assign(2 * margin_ + stride_, 0.0f);
    rows_.assign(height_ * stride_, 0.0f);
    window_.resize(height_);
  }

  // Where the next row is to be written; zeros lie on either side of it.
  float* input() { return padded_.data() + margin_; }

  void push() {
    kernels_.filter_row(input(), width_, taps_.data(), radius_, slot(pushed_));
    ++pushed_;
  }
  void push_zeros() {
    std::fill_n(slot(pushed_), width_, 0.0f);
    ++pushed_;
  }

  // The row `radius` rows before the last one pushed, blurred.
  void pull(float* blurred) {
    assert(pushed_ > static_cast<std::size_t>(radius_));
    // Slots that no row has been pushed to yet hold zeros.
    for (std::size_t i = 0; i < height_; ++i) window_[i] = slot(pushed_ + i);
    kernels_.filter_rows(window_.data(), width_, taps_.data(), radius_, blurred);
  }

 private:
  float* slot(std::size_t row) { return rows_.data() + row % height_ * stride_; }

  const KernelTable& kernels_ = kernels();
  std::size_t width_;
  std::span<const float> taps_;
  int radius_;
  std::size_t height_;  // rows that the taps reach
  std::size_t stride_;
  std::size_t margin_;  // zeros before the row and after it
  LineFloats& padded_;
  LineFloats& rows_;
  std::vector<const float*> window_;
  std::size_t pushed_ = 0;
};

}  // namespace emseg
