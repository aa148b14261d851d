#include "emseg/motion_doubt.hpp"

#include <algorithm>
#include <cmath>

namespace emseg {
namespace {

constexpr float slow = 4.0f;     // px along an axis: what the grid feigns is faster
constexpr double chance = 10.0;  // px from which on chance meetings grow with the way

}  // namespace

MotionDoubt::MotionDoubt(const BlockGrid& grid, double window, const DoubtOptions& options)
    : block_count_(grid.count()), options_(options) {
  if (!(options.axis > 0 || options.speed > 0)) return;
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

std::vector<std::int32_t> MotionDoubt::of(const MotionModel& model, const WarpFrame& frame) const {
  const std::size_t n = block_count_;
  std::vector<std::int32_t> doubts(n, 0);
  if (ends_.size() == 0) return doubts;
  std::vector<float> x(2 * n), y(2 * n);
  warp_points(ends_.view(), model, frame, x, y);
  for (std::size_t b = 0; b < n; ++b) {
    const float dx = std::abs(x[b] - x[b + n]), dy = std::abs(y[b] - y[b + n]);
    if (!std::isfinite(dx) || !std::isfinite(dy)) continue;  // no image holds what flies as far
    double doubt = options_.speed * std::log1p(std::hypot(double{dx}, double{dy}) / chance);
    const float along = std::max(dx, dy);
    if (along > slow) {  // most are not
      const double fast = std::clamp((double{along} - slow) / 4.0, 0.0, 1.0);
      const double straight = std::clamp(1.5 + 0.05 * double{along} - double{std::min(dx, dy)}, 0.0, 1.0);
      doubt += options_.axis * fast * straight;
    }
    doubts[b] = static_cast<std::int32_t>(doubt + 0.5);
  }
  return doubts;
}

}  // namespace emseg
