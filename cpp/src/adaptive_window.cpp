#include "emseg/adaptive_window.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "emseg/iwe.hpp"
#include "emseg/window.hpp"

namespace emseg {
namespace {

constexpr int tile = 32;                   // px
constexpr double same_displacement = 1.6;  // px over the window
constexpr std::size_t enough_in_window = 200;
constexpr int enough_in_tile = 20;

struct TileMotion {
  bool known = false;
  double dx = 0, dy = 0;  // px over the window
};

struct Rung {
  std::int64_t duration_us = 0;
  double agreement = 0;     // share of neighbouring tiles that move alike
  double displacement = 0;  // quantile over the tiles, px
};

Rung judge(const EventView& window, std::int64_t duration_us, ImageSize size,
           const AdaptiveWindowOptions& options, ThreadPool& pool) {
  check_events(window, size);
  const Points points = make_points(window, std::midpoint(window.t.front(), window.t.back()));
  const int columns = (size.width + tile - 1) / tile;
  const int rows = (size.height + tile - 1) / tile;
  std::vector<int> events(static_cast<std::size_t>(columns * rows), 0);
  for (std::size_t k = 0; k < window.size(); ++k) {
    ++events[static_cast<std::size_t>(window.y[k] / tile * columns + window.x[k] / tile)];
  }
  std::vector<Region> regions;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column)
      regions.push_back({column * tile, row * tile, tile, tile});
  }
  SweepOptions sweep;
  sweep.max_speed = options.max_speed;
  sweep.per_region = 1;
  const auto velocities =
      sweep_velocities(points.view(), window.p, regions, sensor_region(size), sweep, pool);

  Rung rung;
  rung.duration_us = duration_us;
  const double seconds = 1e-6 * static_cast<double>(duration_us);
  std::vector<TileMotion> motions(regions.size());
  std::vector<double> lengths;
  for (std::size_t r = 0; r < regions.size(); ++r) {
    if (events[r] < enough_in_tile || velocities[r].empty()) continue;
    const VelocityScore& v = velocities[r].front();
    motions[r] = {true, v.vx * seconds, v.vy * seconds};
    lengths.push_back(std::hypot(motions[r].dx, motions[r].dy));
  }
  if (lengths.empty()) return rung;
  int pairs = 0, alike = 0;
  const auto compare = [&](const TileMotion& a, const TileMotion& b) {
    if (!a.known || !b.known) return;
    ++pairs;
    alike += std::hypot(a.dx - b.dx, a.dy - b.dy) < same_displacement;
  };
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const auto here = static_cast<std::size_t>(row * columns + column);
      if (column + 1 < columns) compare(motions[here], motions[here + 1]);
      if (row + 1 < rows) compare(motions[here], motions[here + static_cast<std::size_t>(columns)]);
    }
  }
  rung.agreement = pairs > 0 ? static_cast<double>(alike) / pairs : 0;
  const auto rank = static_cast<std::ptrdiff_t>(options.quantile * static_cast<double>(lengths.size() - 1));
  std::nth_element(lengths.begin(), lengths.begin() + rank, lengths.end());
  rung.displacement = lengths[static_cast<std::size_t>(rank)];
  return rung;
}

}  // namespace

std::int64_t judge_duration(const EventView& events, std::size_t begin, ImageSize size,
                            const AdaptiveWindowOptions& options, ThreadPool& pool) {
  std::vector<Rung> rungs;
  for (std::int64_t duration = 3'000; duration <= options.max_duration_us; duration *= 2) {
    const std::size_t end = window_end(events.t, begin, duration);
    const EventView window = events.slice(begin, end);
    if (window.size() >= enough_in_window) rungs.push_back(judge(window, duration, size, options, pool));
    if (end == events.size() || (!rungs.empty() && rungs.back().displacement > 4 * options.displacement))
      break;
  }
  double most = 0;
  for (const Rung& rung : rungs) most = std::max(most, rung.agreement);
  const Rung* best = nullptr;
  for (const Rung& rung : rungs) {
    if (rung.agreement >= 0.6 * most && rung.displacement < 1.5 * options.displacement) best = &rung;
  }
  if (!best) return rungs.empty() ? options.max_duration_us : rungs.front().duration_us;
  return next_duration(best->duration_us, best->displacement, options);
}

std::int64_t next_duration(std::int64_t duration_us, double displacement,
                           const AdaptiveWindowOptions& options) {
  const double factor = displacement > 0 ? std::clamp(options.displacement / displacement, 0.5, 2.0) : 2.0;
  return std::llround(std::clamp(factor * static_cast<double>(duration_us),
                                 static_cast<double>(options.min_duration_us),
                                 static_cast<double>(options.max_duration_us)));
}

}  // namespace emseg
