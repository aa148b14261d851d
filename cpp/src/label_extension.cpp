#include "emseg/label_extension.hpp"

#include <algorithm>
#include <cassert>

#include "emseg/iwe.hpp"

namespace emseg {

std::vector<std::int32_t> extend_labels(const PointView& points, std::span<const std::size_t> sample,
                                        std::span<const std::int32_t> labels,
                                        std::span<const MotionModel> models, const WarpFrame& frame,
                                        Region plane, std::span<const float> taps) {
  assert(sample.size() == labels.size());
  std::vector<std::int32_t> extended(points.size(), -1);
  std::vector<float> brightest(points.size(), 0.0f);
  std::vector<float> x(points.size()), y(points.size());
  Image image;
  IweWorkspace workspace;
  for (std::size_t l = 0; l < models.size(); ++l) {
    Points own;
    for (std::size_t i = 0; i < sample.size(); ++i) {
      if (labels[i] == static_cast<std::int32_t>(l)) own.push_back(points, sample[i]);
    }
    if (own.size() == 0) continue;
    x.resize(own.size());
    y.resize(own.size());
    warp_points(own.view(), models[l], frame, x, y);
    image.region = bounding_region(x, y, static_cast<int>(taps.size()), canvas_of(plane));
    make_iwe(image, own.view(), models[l], frame, taps, workspace);
    x.resize(points.size());
    y.resize(points.size());
    warp_points(points, models[l], frame, x, y);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const float brightness = bilinear_value(image, x[k], y[k]);
      if (brightness > brightest[k]) {
        brightest[k] = brightness;
        extended[k] = static_cast<std::int32_t>(l);
      }
    }
  }
  for (std::size_t i = 0; i < sample.size(); ++i) extended[sample[i]] = labels[i];
  return extended;
}

}  // namespace emseg
