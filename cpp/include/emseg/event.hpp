// Event arrays: what a camera reports, borrowed column by column.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

// Sensor size in pixels.
struct ImageSize {
  int width = 0;
  int height = 0;

  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

// The columns of an event array, borrowed.  Event k is (x[k], y[k], t[k], p[k]); t is in microseconds and
// never decreases; p is 1 for a rise in brightness and 0 for a fall.
struct EventView {
  std::span<const std::uint16_t> x;
  std::span<const std::uint16_t> y;
  std::span<const std::int64_t> t;
  std::span<const std::uint8_t> p;

  std::size_t size() const { return t.size(); }
  bool empty() const { return t.empty(); }

  // Events begin .. end-1.
  EventView slice(std::size_t begin, std::size_t end) const {
    return {x.subspan(begin, end - begin), y.subspan(begin, end - begin), t.subspan(begin, end - begin),
            p.subspan(begin, end - begin)};
  }
};

// Seconds from one time (us) to another, to the microsecond even where int64 does not hold the difference.
inline double seconds_between(std::int64_t from, std::int64_t to) {
  const auto distance = [](std::int64_t early, std::int64_t late) {
    return 1e-6 * static_cast<double>(static_cast<std::uint64_t>(late) - static_cast<std::uint64_t>(early));
  };
  return from <= to ? distance(from, to) : -distance(to, from);
}

// Checks lengths, coordinates, polarities and time order.
// Throws std::invalid_argument that names the first offending event and what was expected.
void check_events(const EventView& events, ImageSize size);

// Events column by column, owned; see EventView.
struct EventColumns {
  std::vector<std::uint16_t> x;
  std::vector<std::uint16_t> y;
  std::vector<std::int64_t> t;
  std::vector<std::uint8_t> p;

  std::size_t size() const { return t.size(); }
  void append(std::uint16_t x_px, std::uint16_t y_px, std::int64_t t_us, bool rise) {
    x.push_back(x_px);
    y.push_back(y_px);
    t.push_back(t_us);
    p.push_back(rise ? 1 : 0);
  }
};

// The events at some positions, counted from the end where below 0; the positions never fall.
// Throws std::out_of_range or std::invalid_argument at the first that is none or falls.
EventColumns take_events(const EventView& events, std::span<const std::int64_t> positions);

}  // namespace emseg
