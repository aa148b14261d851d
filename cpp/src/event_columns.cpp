#include "emseg/event_columns.hpp"

#include <stdexcept>
#include <string>

namespace emseg {

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
