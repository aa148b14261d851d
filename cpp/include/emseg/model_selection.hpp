// Choosing among candidate motions: facility location over blocks of the image.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

// A division of the image plane into square blocks; each event belongs to one for good.
struct BlockGrid {
  Region plane;
  int block = 8;  // px
  int columns = 0;
  int rows = 0;
  std::vector<std::int32_t> of_event;
  std::vector<std::int32_t> event_count;  // per block

  std::size_t count() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
};

BlockGrid make_block_grid(const PointView& points, Region plane, int block);

// Cost of explaining each block's events by one model, with half of each neighbour's added: what is next to
// a motion tends to share it, as the Potts term will say later.  A mean, so that costs stay those of a
// block's worth of events.  `cost_of` gives an event's cost by its `sharpness`; `doubts`, where there are
// any, what every event of a block costs more.
std::vector<std::int32_t> block_costs(const BlockGrid& grid, std::span<const std::uint16_t> sharpness,
                                      std::span<const std::uint8_t> cost_of,
                                      std::span<const std::int32_t> doubts = {});

struct Selection {
  std::vector<std::size_t> chosen;     // candidates, in the order of their choice
  std::vector<std::int32_t> of_block;  // index into `chosen`; the cheapest for each block
  std::int64_t cost = 0;
};

// Minimises sum_b min_{m chosen} costs[m][b] + sum_{m chosen} label_costs[m] by adding, dropping and swapping
// candidates as long as that pays.  At least one is chosen.
// Each candidate's costs are >= 0 and add up to less than 2^31.
Selection select_models(const std::vector<std::vector<std::int32_t>>& costs,
                        std::span<const std::int64_t> label_costs);

}  // namespace emseg
