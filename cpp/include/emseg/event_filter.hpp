// Filters that pass through a stream of events, chunk by chunk.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

// Keeps events that have company: one at a neighbouring pixel (of eight) not long before.  Noise of the
// sensor has none.  After Delbruck, "Frame-free dynamic digital vision", 2008.
class BackgroundActivityFilter {
 public:
  // Throws std::invalid_argument unless the sensor has pixels and the duration is positive.
  BackgroundActivityFilter(ImageSize size, std::int64_t duration_us);

  // Per event of the next chunk, 1 to keep it and 0 to drop it; what is dropped is company too.
  // Throws std::invalid_argument where the events are not sound, see check_events.
  std::vector<std::uint8_t> keep(const EventView& events);

 private:
  ImageSize size_;
  std::uint64_t duration_us_;
  std::vector<std::int64_t> last_;  // time of each pixel's last event; with a margin of one pixel all around
};

}  // namespace emseg
