#include "emseg/motion_evidence.hpp"

#include <algorithm>
#include <cmath>

#include "emseg/count_image.hpp"

namespace emseg {

std::vector<double> sharpness_losses(const PointView& points, const MotionModel& own,
                                     const MotionModel& other, std::span<const Vec2f> offsets, double window,
                                     const WarpFrame& frame, Region canvas) {
  const std::size_t n = points.size();
  if (n == 0) return {};
  CountWorkspace workspace;
  std::vector<std::uint16_t> sharpness(n);
  count_sharpness(points, own, frame, canvas, workspace, sharpness);
  std::vector<std::uint16_t> sorted = sharpness;
  const auto rank = sorted.begin() + static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(n - 1));
  std::nth_element(sorted.begin(), rank, sorted.end());
  const double floor = 0.2 * std::max<double>(*rank, counts_per_event);
  std::vector<double> log_of;  // of every whole number so far, with the floor: few differ
  const auto mean_log = [&] {
    double sum = 0;
    for (const std::uint16_t value : sharpness) {
      while (log_of.size() <= value) log_of.push_back(std::log(static_cast<double>(log_of.size()) + floor));
      sum += log_of[value];
    }
    return sum / static_cast<double>(n);
  };
  const double best = mean_log();

  std::vector<float> x(n), y(n);
  warp_points(points, other, frame, x, y);
  Points moved;
  moved.x.resize(n);
  moved.y.resize(n);
  moved.dt.assign(points.dt.begin(), points.dt.end());
  moved.sign.assign(points.sign.begin(), points.sign.end());
  std::vector<float> part(n);  // of the window, from t_ref
  for (std::size_t k = 0; k < n; ++k) part[k] = static_cast<float>(points.dt[k] / window);
  std::vector<double> losses;
  for (const Vec2f offset : offsets) {
    for (std::size_t k = 0; k < n; ++k) {
      moved.x[k] = x[k] - part[k] * offset.x;
      moved.y[k] = y[k] - part[k] * offset.y;
    }
    count_sharpness(moved.view(), Translation{}, frame, canvas, workspace, sharpness);
    losses.push_back(best - mean_log());
  }
  return losses;
}

}  // namespace emseg
