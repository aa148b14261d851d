#include "emseg/vote_grid.hpp"

#include <algorithm>
#include <cassert>

#include "kernels/kernel_table.hpp"

namespace emseg {

void VoteGrid::reset(Region region) {
  for (int row = min_row_; row <= max_row_; ++row) clear(row, min_column_, max_column_ + 1);
  forget_votes();
  region_ = region;
  stride_ = static_cast<int>(rounded_up(static_cast<std::size_t>(region.width) + 3, line_floats));
  // Zero beyond what it had, as the rest is.
  pairs_.resize(std::max(pairs_.size(), 2 * (lead + cell_count() + static_cast<std::size_t>(stride_))));
}

// The first cell of a row; the row above the first can be read.
float* VoteGrid::pairs_of(int cell_row) {
  return pairs_.data() +
         2 * (lead + static_cast<std::size_t>(cell_row + 1) * static_cast<std::size_t>(stride_));
}

void VoteGrid::vote(std::span<const float> x, std::span<const float> y, std::span<const float> sign,
                    VotePlaces& places, std::size_t first) {
  const std::size_t n = x.size();
  assert(y.size() == n && (sign.empty() || sign.size() == n) && places.size() >= first + n);
  const CellGrid grid{static_cast<float>(region_.x0), static_cast<float>(region_.y0),
                      static_cast<float>(region_.width), static_cast<float>(region_.height), stride()};
  CellBox box{min_column_, max_column_, min_row_, max_row_};
  kernels().locate(grid, x.data(), y.data(), n, places.cell.data() + first, places.right.data() + first,
                   places.low.data() + first, &box);
  min_column_ = box.min_column, max_column_ = box.max_column;
  min_row_ = box.min_row, max_row_ = box.max_row;
  kernels().scatter(pairs_of(0), places.cell.data() + first, places.right.data() + first,
                    places.low.data() + first, sign.data(), n);
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
  const int first = 2 * (area.x0 + 1);
  kernels().fold(pairs_of(y + 1) + first, pairs_of(y) + first, static_cast<std::size_t>(area.width), to);
  // The row of cells above is needed no more, and those of its pixels are zero again; after the last row,
  // none is.
  if (y + 1 < area.y0 + area.height) {
    clear(y, min_column_, area.x0);
    clear(y, area.x0 + area.width + 1, max_column_ + 1);
  } else {
    for (int row = y; row <= max_row_; ++row) clear(row, min_column_, max_column_ + 1);
    forget_votes();
  }
}

float* VoteGrid::cells_without_border(LineFloats& memory) const {
  memory.resize(std::max(memory.size(), lead + cell_count()));
  float* const cells = memory.data() + lead;
  const auto next = static_cast<std::size_t>(stride_);
  const auto height = static_cast<std::size_t>(region_.height);
  std::fill_n(cells, next, 0.0f);
  for (std::size_t row = 1; row <= height; ++row) {
    float* const right = cells + row * next + static_cast<std::size_t>(region_.width) + 1;
    cells[row * next] = right[0] = right[1] = 0;
  }
  std::fill_n(cells + (height + 1) * next, 2 * next, 0.0f);
  return cells;
}

void VoteGrid::forget_votes() {
  min_column_ = min_row_ = std::numeric_limits<int>::max();
  max_column_ = max_row_ = -1;
}

void VoteGrid::clear(int cell_row, int first, int last) {
  float* const pairs = pairs_of(cell_row);
  for (int i = 2 * first; i < 2 * (last + 1); ++i) pairs[i] = 0;
}

void sample_values(const float* cells, int stride, const VotePlaces& places, std::span<float> values) {
  assert(values.size() == places.size());
  kernels().sample_values(cells, stride, places.cell.data(), places.right.data(), places.low.data(),
                          places.size(), values.data());
}

}  // namespace emseg
