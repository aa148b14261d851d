// Doubt about motions that explain by chance: fast ones, and those along the columns or rows of pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/model_selection.hpp"

namespace emseg {

// A straight edge that nearly follows a column of pixels and drifts across it passes one pixel of the column
// after the other.  Warped fast along the column, its events fall on one point, which is sharper than the
// edge that they truly come from.  True motions have all directions, false ones those of the grid.
//
// The further a motion goes, the more pixels there are on its way whose events may meet by chance: what is as
// sharp by a slow motion is better explained by it (a prior as that of Weiss, Simoncelli & Adelson, "Motion
// illusions as optimal percepts", Nature Neuroscience 2002).
struct DoubtOptions {
  // What an event costs more by a model that is fast along an axis and hardly across it: from 4 px over the
  // window on, and fully so from 8 px; across, 1.5 px and a twentieth of the way along at the most, and fully
  // so 1 px below that.
  double axis = 0;
  double speed = 0;  // what it costs more by every motion, times log(1 + px over the window / 10)
};

// What the events of each block cost more by a model.
class MotionDoubt {
 public:
  // `window` in s.
  MotionDoubt(const BlockGrid& grid, double window, const DoubtOptions& options);

  // Of a model, per block.
  std::vector<std::int32_t> of(const MotionModel& model, const WarpFrame& frame) const;

 private:
  std::size_t block_count_;
  DoubtOptions options_;
  Points ends_;  // the middle of every block, at the window's beginning and at its end
};

}  // namespace emseg
