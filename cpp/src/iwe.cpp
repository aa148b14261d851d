#include "emseg/iwe.hpp"

namespace emseg {

void make_iwe(Image& image, const PointView& points, const MotionModel& model, const WarpFrame& frame,
              std::span<const float> taps, BlurWorkspace& workspace) {
  image.reset(image.region);
  std::visit(
      [&](const auto& m) { vote(image, points, typename std::decay_t<decltype(m)>::Warp(m, frame)); }, model);
  gaussian_blur(image, taps, workspace);
}

Region bounding_region(const PointView& points, int margin, Region limit) {
  if (points.size() == 0) return {limit.x0, limit.y0, 0, 0};
  const auto [left, right] = std::minmax_element(points.x.begin(), points.x.end());
  const auto [top, bottom] = std::minmax_element(points.y.begin(), points.y.end());
  const auto low = [](float value, int first, int last) {
    return static_cast<int>(std::floor(std::clamp(value, static_cast<float>(first), static_cast<float>(last))));
  };
  const int x_last = limit.x0 + limit.width - 1;
  const int y_last = limit.y0 + limit.height - 1;
  const int x0 = std::max(limit.x0, low(*left, limit.x0, x_last) - margin);
  const int y0 = std::max(limit.y0, low(*top, limit.y0, y_last) - margin);
  const int x1 = std::min(x_last, low(*right, limit.x0, x_last) + 1 + margin);
  const int y1 = std::min(y_last, low(*bottom, limit.y0, y_last) + 1 + margin);
  return {x0, y0, x1 - x0 + 1, y1 - y0 + 1};
}

}  // namespace emseg
