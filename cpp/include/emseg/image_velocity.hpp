// How fast motions move what is at a place.
#pragma once

#include "emseg/motion_model.hpp"

namespace emseg {

struct Vec2d {
  double x = 0;
  double y = 0;
};

// Velocity (px/s) at t_ref of what lies at a place (px, undistorted): -d/d(dt) of the model's warp at dt = 0.
Vec2d image_velocity(const MotionModel& model, const WarpFrame& frame, Vec2d place);

}  // namespace emseg
