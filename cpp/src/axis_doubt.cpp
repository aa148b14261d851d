#include "emseg/axis_doubt.hpp"

#include <algorithm>
#include <cmath>

namespace emseg {

AxisDoubts::AxisDoubts(const BlockGrid& grid, double window, double cost)
    : block_count_(grid.count()), cost_(cost) {
  if (!(cost > 0)) return;
  for (const double side : {0.5, -0.5}) {
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        ends_.x.push_back(static_cast<float>(grid.plane.x0 + (column + 0.5) * grid.block));
        ends_.y.push_back(static_cast<float>(grid.plane.y0 + (row + 0.5) * grid.block));
        ends_.dt.push_back(static_cast<float>(side * window));
      }
    }
  }
}

std::vector<std::int32_t> AxisDoubts::of(const MotionModel& model, const WarpFrame& frame) const {
  const std::size_t n = block_count_;
  std::vector<std::int32_t> doubts(n, 0);
  if (!(cost_ > 0)) return doubts;
  std::vector<float> x(2 * n), y(2 * n);
  warp_points(ends_.view(), model, frame, x, y);
  for (std::size_t b = 0; b < n; ++b) {
    const float dx = std::abs(x[b] - x[b + n]), dy = std::abs(y[b] - y[b + n]);
    const float along = std::max(dx, dy);
    // Most are slow.  No image holds what flies as far as no float does.
    if (along <= 4.0f || !std::isfinite(dx) || !std::isfinite(dy)) continue;
    const double fast = std::clamp((double{along} - 4.0) / 4.0, 0.0, 1.0);
    const double straight = std::clamp(1.5 + 0.05 * double{along} - double{std::min(dx, dy)}, 0.0, 1.0);
    doubts[b] = static_cast<std::int32_t>(cost_ * fast * straight + 0.5);
  }
  return doubts;
}

}  // namespace emseg
