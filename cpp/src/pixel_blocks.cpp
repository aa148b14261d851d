#include "pixel_blocks.hpp"

#include <algorithm>
#include <numeric>

namespace emseg {
namespace {

void assign_pixels(const PixelGraph& graph, int side, PixelBlocks& blocks) {
  int right = 0, bottom = 0;
  for (const Pixel& pixel : graph.pixels) {
    right = std::max(right, pixel.x);
    bottom = std::max(bottom, pixel.y);
  }
  const std::int32_t columns = right / side + 1, rows = bottom / side + 1;
  std::vector<std::int32_t> number(static_cast<std::size_t>(columns * rows), -1);
  blocks.of_pixel.resize(graph.pixels.size());
  for (std::size_t p = 0; p < graph.pixels.size(); ++p) {
    blocks.of_pixel[p] = graph.pixels[p].y / side * columns + graph.pixels[p].x / side;
    number[blocks.of_pixel[p]] = 0;
  }
  for (std::int32_t& block : number) {
    if (block == 0) block = blocks.count++;
  }

  blocks.pixel_start.assign(blocks.count + 2,
                            0);  // filled one place late, so that scattering leaves the starts
  for (std::int32_t& block : blocks.of_pixel) {
    block = number[block];
    ++blocks.pixel_start[block + 2];
  }
  std::partial_sum(blocks.pixel_start.begin(), blocks.pixel_start.end(), blocks.pixel_start.begin());
  blocks.pixels.resize(graph.pixels.size());
  for (std::int32_t p = 0; p < graph.pixel_count(); ++p) {
    blocks.pixels[blocks.pixel_start[blocks.of_pixel[p] + 1]++] = p;
  }
  blocks.pixel_start.pop_back();
  blocks.of_event.resize(graph.event_count());
  for (std::size_t k = 0; k < blocks.of_event.size(); ++k) {
    blocks.of_event[k] = blocks.of_pixel[graph.pixel_of_event[k]];
  }
}

void join_blocks(const PixelGraph& graph, PixelBlocks& blocks) {
  std::vector<std::int32_t> place(blocks.count, -1);  // of the latest edge to each block
  blocks.indptr.reserve(blocks.count + 1);
  blocks.indptr.push_back(0);
  for (std::int32_t b = 0; b < blocks.count; ++b) {
    const auto row = static_cast<std::int32_t>(blocks.indices.size());
    for (const std::int32_t p : blocks.pixels_of(b)) {
      for (const std::int32_t q : graph.neighbours_of(p)) {
        const std::int32_t c = blocks.of_pixel[q];
        if (c <= b) continue;
        if (place[c] < row) {
          place[c] = static_cast<std::int32_t>(blocks.indices.size());
          blocks.indices.push_back(c);
          blocks.edge_count.push_back(0);
        }
        blocks.edge_count[place[c]] += count_event_edges(graph.events_of(p), graph.events_of(q));
      }
    }
    blocks.indptr.push_back(static_cast<std::int64_t>(blocks.indices.size()));
  }
}

}  // namespace

PixelBlocks make_pixel_blocks(const PixelGraph& graph, int side) {
  PixelBlocks blocks;
  assign_pixels(graph, side, blocks);
  join_blocks(graph, blocks);
  return blocks;
}

}  // namespace emseg
