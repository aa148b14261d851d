// Images of warped events for the search: whole votes in 16-bit cells, smoothed by a binomial.  They cost a
// fraction of the exact ones (iwe.hpp) and rank candidates alike.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/iwe.hpp"

namespace emseg {

// Values of a count image per coinciding event, far from others.
constexpr int counts_per_event = 16;
// Votes of a cell that count, either way, once those of the other sign are taken off.
constexpr int most_votes = 127;
// One more than the largest value.
constexpr int count_levels = most_votes * counts_per_event + 1;

// Scratch of count_sharpness, kept from call to call.
struct CountWorkspace {
  std::vector<float> x, y;            // warped positions
  std::vector<std::int32_t> cell;     // of every point, in the padded image
  std::vector<std::int16_t> sign;     // of every point
  std::vector<std::uint16_t> votes;   // the image, padded by the binomial's radius
  std::vector<std::uint16_t> column;  // one row after the vertical pass
  std::vector<std::uint16_t> smooth;  // the smoothed image
};

// For every point the smoothed count at its warped place: votes of the nearest pixels under the weights
// (1 4 6 4 1)/16 each way, which stand for a blur of sigma 1 px, in units of 1/counts_per_event of an event.
// Points warped off `canvas` get 0.  Points with signs vote theirs, in turn, and see the counts by it: where
// the other sign prevails they get 0.
void count_sharpness(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region canvas,
                     CountWorkspace& workspace, std::span<std::uint16_t> sharpness);

}  // namespace emseg
