// Square blocks of active pixels: the coarsest level of a window's labelling.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event_graph.hpp"

namespace emseg {

// Blocks that hold pixels, in raster order.
struct PixelBlocks {
  std::int32_t count = 0;
  std::vector<std::int32_t> of_pixel;
  std::vector<std::int32_t> of_event;
  std::vector<std::int32_t> pixel_start;  // blocks + 1: rows of `pixels`
  std::vector<std::int32_t> pixels;

  // Neighbours in compressed rows, each pair in the row of its smaller end, with the number of edges between
  // events of one and of the other.
  std::vector<std::int64_t> indptr;
  std::vector<std::int32_t> indices;
  std::vector<std::int32_t> edge_count;

  std::span<const std::int32_t> pixels_of(std::int32_t block) const {
    const auto b = static_cast<std::size_t>(block);
    return {pixels.data() + pixel_start[b], pixels.data() + pixel_start[b + 1]};
  }
};

PixelBlocks make_pixel_blocks(const PixelGraph& graph, int side);

}  // namespace emseg
