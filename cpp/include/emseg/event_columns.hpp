// Event arrays that own their columns.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

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
