// Velocities that many events agree on, from pairs of events: a start for fits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

struct FoundVelocity {
  double vx = 0, vy = 0;    // px/s
  double significance = 0;  // pairs beyond chance, in standard deviations of chance
};

// Velocities up to `max_speed` px/s along either axis at which events of one polarity reappear, most
// significant first.
//
// Slices of the window are correlated with slices `lag` later: each pair of events votes for its
// displacement. The longest lag is half the window; shorter ones, by thirds, reach faster motions, which are
// then followed back to the longest.  `max_events`, at most 8000, of each lag look for partners.  Points are
// sorted by dt; those outside `plane` do not count.
std::vector<FoundVelocity> find_velocities(const PointView& points, std::span<const std::uint8_t> positive,
                                           Region plane, double max_speed, std::size_t max_events = 1000);

// Pairs of events, of at most `max_events` evenly thinned ones, that a model brings into one cell of 2 px and
// one polarity.
double count_coincidences(const PointView& points, std::span<const std::uint8_t> positive,
                          const MotionModel& model, const WarpFrame& frame, Region region,
                          std::size_t max_events);

}  // namespace emseg
