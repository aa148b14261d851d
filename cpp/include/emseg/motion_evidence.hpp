// How much less sharp another motion than its own makes a group of events.
#pragma once

#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

// Mean over the points of ln(own sharpness / sharpness under `other` plus each offset), nats.  An offset is a
// displacement over `window` seconds, px.  Sharpness is as in count_sharpness, a fifth of the 95 % quantile
// of the own ones added on both sides, so that what is dark by chance says little.  Empty without points.
std::vector<double> sharpness_losses(const PointView& points, const MotionModel& own,
                                     const MotionModel& other, std::span<const Vec2f> offsets, double window,
                                     const WarpFrame& frame, Region canvas);

}  // namespace emseg
