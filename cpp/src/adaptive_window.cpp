#include "emseg/adaptive_window.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "emseg/iwe.hpp"
#include "emseg/window.hpp"

namespace emseg {
namespace {

constexpr int tile = velocity_tile;        // step of regions twice as wide, px
constexpr double same_displacement = 1.6;  // px over the window
constexpr double enough_displacement =
    5;                           // px over the window: more than pixels' rounding makes, so no accident
constexpr int enough_alike = 4;  // of eight neighbours, which overlap by half or less
constexpr std::size_t enough_in_window = 200;
constexpr int enough_in_tile = 20;

// What a window of one duration tells of the speed of the scene.
struct Rung {
  double speed = 0;  // px/us, median over the tiles that agree with their neighbours; 0 for unknown
  int tiles = 0;     // that agree
};

Rung judge(const EventView& window, std::int64_t duration_us, ImageSize size,
           const AdaptiveWindowOptions& options, ThreadPool& pool) {
  check_events(window, size);
  const Points points = make_points(window, std::midpoint(window.t.front(), window.t.back()));
  const int columns = (size.width + tile - 1) / tile;
  const int rows = (size.height + tile - 1) / tile;
  const auto index = [&](int column, int row) { return static_cast<std::size_t>(row * columns + column); };
  std::vector<int> events(index(0, rows), 0);
  for (std::size_t k = 0; k < window.size(); ++k) ++events[index(window.x[k] / tile, window.y[k] / tile)];
  std::vector<Region> regions;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column)
      regions.push_back({column * tile, row * tile, 2 * tile, 2 * tile});
  }
  RegionVelocityOptions search;
  search.max_speed = options.max_speed;
  search.per_region = 1;
  search.max_lags = 1;  // shorter windows of the ladder reach faster motions
  search.max_events = 60'000;
  const auto found =
      find_region_velocities(points.view(), window.p, regions, sensor_region(size), search, pool);

  const auto known = [&](int column, int row) {
    return column >= 0 && row >= 0 && column < columns && row < rows &&
           events[index(column, row)] >= enough_in_tile && !found[index(column, row)].empty();
  };
  const auto velocity = [&](int column, int row) { return found[index(column, row)].front(); };
  const double px_per_speed = 1e-6 * static_cast<double>(duration_us);
  std::vector<double> speeds;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      if (!known(column, row)) continue;
      const RegionVelocity own = velocity(column, row);
      int alike = -1;  // not itself
      for (int j = row - 1; j <= row + 1; ++j) {
        for (int i = column - 1; i <= column + 1; ++i) {
          if (!known(i, j)) continue;
          const RegionVelocity other = velocity(i, j);
          alike += std::hypot(own.vx - other.vx, own.vy - other.vy) * px_per_speed < same_displacement;
        }
      }
      if (alike >= enough_alike) speeds.push_back(1e-6 * std::hypot(own.vx, own.vy));
    }
  }
  if (speeds.empty()) return {};
  const auto middle = speeds.begin() + static_cast<std::ptrdiff_t>(speeds.size() / 2);
  std::nth_element(speeds.begin(), middle, speeds.end());
  if (*middle * static_cast<double>(duration_us) < enough_displacement) return {};
  return {*middle, static_cast<int>(speeds.size())};
}

}  // namespace

std::int64_t judge_duration(const EventView& events, std::size_t begin, ImageSize size,
                            const AdaptiveWindowOptions& options, ThreadPool& pool) {
  std::vector<Rung> rungs;
  int tiles = 0;
  for (std::int64_t duration = 3'000; duration <= options.max_duration_us; duration *= 2) {
    const std::size_t end = window_end(events.t, begin, duration);
    const EventView window = events.slice(begin, std::min(end, begin + options.max_events));
    if (window.size() >= enough_in_window) {
      rungs.push_back(judge(window, duration, size, options, pool));
      tiles += rungs.back().tiles;
    }
    if (window.size() == options.max_events || end == events.size()) break;
  }
  // Where nothing moves visibly, a window may be as long as it likes.
  if (tiles == 0) return options.max_duration_us;
  // False agreements scatter over all speeds, true ones repeat from rung to rung: the weighted median.
  std::sort(rungs.begin(), rungs.end(), [](const Rung& a, const Rung& b) { return a.speed < b.speed; });
  int below = 0;
  double speed = 0;
  for (const Rung& rung : rungs) {
    below += rung.tiles;
    speed = rung.speed;
    if (2 * below >= tiles) break;
  }
  return std::clamp(static_cast<std::int64_t>(std::llround(options.displacement / speed)),
                    options.min_duration_us, options.max_duration_us);
}

std::int64_t next_duration(std::int64_t duration_us, double displacement,
                           const AdaptiveWindowOptions& options) {
  const double factor = displacement > 0 ? std::clamp(options.displacement / displacement, 0.5, 2.0) : 2.0;
  return std::llround(std::clamp(factor * static_cast<double>(duration_us),
                                 static_cast<double>(options.min_duration_us),
                                 static_cast<double>(options.max_duration_us)));
}

}  // namespace emseg
