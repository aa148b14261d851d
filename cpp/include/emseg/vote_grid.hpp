// Bilinear votes of many points at once, and samples where they fell.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "emseg/aligned.hpp"
#include "emseg/image.hpp"

namespace emseg {

// Where points vote and sample: a cell of a grid, and the offset to the right of its pixel and below, in
// 0..1.
struct VotePlaces {
  std::vector<std::int32_t> cell;
  std::vector<float> right;
  std::vector<float> low;

  void resize(std::size_t count) {
    cell.resize(count);
    right.resize(count);
    low.resize(count);
  }
  std::size_t size() const { return cell.size(); }
};

// Cells lie around the region's pixels as well as on them, so that no vote needs a test of where it falls.
// Each holds two sums, the votes for its own pixel and those for the pixel below: then the four shares of a
// vote lie side by side and are added at once.
class VoteGrid {
 public:
  // Covers `region`, without votes: those not taken are lost.
  void reset(Region region);

  // Votes of `sign` (of 1 where that is empty) at (x, y); shares outside the region are lost. Where they fall
  // is kept in `places`, from `first` on.
  void vote(std::span<const float> x, std::span<const float> y, std::span<const float> sign,
            VotePlaces& places, std::size_t first = 0);

  // The part of the region that votes have fallen into, in pixels from the region's first.
  Region voted() const;

  // Takes the votes of a row of voted(), as many floats as that is wide. Rows are taken in turn, each once;
  // the last leaves the grid empty.
  void take_row(int y, float* to);

  // The region's cells, with a border on every side.
  int stride() const { return stride_; }
  std::size_t cell_count() const {
    return static_cast<std::size_t>(stride()) * (static_cast<std::size_t>(region_.height) + 3);
  }
  // Cells before the first, so that the pixels of a row begin at a cache line.
  static constexpr std::size_t lead = line_floats - 1;
  // The first cell of an image of the grid's, in `memory`, whose border is zero. What else places of votes
  // refer to lies in voted() and is yet to be written.
  float* cells_without_border(LineFloats& memory) const;
  // Of a pixel counted from the region's first.
  std::size_t cell_of(int x, int y) const {
    return static_cast<std::size_t>(y + 1) * static_cast<std::size_t>(stride()) +
           static_cast<std::size_t>(x + 1);
  }

 private:
  void clear(int cell_row, int first, int last);  // cells first .. last
  void forget_votes();                            // of a grid that is empty again

  float* pairs_of(int cell_row);

  Region region_;
  int stride_ = 0;
  LineFloats pairs_;  // two floats a cell, zero where no vote is; with a row above the first
  // Of the cells that were voted for: inclusive.
  int min_column_ = std::numeric_limits<int>::max(), max_column_ = -1;
  int min_row_ = std::numeric_limits<int>::max(), max_row_ = -1;
};

// Bilinear interpolation, at places of a grid over its region, in an image of the grid's cells whose border
// is zero; and the slopes of the interpolation.
void sample_values(const float* cells, int stride, const VotePlaces& places, std::span<float> values);

}  // namespace emseg
