// Where some of a window's events lie at its reference time.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event.hpp"
#include "emseg/motion_model.hpp"

namespace emseg {

// Undistorted places of a sensor's pixels, row after row, borrowed; without any, pixels are where they are.
struct PixelPlaces {
  std::span<const float> x;
  std::span<const float> y;
  int width = 0;
};

// Warped places of the events at the positions `own`, at t_ref (us).
// Throws std::invalid_argument where a position is not one of an event, or its pixel has no place.
std::vector<Vec2f> warp_events(const EventView& events, std::span<const std::int64_t> own, std::int64_t t_ref,
                               const MotionModel& model, const WarpFrame& frame,
                               const PixelPlaces& places = {});

}  // namespace emseg
