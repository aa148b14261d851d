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
std::vector<std::int32_t> axis_doubts(const BlockGrid& grid, const MotionModel& model, const WarpFrame& frame,
                                      double window, double cost);

}  // namespace emseg
