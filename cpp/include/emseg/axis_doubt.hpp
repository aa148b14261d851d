// Doubt about motions along the columns or rows of pixels.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/model_selection.hpp"
#include "emseg/motion_model.hpp"

namespace emseg {

// A straight edge that nearly follows a column of pixels and drifts across it passes one pixel of the column
// after the other.  Warped fast along the column, its events fall on one point, which is sharper than the edge
// that they truly come from.  True motions have all directions: of one that is fast along a column or a row
// and hardly across it, every event costs `cost` more, where it is.
std::vector<std::int32_t> axis_doubts(const BlockGrid& grid, const MotionModel& model, const WarpFrame& frame,
                                      double window, double cost);

}  // namespace emseg
