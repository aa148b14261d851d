// Choosing among candidate motions: facility location over blocks of the image.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/data_term.hpp"

namespace emseg {

// A division of the image plane into square blocks; each event belongs to one for good.
struct BlockGrid {
  Region plane;
  int block = 8;  // px
  int columns = 0;
  int rows = 0;
  std::vector<std::int32_t> of_event;

  std::size_t count() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
};

BlockGrid make_block_grid(const PointView& points, Region plane, int block);

// Cost of explaining each block's events by one model, with half of each neighbour's added: what is next to
// a motion tends to share it, as the Potts term will say later.
std::vector<float> block_costs(const BlockGrid& grid, const ModelSupport& support, DataTerm term,
                               double reference, double lambda_data);

struct Selection {
  std::vector<std::size_t> chosen;     // candidates, in the order of their choice
  std::vector<std::int32_t> of_block;  // index into `chosen`; the cheapest for each block
  double cost = 0;
};

// Minimises sum_b min_{m chosen} costs[m][b] + label_cost |chosen| by adding, dropping and swapping
// candidates as long as that pays.  At least one is chosen.
Selection select_models(const std::vector<std::vector<float>>& costs, double label_cost);

}  // namespace emseg
