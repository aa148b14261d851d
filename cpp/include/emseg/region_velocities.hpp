// Image velocities of many regions at once, from pairs of events.
//
// An edge that moves with velocity v leaves events at x and, a time `lag` later, at x + v lag.  Every event
// votes for the displacements to all events about `lag` later and within reach; the votes of a region pile up
// at its velocity.  Votes are gathered once a tile, and a region adds up its tiles: what a sweep over
// velocities would learn from hundreds of warped images comes from one pass over the events.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/image.hpp"
#include "emseg/motion_model.hpp"
#include "emseg/parallel.hpp"

namespace emseg {

struct RegionVelocity {
  double vx = 0, vy = 0;    // px/s
  double significance = 0;  // votes beyond chance, in standard deviations of chance
};

struct RegionVelocityOptions {
  double max_speed = 5000;     // largest |vx| and |vy|, px/s (Affine_trans2d_max)
  std::size_t per_region = 2;  // velocities of each region
  std::size_t max_lags = 10;   // the first reaches 30 px over the window, each further one three times that
  std::size_t max_events = 15'000;  // used of a window, evenly in time
  std::size_t max_followed = 8;     // velocities of a short lag that are followed back
  std::size_t max_voters = 8000;    // events whose displacements to later ones count, at each lag
  std::size_t max_followers = 800;  // and where a velocity is followed back
  double least_significance = 5;    // the largest of all displacements by chance is about 4
};

constexpr int velocity_tile = 32;  // px; regions are rounded to whole tiles, at least one

// For every region its most significant velocities, best first.  Points are sorted by dt.  Lags are half the
// window and, for faster motions, a third of that, and so on; what a short lag finds is followed back to the
// longest.
std::vector<std::vector<RegionVelocity>> find_region_velocities(const PointView& points,
                                                                std::span<const std::uint8_t> positive,
                                                                std::span<const Region> regions, Region plane,
                                                                const RegionVelocityOptions& options,
                                                                ThreadPool& pool);

}  // namespace emseg
