// What both triangulations ask of their pixels.
#pragma once

#include <algorithm>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>

#include "emseg/event_graph.hpp"

namespace emseg {

struct PixelBox {
  int min_x = std::numeric_limits<int>::max(), max_x = std::numeric_limits<int>::min();
  int min_y = std::numeric_limits<int>::max(), max_y = std::numeric_limits<int>::min();

  std::int64_t width() const { return std::int64_t{max_x} - min_x; }
  std::int64_t height() const { return std::int64_t{max_y} - min_y; }
};

// Throws std::invalid_argument where the pixels are too many or lie too far apart for exact decisions.
inline PixelBox bounding_box(std::span<const Pixel> pixels) {
  constexpr std::int64_t max_extent = 65535;  // px; the coordinates of events are 16 bit
  if (pixels.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw std::invalid_argument(std::to_string(pixels.size()) + " pixels, expected fewer than 2^31");
  }
  PixelBox box;
  for (const Pixel& pixel : pixels) {
    box.min_x = std::min(box.min_x, pixel.x);
    box.max_x = std::max(box.max_x, pixel.x);
    box.min_y = std::min(box.min_y, pixel.y);
    box.max_y = std::max(box.max_y, pixel.y);
  }
  if (box.width() > max_extent || box.height() > max_extent) {
    throw std::invalid_argument("pixels span " + std::to_string(box.width()) + " x " +
                                std::to_string(box.height()) + " px, expected at most " +
                                std::to_string(max_extent) + " each way");
  }
  return box;
}

}  // namespace emseg
