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

EventColumns take_events(const EventView& events, std::span<const std::int64_t> positions) {
  const std::size_t n = positions.size();
  const auto count = static_cast<std::int64_t>(events.size());
  EventColumns taken{std::vector<std::uint16_t>(n), std::vector<std::uint16_t>(n),
                     std::vector<std::int64_t>(n), std::vector<std::uint8_t>(n)};
  std::int64_t before = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::int64_t asked = positions[i];
    if (asked < -count || asked >= count) {
      throw std::out_of_range("index " + std::to_string(asked) + " is out of range for " +
                              std::to_string(count) + " events");
    }
    const std::int64_t from = asked < 0 ? asked + count : asked;
    if (from < before) {
      throw std::invalid_argument("indices fall from " + std::to_string(before) + " to " +
                                  std::to_string(from) + ", expected them rising: events stay in time order");
    }
    before = from;
    const auto k = static_cast<std::size_t>(from);
    taken.x[i] = events.x[k];
    taken.y[i] = events.y[k];
    taken.t[i] = events.t[k];
    taken.p[i] = events.p[k];
  }
  return taken;
}

}  // namespace emseg
