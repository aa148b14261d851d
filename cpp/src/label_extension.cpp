#include "emseg/label_extension.hpp"

#include <algorithm>
#include <array>
#include <cassert>

#include "emseg/iwe.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {

std::vector<std::int32_t> extend_labels(const PointView& points, std::span<const std::size_t> sample,
                                        std::span<const std::int32_t> labels,
                                        std::span<const MotionModel> models, const WarpFrame& frame,
                                        Region plane, std::span<const float> taps) {
  assert(sample.size() == labels.size());
  std::vector<std::int32_t> extended(points.size(), -1);
  std::vector<float> brightest(points.size(), 0.0f);
  constexpr std::size_t chunk = 1024;
  std::array<float, chunk> x, y, right, low, brightness;
  std::array<std::int32_t, chunk> cell;
  std::vector<float> own_x, own_y;
  Image image;
  IweWorkspace workspace;
  for (std::size_t l = 0; l < models.size(); ++l) {
    Points own;
    for (std::size_t i = 0; i < sample.size(); ++i) {
      if (labels[i] == static_cast<std::int32_t>(l)) own.push_back(points, sample[i]);
    }
    if (own.size() == 0) continue;
    own_x.resize(own.size());
    own_y.resize(own.size());
    warp_points(own.view(), models[l], frame, own_x, own_y);
    // Wide enough for the outermost pixels to be dark: they serve as the border around the others.
    image.region = expanded(bounding_region(own_x, own_y, 0, canvas_of(plane)),
                            static_cast<int>(taps.size()) + 1, static_cast<int>(taps.size()) + 1);
    make_iwe(image, own.view(), models[l], frame, taps, workspace);
    const CellGrid grid{static_cast<float>(image.region.x0 + 1), static_cast<float>(image.region.y0 + 1),
                        static_cast<float>(image.region.width - 2),
                        static_cast<float>(image.region.height - 2), image.region.width};
    for (std::size_t first = 0; first < points.size(); first += chunk) {
      const std::size_t n = std::min(chunk, points.size() - first);
      const PointView part{points.x.subspan(first, n), points.y.subspan(first, n),
                           points.dt.subspan(first, n)};
      warp_points(part, models[l], frame, std::span(x).first(n), std::span(y).first(n));
      CellBox box;
      kernels().locate(grid, x.data(), y.data(), n, cell.data(), right.data(), low.data(), &box);
      kernels().sample_values(image.pixels.data(), grid.stride, cell.data(), right.data(), low.data(), n,
                              brightness.data());
      for (std::size_t i = 0; i < n; ++i) {
        if (!points.sign.empty()) brightness[i] *= points.sign[first + i];
        if (brightness[i] <= brightest[first + i]) continue;
        brightest[first + i] = brightness[i];
        extended[first + i] = static_cast<std::int32_t>(l);
      }
    }
  }
  for (std::size_t i = 0; i < sample.size(); ++i) extended[sample[i]] = labels[i];
  return extended;
}

}  // namespace emseg
