#include "emseg/iwe.hpp"

namespace emseg {

void make_iwe(Image& image, const PointView& points, const MotionModel& model, const WarpFrame& frame,
              std::span<const float> taps, BlurWorkspace& workspace) {
  image.reset(image.region);
  std::visit([&](const auto& m) { vote(image, points, typename std::decay_t<decltype(m)>::Warp(m, frame)); },
             model);
  gaussian_blur(image, taps, workspace);
}

Region image_plane(ImageSize size, const UndistortionTable* table) {
  if (!table) return sensor_region(size);
  const auto [left, right] = std::minmax_element(table->x.begin(), table->x.end());
  const auto [top, bottom] = std::minmax_element(table->y.begin(), table->y.end());
  const int x0 = static_cast<int>(std::floor(*left));
  const int y0 = static_cast<int>(std::floor(*top));
  return {x0, y0, static_cast<int>(std::ceil(*right)) - x0 + 1,
          static_cast<int>(std::ceil(*bottom)) - y0 + 1};
}

Region bounding_region(std::span<const float> x, std::span<const float> y, int margin, Region limit) {
  if (x.empty() || limit.area() == 0) return {limit.x0, limit.y0, 0, 0};
  // A bilinear vote touches floor(x) and the pixel after it.
  const auto range = [margin](std::span<const float> values, int first, int last, int& begin, int& length) {
    float low = static_cast<float>(last), high = static_cast<float>(first);
    for (const float value : values) {
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
    const auto clamped = [&](float value) {
      return std::clamp(value, static_cast<float>(first), static_cast<float>(last));
    };
    begin = std::max(first, static_cast<int>(std::floor(clamped(low))) - margin);
    const int end = std::min(last, static_cast<int>(std::floor(clamped(high))) + 1 + margin);
    length = std::max(0, end - begin + 1);
  };
  Region region;
  range(x, limit.x0, limit.x0 + limit.width - 1, region.x0, region.width);
  range(y, limit.y0, limit.y0 + limit.height - 1, region.y0, region.height);
  return region;
}

}  // namespace emseg
