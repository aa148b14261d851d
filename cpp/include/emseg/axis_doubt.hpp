// Doubt about motions along the columns or rows of pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/model_selection.hpp"

namespace emseg {

// A straight edge that nearly follows a column of pixels and drifts across it passes one pixel of the column
// after the other.  Warped fast along the column, its events fall on one point, which is sharper than the
// edge that they truly come from.  True motions have all directions, false ones those of the grid.
//
// What an event in each block costs more, up to `cost`, by a model that is fast along an axis there and
// hardly across it.  It is fast from 4 px over the window (s) on, and fully so from 8 px; across it is 1.5 px
// and a twentieth of the way along at the most, and fully so 1 px below that.
class AxisDoubts {
 public:
  AxisDoubts(const BlockGrid& grid, double window, double cost);

  // Of a model, per block.
  std::vector<std::int32_t> of(const MotionModel& model, const WarpFrame& frame) const;

 private:
  std::size_t block_count_;
  double cost_;
  Points ends_;  // the middle of every block, at the window's beginning and at its end
};

}  // namespace emseg
