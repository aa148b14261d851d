#include "emseg/axis_doubt.hpp"

#include <algorithm>
#include <cmath>

#include "emseg/motion_model.hpp"

namespace emseg {

std::vector<std::int32_t> axis_doubts(const BlockGrid& grid, const MotionModel& model, const WarpFrame& frame,
                                      double window, double cost) {
  std::vector<std::int32_t> doubts(grid.count(), 0);
  if (cost <= 0) return doubts;
  Points ends;
  for (const float dt : {0.5f, -0.5f}) {
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        ends.x.push_back(static_cast<float>(grid.plane.x0) + (static_cast<float>(column) + 0.5f) * static_cast<float>(grid.block));
        ends.y.push_back(static_cast<float>(grid.plane.y0) + (static_cast<float>(row) + 0.5f) * static_cast<float>(grid.block));
        ends.dt.push_back(dt * static_cast<float>(window));
      }
    }
  }
  std::vector<float> x(ends.size()), y(ends.size());
  warp_points(ends.view(), model, frame, x, y);
  for (std::size_t b = 0; b < grid.count(); ++b) {
    const float dx = std::abs(x[b] - x[b + grid.count()]), dy = std::abs(y[b] - y[b + grid.count()]);
    const float along = std::max(dx, dy), across = std::min(dx, dy);
    const double doubt = std::clamp((along - 4.0) / 4.0, 0.0, 1.0) * std::clamp(1.5 - across, 0.0, 1.0);
    doubts[b] = static_cast<std::int32_t>(std::lround(cost * doubt));
  }
  return doubts;
}

}  // namespace emseg
