// Places of one motion that lie apart: parts that are objects of their own.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

// For every cell of a grid of `columns` columns the component that it belongs to, diagonal neighbours joined;
// -1 where it is not occupied.  Components are numbered from 0 by their first cell in raster order.
std::vector<std::int32_t> connected_components(std::span<const std::uint8_t> occupied, int columns);

// The part of every place: places of two parts lie more than about `gap` px apart.  Parts are numbered from
// 0, largest first.  Crumbs, with less than 30 places or a twenty-fifth of the largest part's, are numbered
// -1, as are places that are not finite.  Throws std::invalid_argument where the gap is not above 0.
std::vector<std::int32_t> split_apart(std::span<const Vec2f> places, int gap);

// The positions of every value 0 .. count-1 among `values`, rising; of other values there are none.
std::vector<std::vector<std::int64_t>> positions_of_values(std::span<const std::int32_t> values,
                                                           std::int32_t count);

}  // namespace emseg
