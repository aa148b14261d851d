#include "emseg/axis_doubt.hpp"

#include <algorithm>
#include <cmath>

namespace emseg {

std::vector<std::int32_t> axis_doubts(const BlockGrid& grid, const MotionModel& model, const WarpFrame& frame,
                                      double window, double cost) {
  std::vector<std::int32_t> doubts(grid.count(), 0);
  if (!(cost > 0)) return doubts;
  // The middle of every block, where it is at the window's beginning and at its end.
  const std::size_t n = grid.count();
  Points ends;
  for (const double side : {0.5, -0.5}) {
    for (std::size_t b = 0; b < n; ++b) {
      const auto columns = static_cast<std::size_t>(grid.columns);
      const double x = grid.plane.x0 + (static_cast<double>(b % columns) + 0.5) * grid.block;
      const double y = grid.plane.y0 + (static_cast<double>(b / columns) + 0.5) * grid.block;
      ends.x.push_back(static_cast<float>(x));
      ends.y.push_back(static_cast<float>(y));
      ends.dt.push_back(static_cast<float>(side * window));
    }
  }
  std::vector<float> x(2 * n), y(2 * n);
  warp_points(ends.view(), model, frame, x, y);
  for (std::size_t b = 0; b < n; ++b) {
    const float dx = std::abs(x[b] - x[b + n]), dy = std::abs(y[b] - y[b + n]);
    if (!std::isfinite(dx) || !std::isfinite(dy)) continue;  // no image holds what flies as far
    const double along = std::max(dx, dy);
    const double fast = std::clamp((along - 4.0) / 4.0, 0.0, 1.0);
    const double straight = std::clamp(1.5 + 0.05 * along - std::min(dx, dy), 0.0, 1.0);
    doubts[b] = static_cast<std::int32_t>(std::lround(cost * fast * straight));
  }
  return doubts;
}

}  // namespace emseg
