// Flicker: bursts of events all over the sensor, when a lamp and not a motion changes the brightness.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

// Per event of a window, 1 where it belongs to a burst: to a bin of time in which far more events fire than
// in those around it, and more than usual all over what is seen of the scene.  Motion begins and ends in one
// place, light in all.
std::vector<std::uint8_t> find_flicker(const EventView& events, ImageSize size);

}  // namespace emseg
