// One sweep over image velocities, shared by all sub-volumes of the image plane.
//
// Warping all events by one velocity scores every sub-volume at once: a sub-volume moves with the velocity
// that piles its events up.  Coarse to fine in time as well as in velocity: a short slice in the middle of
// the window tells fast motions apart in few, large steps; each level doubles the slice and halves the step
// around the best so far.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/image.hpp"
#include "emseg/motion_model.hpp"
#include "emseg/parallel.hpp"

namespace emseg {

struct SweepOptions {
  double max_speed = 5000;        // largest speed searched, px/s (Affine_trans2d_max)
  double cell = 2;                // side of the cells that count votes, px; scores are added up in tiles of 8 x 8 of them
  double step = 3.75;             // distance between neighbouring velocities over a slice, px
  double first_reach = 30;        // displacement of max_speed over the first slice, px
  std::size_t max_events = 4000;  // events used of a slice
  std::size_t max_branches = 24;  // velocities refined at each level
  std::size_t per_region = 1;     // velocities kept of each sub-volume
};

struct VelocityScore {
  double vx = 0, vy = 0;  // px/s
  double score = 0;       // votes that coincide beyond chance, per event
};

// Best velocities of each region of `plane`, best first, at the last level (the whole window).  Regions are
// rounded to tiles. `positive` tells polarities apart (votes of opposite polarity do not coincide); points
// are sorted by dt.
std::vector<std::vector<VelocityScore>> sweep_velocities(const PointView& points,
                                                         std::span<const std::uint8_t> positive,
                                                         std::span<const Region> regions, Region plane,
                                                         const SweepOptions& options, ThreadPool& pool);

}  // namespace emseg
