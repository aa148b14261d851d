#include "emseg/label_extension.hpp"

#include <algorithm>
#include <array>
#include <cassert>

#include "emseg/iwe.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {
namespace {

// Gives every one of `points` the label whose image of `sample`'s events is brightest where it falls, of its
// own sign where there are signs; -1 where all are dark.
std::vector<std::int32_t> brightest_labels(const PointView& points, const PointView& sample,
                                           std::span<const std::int32_t> labels,
                                           std::span<const MotionModel> models, const WarpFrame& frame,
                                           Region plane, std::span<const float> taps) {
  std::vector<std::int32_t> chosen(points.size(), -1);
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
      if (labels[i] == static_cast<std::int32_t>(l)) own.push_back(sample, i);
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
        chosen[first + i] = static_cast<std::int32_t>(l);
      }
    }
  }
  return chosen;
}

PointView without_signs(const PointView& points) { return {points.x, points.y, points.dt}; }

}  // namespace

std::vector<std::int32_t> extend_labels(const PointView& points, std::span<const std::size_t> sample,
                                        std::span<const std::int32_t> labels,
                                        std::span<const MotionModel> models, const WarpFrame& frame,
                                        Region plane, std::span<const float> taps) {
  assert(sample.size() == labels.size());
  Points sampled;
  sampled.reserve(sample.size());
  for (const std::size_t k : sample) sampled.push_back(points, k);
  std::vector<std::int32_t> extended =
      brightest_labels(points, sampled.view(), labels, models, frame, plane, taps);
  for (std::size_t i = 0; i < sample.size(); ++i) extended[sample[i]] = labels[i];
  if (points.sign.empty()) return extended;

  // Where texture is fine, events of both signs fall on one pixel, and one may find none of its own.
  std::vector<std::uint8_t> dark(points.size(), 0);
  for (std::size_t k = 0; k < points.size(); ++k) dark[k] = extended[k] < 0;
  for (const std::size_t k : sample) dark[k] = 0;
  Points rest;
  std::vector<std::size_t> at;
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (!dark[k]) continue;
    rest.push_back(points, k);
    at.push_back(k);
  }
  const auto of_rest = brightest_labels(without_signs(rest.view()), without_signs(sampled.view()), labels,
                                        models, frame, plane, taps);
  for (std::size_t i = 0; i < at.size(); ++i) extended[at[i]] = of_rest[i];
  return extended;
}

}  // namespace emseg
