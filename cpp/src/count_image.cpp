#include "emseg/count_image.hpp"

#include <algorithm>
#include <cassert>

namespace emseg {
namespace {

constexpr int radius = 2;            // of the binomial
constexpr std::uint16_t most = 255;  // votes of a cell that count: 255 (1+4+6+4+1)^2 fits 16 bits

// Weighted sum of five rows, votes beyond `most` left out.
void smooth_down(const std::uint16_t* centre, std::ptrdiff_t stride, std::size_t width, std::uint16_t* out) {
  const std::uint16_t *above2 = centre - 2 * stride, *above = centre - stride, *below = centre + stride,
                      *below2 = centre + 2 * stride;
  for (std::size_t x = 0; x < width; ++x) {
    const auto cut = [](std::uint16_t votes) { return votes < most ? votes : most; };
    out[x] = static_cast<std::uint16_t>(cut(above2[x]) + 4 * cut(above[x]) + 6 * cut(centre[x]) +
                                        4 * cut(below[x]) + cut(below2[x]));
  }
}

void smooth_across(const std::uint16_t* centre, std::size_t width, std::uint16_t* out) {
  for (std::size_t x = 0; x < width; ++x) {
    const std::uint16_t* c = centre + x;
    out[x] = static_cast<std::uint16_t>(
                 static_cast<std::uint16_t>(c[-2] + 4 * c[-1] + 6 * c[0] + 4 * c[1] + c[2])) /
             (256 / counts_per_event);
  }
}

}  // namespace

void count_sharpness(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region canvas,
                     CountWorkspace& workspace, std::span<std::uint16_t> sharpness) {
  const std::size_t n = points.size();
  assert(sharpness.size() == n);
  workspace.x.resize(n);
  workspace.y.resize(n);
  workspace.cell.resize(n);
  warp_points(points, model, frame, workspace.x, workspace.y);
  const Region region = bounding_region(workspace.x, workspace.y, 1, canvas);
  const int stride = region.width + 2 * radius;
  const int rows = region.height + 2 * radius;
  workspace.votes.assign(static_cast<std::size_t>(stride) * static_cast<std::size_t>(rows), 0);

  // Pixels, being whole numbers, lie half a pixel inside their cells.  Off the canvas, NaN included: -1.
  const float left = static_cast<float>(region.x0) - 0.5f, top = static_cast<float>(region.y0) - 0.5f;
  const auto width = static_cast<float>(region.width), height = static_cast<float>(region.height);
  for (std::size_t k = 0; k < n; ++k) {
    const float u = workspace.x[k] - left, v = workspace.y[k] - top;
    const bool inside = u >= 0 && v >= 0 && u < width && v < height;
    const int column = static_cast<int>(inside ? u : 0), row = static_cast<int>(inside ? v : 0);
    workspace.cell[k] = inside ? (row + radius) * stride + column + radius : -1;
  }
  for (std::size_t k = 0; k < n; ++k) {
    if (workspace.cell[k] < 0) continue;
    std::uint16_t& votes = workspace.votes[static_cast<std::size_t>(workspace.cell[k])];
    votes = static_cast<std::uint16_t>(votes + (votes < most));
  }

  workspace.smooth.resize(workspace.votes.size());
  workspace.column.assign(static_cast<std::size_t>(stride), 0);
  const auto inner = static_cast<std::size_t>(region.width);
  for (int row = radius; row < radius + region.height; ++row) {
    const auto first = static_cast<std::size_t>(row * stride + radius);
    smooth_down(workspace.votes.data() + first, stride, inner, workspace.column.data() + radius);
    smooth_across(workspace.column.data() + radius, inner, workspace.smooth.data() + first);
  }
  for (std::size_t k = 0; k < n; ++k) {
    const std::int32_t cell = workspace.cell[k];
    sharpness[k] = cell < 0 ? std::uint16_t{0} : workspace.smooth[static_cast<std::size_t>(cell)];
  }
}

}  // namespace emseg
