#include "emseg/event.hpp"

#include <stdexcept>
#include <string>

namespace emseg {

void check_events(const EventView& events, ImageSize size) {
  if (size.width <= 0 || size.height <= 0 || size.width > 65536 || size.height > 65536) {
    throw std::invalid_argument("sensor size is " + std::to_string(size.width) + "x" +
                                std::to_string(size.height) + ", expected 1..65536 each way");
  }
  const std::size_t n = events.t.size();
  if (events.x.size() != n || events.y.size() != n || events.p.size() != n) {
    throw std::invalid_argument("event columns have different lengths: x " + std::to_string(events.x.size()) +
                                ", y " + std::to_string(events.y.size()) + ", t " + std::to_string(n) +
                                ", p " + std::to_string(events.p.size()));
  }
  for (std::size_t k = 0; k < n; ++k) {
    if (events.x[k] >= size.width || events.y[k] >= size.height) {
      throw std::invalid_argument("event " + std::to_string(k) + " lies at (" + std::to_string(events.x[k]) +
                                  ", " + std::to_string(events.y[k]) + "), outside the sensor of " +
                                  std::to_string(size.width) + "x" + std::to_string(size.height));
    }
    if (events.p[k] > 1) {
      throw std::invalid_argument("event " + std::to_string(k) + " has polarity " +
                                  std::to_string(events.p[k]) + ", expected 0 or 1");
    }
    if (k > 0 && events.t[k] < events.t[k - 1]) {
      throw std::invalid_argument("event " + std::to_string(k) + " has time " + std::to_string(events.t[k]) +
                                  " us, before its predecessor's " + std::to_string(events.t[k - 1]) +
                                  " us; events must be sorted by time");
    }
  }
}

}  // namespace emseg
