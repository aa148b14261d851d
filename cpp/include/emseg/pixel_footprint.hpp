// The footprint of a pixel: what an event's place leaves open.
#pragma once

#include "emseg/event.hpp"
#include "emseg/motion_model.hpp"

namespace emseg {

// Scatters the events of a window over the pixels that they stand for, each by up to half a pixel either way.
//
// Pixels sample edges at whole numbers, and that makes structure of its own: motions under which whole
// numbers meet whole numbers, standing still among them, give sharper images than the true one.  Scattered,
// all motions are blurred by as much.  The scatter is a hash of the event's pixel and time since t_ref (us):
// what a clock counts from plays no part.
void scatter_over_pixels(const EventView& events, std::int64_t t_ref, Points& points);

}  // namespace emseg
