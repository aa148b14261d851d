// Positions that a caller names events by.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

#include "emseg/event.hpp"

namespace emseg {

// The position as an index. Throws std::invalid_argument where it is not one of an event.
inline std::size_t event_at(std::int64_t position, const EventView& events) {
  if (position < 0 || static_cast<std::uint64_t>(position) >= events.size()) {
    throw std::invalid_argument("position " + std::to_string(position) + ", expected one of " +
                                std::to_string(events.size()) + " events");
  }
  return static_cast<std::size_t>(position);
}

}  // namespace emseg
