#include "emseg/motion_doubt.hpp"

#include <algorithm>
#include <cmath>

#include "emseg/fast_log.hpp"

namespace emseg {
namespace {

constexpr float slow = 4.0f;     // px along an axis: what the grid feigns is faster
constexpr float chance = 10.0f;  // px from which on chance meetings grow with the way

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
  // Logarithms of many numbers cost a tenth.
  std::vector<float> ways(n);
  for (std::size_t b = 0; b < n; ++b) {
    const float dx = x[b] - x[b + n], dy = y[b] - y[b + n];
    ways[b] = 1 + std::sqrt(dx * dx + dy * dy) / chance;
  }
  std::vector<float> logs(n);
  if (options_.speed > 0) natural_logs(ways, logs);
  const auto speed = static_cast<float>(options_.speed), axis = static_cast<float>(options_.axis);
  for (std::size_t b = 0; b < n; ++b) {
    if (!std::isfinite(ways[b])) continue;  // no image holds what flies as far
    float doubt = speed * logs[b];
    const float dx = std::abs(x[b] - x[b + n]), dy = std::abs(y[b] - y[b + n]);
    const float along = std::max(dx, dy);
    if (along > slow) {  // most are not
      const float fast = std::clamp((along - slow) / 4, 0.0f, 1.0f);
      const float straight = std::clamp(1.5f + 0.05f * along - std::min(dx, dy), 0.0f, 1.0f);
      doubt += axis * fast * straight;
    }
    doubts[b] = static_cast<std::int32_t>(doubt + 0.5f);
  }
  return doubts;
}

}  // namespace emseg
