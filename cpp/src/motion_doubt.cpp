#include "emseg/motion_doubt.hpp"

#include <cassert>
#include <cmath>

#include "emseg/fast_log.hpp"

namespace emseg {
namespace {

constexpr float chance = 10.0f;  // px from which on chance meetings grow with the way

}  // namespace

MotionDoubt::MotionDoubt(const BlockGrid& grid, double window, const DoubtOptions& options,
                         std::vector<EdgeDirection> edges)
    : block_count_(grid.count()), options_(options), edges_(std::move(edges)) {
  assert(edges_.empty() || edges_.size() == block_count_);
  if (!(options.speed > 0 || (options.edge > 0 && !edges_.empty()))) return;
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
  std::vector<float> ways(2 * n, 1.0f), logs(2 * n);
  for (std::size_t b = 0; b < n; ++b) {
    const float dx = x[b] - x[b + n], dy = y[b] - y[b + n];
    ways[b] += std::sqrt(dx * dx + dy * dy) / chance;
    if (!edges_.empty()) ways[b + n] += std::abs(dx * edges_[b].x + dy * edges_[b].y) / chance;
  }
  natural_logs(ways, logs);
  const auto speed = static_cast<float>(options_.speed), edge = static_cast<float>(options_.edge);
  for (std::size_t b = 0; b < n; ++b) {
    if (!std::isfinite(ways[b])) continue;  // no image holds what flies as far
    doubts[b] = static_cast<std::int32_t>(speed * logs[b] + edge * logs[b + n] + 0.5f);
  }
  return doubts;
}

}  // namespace emseg
