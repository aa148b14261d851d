// The steps that images of warped events are made in.
#pragma once

#include "emseg/iwe.hpp"
#include "row_blur.hpp"
#include "warp_field.hpp"

namespace emseg {

enum class Places { kept, forgotten };

// Votes of all warped points; `kept` places are those of all points, in their order.
void vote_warped(VoteGrid& grid, const PointView& points, const WarpField& field, VotePlaces& places,
                 Places wanted);

// The part of a region of this size that a blur spreads votes over; counted from its first pixel, as `voted`.
inline Region blurred_area(Region voted, Region region, std::span<const float> taps) {
  const int radius = static_cast<int>(taps.size()) - 1;
  if (voted.area() == 0) return {};
  const int left = std::max(0, voted.x0 - radius), top = std::max(0, voted.y0 - radius);
  const int right = std::min(region.width, voted.x0 + voted.width + radius);
  const int bottom = std::min(region.height, voted.y0 + voted.height + radius);
  return {left, top, right - left, bottom - top};
}

// Takes all votes, blurs them, and hands out the rows of `area` (blurred_area) in turn: row_at(y) says where
// row y is to be written, done(y, row) that it is.
template <typename RowAt, typename Done>
void take_blurred(VoteGrid& grid, Region area, std::span<const float> taps, BlurWorkspace& workspace,
                  const RowAt& row_at, const Done& done) {
  const int radius = static_cast<int>(taps.size()) - 1;
  const Region voted = grid.voted();
  RowBlur blur(static_cast<std::size_t>(area.width), taps, workspace);
  for (int y = area.y0; y < area.y0 + area.height + radius; ++y) {
    if (y >= voted.y0 && y < voted.y0 + voted.height) {
      grid.take_row(y, blur.input() + (voted.x0 - area.x0));
      blur.push();
    } else {
      blur.push_zeros();
    }
    if (y - radius < area.y0) continue;
    float* const row = row_at(y - radius);
    blur.pull(row);
    done(y - radius, row);
  }
}

}  // namespace emseg
