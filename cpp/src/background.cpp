#include "emseg/background.hpp"

#include <algorithm>
#include <cmath>

#include "emseg/iwe.hpp"

namespace emseg {

std::vector<LabelExtent> label_extents(const PointView& points, std::span<const std::int32_t> labels,
                                       std::int32_t label_count, Region plane) {
  constexpr int tile = 16;
  constexpr int enough = 3;
  const int columns = (plane.width + tile - 1) / tile;
  const int rows = (plane.height + tile - 1) / tile;
  const auto count = static_cast<std::size_t>(label_count);
  std::vector<std::int32_t> events(static_cast<std::size_t>(columns * rows) * count, 0);
  for (std::size_t k = 0; k < labels.size(); ++k) {
    if (labels[k] < 0) continue;
    const int column =
        std::clamp(static_cast<int>(points.x[k] - static_cast<float>(plane.x0)) / tile, 0, columns - 1);
    const int row =
        std::clamp(static_cast<int>(points.y[k] - static_cast<float>(plane.y0)) / tile, 0, rows - 1);
    ++events[static_cast<std::size_t>(row * columns + column) * count + static_cast<std::size_t>(labels[k])];
  }
  struct Moments {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  };
  std::vector<Moments> moments(count);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const auto first = events.begin() + static_cast<std::ptrdiff_t>(
                                              static_cast<std::size_t>(row * columns + column) * count);
      const auto most = std::max_element(first, first + label_count);
      if (label_count == 0 || *most < enough) continue;
      Moments& m = moments[static_cast<std::size_t>(most - first)];
      m.n += 1;
      m.x += column;
      m.y += row;
      m.xx += column * column;
      m.xy += column * row;
      m.yy += row * row;
    }
  }
  std::vector<LabelExtent> extents(count);
  for (std::size_t l = 0; l < count; ++l) {
    const Moments& m = moments[l];
    extents[l].tiles = static_cast<int>(m.n);
    extents[l].share = m.n / (columns * rows);
    if (m.n == 0) continue;
    // 1/12: the variance of a tile within itself, so that a single tile has its own size.
    const double xx = m.xx / m.n - (m.x / m.n) * (m.x / m.n) + 1.0 / 12;
    const double yy = m.yy / m.n - (m.y / m.n) * (m.y / m.n) + 1.0 / 12;
    const double xy = m.xy / m.n - (m.x / m.n) * (m.y / m.n);
    extents[l].spread = std::sqrt(std::max(0.0, xx * yy - xy * xy)) * 12 / (columns * rows);
  }
  return extents;
}

std::int32_t background_label(std::span<const LabelExtent> extents) {
  // A background is cut up by the objects before it, but what is left of it still lies all around; an object,
  // or a few of one motion, fills a small part of the view.
  constexpr double spans_scene = 0.15;
  constexpr double fills_scene = 0.07;
  std::int32_t best = -1;
  int tiles = 0;
  for (std::size_t l = 0; l < extents.size(); ++l) {
    if (extents[l].spread >= spans_scene && extents[l].share >= fills_scene && extents[l].tiles > tiles) {
      tiles = extents[l].tiles;
      best = static_cast<std::int32_t>(l);
    }
  }
  return best;
}

int company_radius(std::size_t events, Region plane) {
  const double side =
      std::sqrt(static_cast<double>(plane.area()) / static_cast<double>(std::max<std::size_t>(1, events)));
  return side > 3 ? 2 : 1;
}

std::vector<std::uint8_t> find_lonely_events(const PointView& points, std::span<const std::int32_t> labels,
                                             std::span<const MotionModel> models, const WarpFrame& frame,
                                             Region plane, int company, int radius) {
  const auto r = static_cast<std::size_t>(radius);
  std::vector<std::uint8_t> lonely(points.size(), 0);
  std::vector<std::vector<std::size_t>> members(models.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (labels[k] >= 0) members[static_cast<std::size_t>(labels[k])].push_back(k);
  }
  std::vector<float> x, y;
  std::vector<std::size_t> pixel;    // of the warped event in a padded image, 0 outside
  std::vector<std::uint16_t> votes;  // up to `most`
  const auto most = static_cast<std::uint16_t>(std::clamp(company + 1, 0, 65535));
  for (std::size_t l = 0; l < models.size(); ++l) {
    Points own;
    own.reserve(members[l].size());
    for (const std::size_t k : members[l]) own.push_back(points, k);
    x.resize(own.size());
    y.resize(own.size());
    warp_points(own.view(), models[l], frame, x, y);
    const Region region = bounding_region(x, y, 1, canvas_of(plane));
    const auto stride = static_cast<std::size_t>(region.width) + 2 * r;
    votes.assign(stride * (static_cast<std::size_t>(region.height) + 2 * r), 0);
    pixel.resize(own.size());
    for (std::size_t i = 0; i < own.size(); ++i) {
      const float u = x[i] - static_cast<float>(region.x0) + 0.5f;
      const float v = y[i] - static_cast<float>(region.y0) + 0.5f;
      const bool inside =
          u >= 0 && v >= 0 && u < static_cast<float>(region.width) && v < static_cast<float>(region.height);
      pixel[i] = inside ? (static_cast<std::size_t>(v) + r) * stride + static_cast<std::size_t>(u) + r : 0;
      if (inside) votes[pixel[i]] = static_cast<std::uint16_t>(votes[pixel[i]] + (votes[pixel[i]] < most));
    }
    for (std::size_t i = 0; i < own.size(); ++i) {
      if (pixel[i] == 0) continue;
      int near = -1;  // not itself
      const std::uint16_t* row = votes.data() + pixel[i] - r * stride - r;
      for (std::size_t j = 0; j <= 2 * r; ++j, row += stride) {
        for (std::size_t c = 0; c <= 2 * r; ++c) near += row[c];
      }
      lonely[members[l][i]] = near < company;
    }
  }
  return lonely;
}

}  // namespace emseg
