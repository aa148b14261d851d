// Which way the edges in an image of events run, block by block: along them nobody sees how far they move.
#pragma once

#include <vector>

#include "emseg/model_selection.hpp"

namespace emseg {

// Products of the image's gradients, summed; what single events add by themselves is taken away, so that
// events scattered at random come to nothing in the mean.
struct StructureTensor {
  double xx = 0;
  double xy = 0;
  double yy = 0;
  double single = 0;  // what was taken away of xx, and of yy

  void add(const StructureTensor& other);
};

// Structure tensors of the blocks of a grid (Förstner & Gülch, 1987), of signed images of events as they lie.
// The window is cut into `slices` of like duration with an image each, in which edges hardly move.
std::vector<StructureTensor> structure_tensors(const PointView& points, const BlockGrid& grid, int slices);

constexpr int edge_slices = 6;

struct EdgeDirection {
  float x = 0;  // along the edges of a block, as long as they are straight: 1 where all run one way, 0 where
  float y = 0;  // they run all ways, or where there are none
};

// Of every block, from the tensors of it and of its neighbours.  Blocks whose edges stand out less than
// `plain` times as much as single events have none.
std::vector<EdgeDirection> edge_directions(const std::vector<StructureTensor>& tensors, const BlockGrid& grid,
                                           double plain);

}  // namespace emseg
