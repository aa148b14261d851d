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

// Votes that a cell takes before it must be cut down to most_votes.
constexpr std::size_t most_at_once = INT16_MAX - most_votes;

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
  workspace.sign.assign(n, 1);
  for (std::size_t k = 0; k < points.sign.size(); ++k) workspace.sign[k] = points.sign[k] > 0 ? 1 : -1;
  const std::int32_t* const cell = workspace.cell.data();
  const std::int16_t* const sign = workspace.sign.data();
  std::uint16_t* const votes = workspace.votes.data();
  for (std::size_t first = 0; first < n; first += most_at_once) {
    if (first > 0) kernel.clamp_counts(votes, workspace.votes.size(), most_votes);
    const std::size_t last = std::min(n, first + most_at_once);
    for (std::size_t k = first; k < last; ++k)
      votes[cell[k]] = static_cast<std::uint16_t>(votes[cell[k]] + sign[k]);
  }

  workspace.smooth.resize(workspace.votes.size());
  workspace.smooth[0] = 0;
  workspace.column.assign(static_cast<std::size_t>(stride), 0);
  const auto inner = static_cast<std::size_t>(region.width);
  const auto row_at = [&](int row) { return votes + row * stride + radius; };
  for (int row = 0; row < std::min(radius, region.height); ++row)
    kernel.clamp_counts(row_at(radius + row), inner, most_votes);
  for (int row = radius; row < radius + region.height; ++row) {
    // The lowest row that the sum takes in comes into it for the first time.
    if (row + radius < radius + region.height) kernel.clamp_counts(row_at(row + radius), inner, most_votes);
    kernel.smooth_counts_down(row_at(row), stride, inner, workspace.column.data() + radius);
    kernel.smooth_counts_across(workspace.column.data() + radius, inner,
                                workspace.smooth.data() + row * stride + radius);
  }
  const std::uint16_t* const smooth = workspace.smooth.data();
  for (std::size_t k = 0; k < n; ++k) {
    const int count = static_cast<std::int16_t>(smooth[cell[k]]) * sign[k];
    sharpness[k] = static_cast<std::uint16_t>(std::max(0, count));
  }
}

}  // namespace emseg
