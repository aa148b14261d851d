// Objects that are known to be in a window: how each moves, and where it was.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/image.hpp"
#include "emseg/motion_model.hpp"

namespace emseg {

constexpr std::int32_t no_object = -1;  // where the index of a tracked object is asked for

struct TrackedObject {
  MotionModel model;
  std::vector<Vec2f> places = {};  // of some of its events on the image plane, px; none: it may be anywhere
  double seen = 0;                 // when they were there, s after t_ref
};

// Per point, whether it is where its object is expected once both are moved to t_ref by the object's motion:
// not much further than a cell of 4 px from one of its places.  Empty for an object that may be anywhere.
std::vector<std::uint8_t> where_expected(const PointView& points, const TrackedObject& object,
                                         const WarpFrame& frame, Region plane);

}  // namespace emseg
