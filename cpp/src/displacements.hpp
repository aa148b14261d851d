// Counts of the displacements between pairs of events, and the peaks in them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "kernels/kernel_table.hpp"

namespace emseg {

// Counts by displacement: row dy + patch_reach, column dx + patch_reach; the last column does not count.
template <typename Count>
using Displacements = std::array<Count, static_cast<std::size_t>(patch_rows) * patch_columns>;

struct DisplacementPeak {
  double dx = 0, dy = 0;    // px
  double significance = 0;  // of the counts about it beyond the mean, in standard deviations of chance
};

// Displacements, within `limit` px either way, that have most counts about them; best first, `most` of them,
// none below `least` in significance.
template <typename Count>
std::vector<DisplacementPeak> peaks_of(const Displacements<Count>& counts, int limit, std::size_t most,
                                       double least) {
  constexpr int reach = patch_reach;
  const auto index = [](int dx, int dy) {
    return static_cast<std::size_t>((dy + reach) * patch_columns + dx + reach);
  };
  std::uint64_t total = 0;  // exact, and not one addition after the other
  for (int dy = -reach; dy <= reach; ++dy) {
    for (int dx = -reach; dx <= reach; ++dx) total += counts[index(dx, dy)];
  }
  const double mean = static_cast<double>(total) / ((2 * reach + 1) * (2 * reach + 1));
  limit = std::min(limit, reach - 1);
  const double chance = std::sqrt(9 * mean + 1);
  // The highest of nine has at least a ninth of what they need.
  const auto enough = static_cast<std::uint32_t>(mean + least * chance / 9);
  std::vector<DisplacementPeak> peaks;
  for (int dy = -limit; dy <= limit; ++dy) {
    for (int dx = -limit; dx <= limit; ++dx) {
      const Count middle = counts[index(dx, dy)];
      if (middle <= enough) continue;
      bool highest = true;
      for (int j = -1; highest && j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) highest = highest && counts[index(dx + i, dy + j)] <= middle;
      }
      if (!highest) continue;
      double sum = 0, along_x = 0, along_y = 0;
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) {
          const Count count = counts[index(dx + i, dy + j)];
          const double excess = std::max(0.0, count - mean);
          sum += excess;
          along_x += i * excess;
          along_y += j * excess;
        }
      }
      if (sum < least * chance) continue;
      peaks.push_back({dx + along_x / sum, dy + along_y / sum, sum / chance});
    }
  }
  std::stable_sort(peaks.begin(), peaks.end(), [](const DisplacementPeak& a, const DisplacementPeak& b) {
    return a.significance > b.significance;
  });
  if (peaks.size() > most) peaks.resize(most);
  return peaks;
}

}  // namespace emseg
