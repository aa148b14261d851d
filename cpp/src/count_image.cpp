#include "emseg/count_image.hpp"

#include <algorithm>
#include <cassert>
#include <cstdint>

#include "kernels/kernel_table.hpp"

namespace emseg {
namespace {

constexpr int radius = 2;  // of the binomial
static_assert(most_votes * 16 * 16 <= INT16_MAX, "sums of votes under (1 4 6 4 1) each way fit 16 bits");
static_assert(counts_per_event == 16, "what smooth_counts_across divides by");

template <bool is_signed>
int sign_of(const PointView& points, std::size_t k) {
  return is_signed && !(points.sign[k] > 0) ? -1 : 1;
}

template <bool is_signed>
void add_votes(const PointView& points, const std::int32_t* cell, std::uint16_t* votes) {
  for (std::size_t k = 0; k < points.size(); ++k) {
    std::uint16_t& count = votes[cell[k]];
    const int sum = static_cast<std::int16_t>(count) + sign_of<is_signed>(points, k);
    count = static_cast<std::uint16_t>(std::clamp(sum, -most_votes, most_votes));
  }
}

template <bool is_signed>
void take_counts(const PointView& points, const std::int32_t* cell, const std::uint16_t* smooth,
                 std::uint16_t* sharpness) {
  for (std::size_t k = 0; k < points.size(); ++k) {
    const int count = static_cast<std::int16_t>(smooth[cell[k]]);
    sharpness[k] = static_cast<std::uint16_t>(std::max(0, sign_of<is_signed>(points, k) * count));
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

  // Cell 0 lies in a corner of the padding: votes of places off the canvas go there, and nobody reads them.
  const CellGrid grid{static_cast<float>(region.x0), static_cast<float>(region.y0),
                      static_cast<float>(region.width), static_cast<float>(region.height), stride};
  const KernelTable& kernel = kernels();
  kernel.nearest_cells(grid, workspace.x.data(), workspace.y.data(), n, radius, workspace.cell.data());
  const bool is_signed = !points.sign.empty();
  (is_signed ? add_votes<true> : add_votes<false>)(points, workspace.cell.data(), workspace.votes.data());

  workspace.smooth.resize(workspace.votes.size());
  workspace.smooth[0] = 0;
  workspace.column.assign(static_cast<std::size_t>(stride), 0);
  const auto inner = static_cast<std::size_t>(region.width);
  for (int row = radius; row < radius + region.height; ++row) {
    const auto first = static_cast<std::size_t>(row * stride + radius);
    kernel.smooth_counts_down(workspace.votes.data() + first, stride, inner,
                              workspace.column.data() + radius);
    kernel.smooth_counts_across(workspace.column.data() + radius, inner, workspace.smooth.data() + first);
  }
  (is_signed ? take_counts<true> : take_counts<false>)(points, workspace.cell.data(), workspace.smooth.data(),
                                                       sharpness.data());
}

}  // namespace emseg
