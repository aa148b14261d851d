// What a part of a window is by itself: where it lies, how widely, and how far it went.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event.hpp"
#include "emseg/image_velocity.hpp"

namespace emseg {

// px, borders included.
struct Box {
  double left = 0;
  double top = 0;
  double right = 0;
  double bottom = 0;
};

// Tiles of a sensor, row after row; those at its right and lower borders may be cut off.
struct TileGrid {
  int columns = 0;
  int rows = 0;
  int side = 1;  // px

  std::size_t size() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
};
TileGrid tiles_of(ImageSize sensor, int side);

// For every tile which of the groups of events has most events in it, the first of several; -1 where none has
// more than two.
std::vector<std::int32_t> winners_of_tiles(const EventView& events,
                                           std::span<const std::span<const std::int64_t>> groups,
                                           const TileGrid& tiles);

// How much of the view tiles that are not 0 span by their second moments: 1 for all of it, 0 without any.
double spread_of_tiles(std::span<const std::uint8_t> held, int columns);

// Of the pixels of some events, without the outermost fiftieth on every side.  Throws std::invalid_argument
// without any.
Box inner_box(const EventView& events, std::span<const std::int64_t> own, ImageSize sensor);

// Of places, without the outermost hundredth on every side, by quantiles that are interpolated.  Places that
// are not finite do not count; without any, a box of zeros.
Box outer_box(std::span<const Vec2f> places);

// How far some events went within their time, as a share of the displacement `along` (px) that their motion
// says: about 1 if that is true.  Late events of what moves lie further along than early ones.  1/2 where too
// little motion or too few events tell.
double share_gone(const EventView& events, std::span<const std::int64_t> own, Vec2d along);

}  // namespace emseg
