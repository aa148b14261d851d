#include "emseg/vote_grid.hpp"

#include <algorithm>
#include <cassert>

#include "kernels/kernel_table.hpp"

namespace emseg {

void VoteGrid::reset(Region region) {
  clear_rows(min_row_, max_row_);
  min_column_ = min_row_ = std::numeric_limits<int>::max();
  max_column_ = max_row_ = -1;
  region_ = region;
  // Zero beyond what it had, as the rest is.
  pairs_.resize(std::max(pairs_.size(), 2 * (cell_count() + static_cast<std::size_t>(stride()))));
}

void VoteGrid::vote(std::span<const float> x, std::span<const float> y, VotePlaces& places,
                    std::size_t first) {
  const std::size_t n = x.size();
  assert(y.size() == n && places.size() >= first + n);
  const CellGrid grid{static_cast<float>(region_.x0), static_cast<float>(region_.y0),
                      static_cast<float>(region_.width), static_cast<float>(region_.height), stride()};
  CellBox box{min_column_, max_column_, min_row_, max_row_};
  kernels().locate(grid, x.data(), y.data(), n, places.cell.data() + first, places.right.data() + first,
                   places.low.data() + first, &box);
  min_column_ = box.min_column, max_column_ = box.max_column;
  min_row_ = box.min_row, max_row_ = box.max_row;
  kernels().scatter(pairs_.data() + 2 * stride(), places.cell.data() + first, places.right.data() + first,
                    places.low.data() + first, n);
}

Region VoteGrid::voted() const {
  if (max_row_ < 0) return {};
  // Cell (1, 1) is pixel (0, 0); a vote reaches the next cell.
  const int left = std::max(0, min_column_ - 1), top = std::max(0, min_row_ - 1);
  const int right = std::min(region_.width, max_column_ + 1), bottom = std::min(region_.height, max_row_ + 1);
  return {left, top, std::max(0, right - left), std::max(0, bottom - top)};
}

void VoteGrid::take_row(int y, float* to) {
  const Region area = voted();
  const float* const own = pairs_.data() + 2 * (cell_of(area.x0, y) + static_cast<std::size_t>(stride()));
  kernels().fold(own, own - 2 * stride(), static_cast<std::size_t>(area.width), to);
  // The row of cells above is needed no more; after the last row, none is.
  const bool last = y + 1 == area.y0 + area.height;
  clear_rows(y, last ? max_row_ : y);
  if (last) reset(region_);
}

// Of cells; zero where votes have fallen.
void VoteGrid::clear_rows(int first, int last) {
  for (int row = first; row <= last; ++row) {
    float* const cells =
        pairs_.data() + 2 * static_cast<std::size_t>(row + 1) * static_cast<std::size_t>(stride());
    std::fill(cells + 2 * min_column_, cells + 2 * (max_column_ + 2), 0.0f);
  }
}

void sample_values(std::span<const float> cells, int stride, const VotePlaces& places,
                   std::span<float> values) {
  assert(values.size() == places.size());
  kernels().sample_values(cells.data(), stride, places.cell.data(), places.right.data(), places.low.data(),
                          places.size(), values.data());
}

}  // namespace emseg
