#include "emseg/flicker.hpp"

#include <algorithm>
#include <cmath>

namespace emseg {
namespace {

constexpr std::size_t bin_us = 300;
constexpr std::size_t around = 40;      // bins either way that a bin is held against
constexpr std::size_t least_bins = 12;  // of a window
constexpr double usual_rank = 0.3;      // of the bins around: a lamp may burn half of the time
constexpr double times_usual = 2;       // and this many standard deviations of a count
constexpr double deviations = 8;
constexpr int tile = 16;              // px
constexpr double spread_share = 0.4;  // of the tiles that as many events of the window would fill

// Chance that a Poisson count of this mean is above `limit`.
double more_than(double limit, double mean) {
  double term = std::exp(-mean), below = 0;
  for (int count = 0; count <= limit; ++count) {
    below += term;
    term *= mean / (count + 1);
  }
  return 1 - below;
}

}  // namespace

std::vector<std::uint8_t> find_flicker(const EventView& events, ImageSize size) {
  const std::size_t n = events.size();
  std::vector<std::uint8_t> flicker(n, 0);
  if (n == 0) return flicker;
  const std::int64_t first = events.t.front();
  // Times may lie further apart than int64 holds.
  const auto bin_of = [&](std::size_t k) {
    return static_cast<std::size_t>(static_cast<std::uint64_t>(events.t[k]) -
                                    static_cast<std::uint64_t>(first)) /
           bin_us;
  };
  const std::size_t bins = bin_of(n - 1) + 1;
  if (bins < least_bins || bins > 8 * n) return flicker;
  std::vector<std::size_t> begin(bins + 1, n);  // first event of each bin
  for (std::size_t k = n; k-- > 0;) begin[bin_of(k)] = k;
  for (std::size_t b = bins; b-- > 0;) begin[b] = std::min(begin[b], begin[b + 1]);

  const int columns = (size.width + tile - 1) / tile;
  const int rows = (size.height + tile - 1) / tile;
  const auto tile_of = [&](std::size_t k) {
    return static_cast<std::size_t>(events.y[k] / tile * columns + events.x[k] / tile);
  };
  std::vector<double> share(static_cast<std::size_t>(columns * rows), 0);  // of the window's events
  for (std::size_t k = 0; k < n; ++k) share[tile_of(k)] += 1.0 / static_cast<double>(n);

  std::vector<std::size_t> counts;
  std::vector<double> in_tile(share.size());  // events of a bin
  for (std::size_t b = 0; b < bins; ++b) {
    const std::size_t own = begin[b + 1] - begin[b];
    const std::size_t low = b > around ? b - around : 0, high = std::min(bins, b + around + 1);
    counts.clear();
    for (std::size_t other = low; other < high; ++other) counts.push_back(begin[other + 1] - begin[other]);
    const auto rank =
        counts.begin() + static_cast<std::ptrdiff_t>(usual_rank * static_cast<double>(counts.size()));
    std::nth_element(counts.begin(), rank, counts.end());
    const auto usual = static_cast<double>(*rank);
    if (static_cast<double>(own) <= times_usual * usual + deviations * std::sqrt(usual + 1)) continue;
    // Tiles that have more than they usually do: one place with very many is not a burst all over the sensor,
    // whatever else moves meanwhile.
    std::fill(in_tile.begin(), in_tile.end(), 0.0);
    for (std::size_t k = begin[b]; k < begin[b + 1]; ++k) in_tile[tile_of(k)] += 1;
    double reached = 0, expected = 0;
    for (std::size_t i = 0; i < share.size(); ++i) {
      const double usual_here = usual * share[i];
      const double many = usual_here + std::sqrt(usual_here);
      reached += in_tile[i] > many ? 1 : 0;
      expected += more_than(many, static_cast<double>(own) * share[i]);
    }
    if (reached < spread_share * expected) continue;
    std::fill(flicker.begin() + static_cast<std::ptrdiff_t>(begin[b]),
              flicker.begin() + static_cast<std::ptrdiff_t>(begin[b + 1]), std::uint8_t{1});
  }
  return flicker;
}

}  // namespace emseg
