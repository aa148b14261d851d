#include "emseg/velocity_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace emseg {
namespace {

// Events of a slice, thinned evenly.
struct Slice {
  std::vector<float> x, y, dt;
  std::vector<std::uint8_t> positive;
  double duration = 0;  // s
};

// No more events than a 16-bit cell can count, should they all fall into one.
constexpr std::size_t most_votes = 65535;

Slice cut_slice(const PointView& points, std::span<const std::uint8_t> positive, double duration,
                std::size_t max_events) {
  const auto half = static_cast<float>(0.5 * duration);
  const float middle = 0.5f * (points.dt.front() + points.dt.back());
  const auto first = static_cast<std::size_t>(
      std::lower_bound(points.dt.begin(), points.dt.end(), middle - half) - points.dt.begin());
  const auto last = static_cast<std::size_t>(
      std::upper_bound(points.dt.begin(), points.dt.end(), middle + half) - points.dt.begin());
  const std::size_t count = last - first;
  const std::size_t kept = std::min({count, max_events, most_votes});
  Slice slice;
  slice.duration = duration;
  for (std::size_t i = 0; i < kept; ++i) {
    const std::size_t k = first + i * count / kept;
    slice.x.push_back(points.x[k]);
    slice.y.push_back(points.y[k]);
    slice.dt.push_back(points.dt[k] - middle);
    slice.positive.push_back(positive[k]);
  }
  return slice;
}

// Scores of one velocity: per tile, coinciding votes beyond chance and votes.
struct TileScores {
  std::vector<float> excess;
  std::vector<float> mass;
};

class TileGrid {
 public:
  TileGrid(Region plane, const SweepOptions& options)
      : plane_(plane),
        cell_(options.cell),
        cells_per_tile_(std::max(1, static_cast<int>(std::lround(options.tile / options.cell)))) {
    const double tile = cells_per_tile_ * cell_;
    columns_ = static_cast<int>(std::ceil(plane.width / tile));
    rows_ = static_cast<int>(std::ceil(plane.height / tile));
    tile_ = tile;
  }

  std::size_t tile_count() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  double tile() const { return tile_; }

  // Two planes of cells, one for each polarity, and one spare cell for what leaves the image.
  std::size_t cell_count() const { return 2 * plane_cells() + 1; }

  void score(const Slice& slice, double vx, double vy, std::vector<std::uint16_t>& cells,
             TileScores& scores) const {
    std::fill(cells.begin(), cells.end(), std::uint16_t{0});
    const auto inverse_cell = static_cast<float>(1 / cell_);
    const auto sx = static_cast<float>(vx / cell_), sy = static_cast<float>(vy / cell_);
    // Pixels, being whole numbers, lie half a pixel inside their cells.
    const float x0 = static_cast<float>(plane_.x0) - 0.5f, y0 = static_cast<float>(plane_.y0) - 0.5f;
    const int width = columns_ * cells_per_tile_;
    const int height = rows_ * cells_per_tile_;
    const auto outside = static_cast<int>(2 * plane_cells());
    const int plane_size = static_cast<int>(plane_cells());
    for (std::size_t k = 0; k < slice.x.size(); ++k) {
      const float u = (slice.x[k] - x0) * inverse_cell - slice.dt[k] * sx;
      const float v = (slice.y[k] - y0) * inverse_cell - slice.dt[k] * sy;
      const bool inside = u >= 0 && v >= 0 && u < static_cast<float>(width) && v < static_cast<float>(height);
      const int index =
          inside ? static_cast<int>(v) * width + static_cast<int>(u) + (slice.positive[k] ? plane_size : 0)
                 : outside;
      ++cells[static_cast<std::size_t>(index)];
    }
    scores.excess.assign(tile_count(), 0);
    scores.mass.assign(tile_count(), 0);
    const float inverse_area = 1.0f / static_cast<float>(cells_per_tile_ * cells_per_tile_);
    for (int polarity = 0; polarity < 2; ++polarity) {
      const std::uint16_t* cell_plane = cells.data() + (polarity ? plane_cells() : 0);
      for (int row = 0; row < rows_; ++row) {
        for (int column = 0; column < columns_; ++column) {
          std::uint32_t mass = 0;
          std::uint64_t square = 0;
          for (int j = 0; j < cells_per_tile_; ++j) {
            const std::uint16_t* line =
                cell_plane + (row * cells_per_tile_ + j) * width + column * cells_per_tile_;
            std::uint32_t line_square = 0;
            for (int i = 0; i < cells_per_tile_; ++i) {
              mass += line[i];
              line_square += static_cast<std::uint32_t>(line[i]) * line[i];
            }
            square += line_square;
          }
          const auto tile = static_cast<std::size_t>(row * columns_ + column);
          const auto m = static_cast<float>(mass);
          // sum I(I-1) less its expectation M^2/A for votes scattered at random
          scores.excess[tile] += static_cast<float>(square) - m - m * m * inverse_area;
          scores.mass[tile] += m;
        }
      }
    }
  }

 private:
  std::size_t plane_cells() const {
    return tile_count() * static_cast<std::size_t>(cells_per_tile_) *
           static_cast<std::size_t>(cells_per_tile_);
  }

  Region plane_;
  double cell_;
  int cells_per_tile_;
  double tile_ = 0;
  int columns_ = 0, rows_ = 0;
};

// Doublings at the most: times, as floats, are not told apart over more, and velocities in steps still fit an
// int. Windows this long end with a slice of their middle.
constexpr int most_levels = 24;

// Summed-area table of tile values.
std::vector<double> integrate(const std::vector<float>& values, int columns, int rows) {
  std::vector<double> sums(static_cast<std::size_t>((columns + 1) * (rows + 1)), 0.0);
  for (int row = 0; row < rows; ++row) {
    double line = 0;
    for (int column = 0; column < columns; ++column) {
      line += values[static_cast<std::size_t>(row * columns + column)];
      sums[static_cast<std::size_t>((row + 1) * (columns + 1) + column + 1)] =
          sums[static_cast<std::size_t>(row * (columns + 1) + column + 1)] + line;
    }
  }
  return sums;
}

struct TileRect {
  int left, top, right, bottom;  // half-open, in tiles
};

double sum_over(const std::vector<double>& table, int columns, const TileRect& r) {
  const auto at = [&](int column, int row) {
    return table[static_cast<std::size_t>(row * (columns + 1) + column)];
  };
  return at(r.right, r.bottom) - at(r.left, r.bottom) - at(r.right, r.top) + at(r.left, r.top);
}

struct GridVelocity {
  int i = 0, j = 0;  // in steps of the level
  friend auto operator<=>(const GridVelocity&, const GridVelocity&) = default;
};

}  // namespace

std::vector<std::vector<VelocityScore>> sweep_velocities(const PointView& points,
                                                         std::span<const std::uint8_t> positive,
                                                         std::span<const Region> regions, Region plane,
                                                         const SweepOptions& options, ThreadPool& pool) {
  std::vector<std::vector<VelocityScore>> best(regions.size());
  if (points.size() < 2) return best;
  const double window = static_cast<double>(points.dt.back()) - points.dt.front();
  if (!(window > 0)) return best;

  const TileGrid grid(plane, options);
  std::vector<TileRect> rects;
  for (const Region& region : regions) {
    const auto tile_of = [&](int pixel, int last) {
      return std::clamp(static_cast<int>(std::lround(pixel / grid.tile())), 0, last);
    };
    const int left = region.x0 - plane.x0;
    const int top = region.y0 - plane.y0;
    TileRect rect{tile_of(left, grid.columns() - 1), tile_of(top, grid.rows() - 1),
                  tile_of(left + region.width, grid.columns()), tile_of(top + region.height, grid.rows())};
    rect.right = std::max(rect.right, rect.left + 1);
    rect.bottom = std::max(rect.bottom, rect.top + 1);
    rects.push_back(rect);
  }

  // The slice doubles until it is the window; the velocity step is `step` px over the slice of its level.
  int levels = 0;
  double duration = window;
  while (duration * options.max_speed > 1.5 * options.first_reach) {
    duration *= 0.5;
    ++levels;
  }
  levels = std::min(levels, most_levels);
  std::vector<GridVelocity> trial;
  {
    const double reach = options.max_speed * duration / options.step;
    const int steps = static_cast<int>(std::floor(reach));
    for (int j = -steps; j <= steps; ++j) {
      for (int i = -steps; i <= steps; ++i) {
        if (i * i + j * j <= reach * reach) trial.push_back({i, j});
      }
    }
  }

  std::vector<std::vector<std::uint16_t>> cells(static_cast<std::size_t>(pool.worker_count()),
                                                std::vector<std::uint16_t>(grid.cell_count()));
  std::vector<TileScores> scratch(static_cast<std::size_t>(pool.worker_count()));
  for (int level = 0;; ++level, duration *= 2) {
    const Slice slice = cut_slice(points, positive, duration, options.max_events);
    const double step = options.step / duration;  // px/s
    // score[velocity][region]
    std::vector<std::vector<float>> score(trial.size(), std::vector<float>(regions.size()));
    pool.for_each(trial.size(), [&](std::size_t v, int worker) {
      auto& tiles = scratch[static_cast<std::size_t>(worker)];
      grid.score(slice, trial[v].i * step, trial[v].j * step, cells[static_cast<std::size_t>(worker)], tiles);
      const auto excess = integrate(tiles.excess, grid.columns(), grid.rows());
      const auto mass = integrate(tiles.mass, grid.columns(), grid.rows());
      for (std::size_t r = 0; r < rects.size(); ++r) {
        const double events = sum_over(mass, grid.columns(), rects[r]);
        score[v][r] = static_cast<float>(sum_over(excess, grid.columns(), rects[r]) / (events + 16));
      }
    });

    // Per region the best velocities, no two of them neighbours on the grid.
    const bool last = level == levels;
    std::map<GridVelocity, double> branches;  // with the support of the regions that chose them
    for (std::size_t r = 0; r < regions.size(); ++r) {
      std::vector<std::size_t> order(trial.size());
      for (std::size_t v = 0; v < trial.size(); ++v) order[v] = v;
      const std::size_t wanted = std::min<std::size_t>(order.size(), 9 * options.per_region);
      std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(wanted), order.end(),
                        [&](std::size_t a, std::size_t b) {
                          return score[a][r] != score[b][r] ? score[a][r] > score[b][r] : trial[a] < trial[b];
                        });
      std::vector<std::size_t> kept;
      for (std::size_t o = 0; o < wanted && kept.size() < options.per_region; ++o) {
        const GridVelocity& v = trial[order[o]];
        if (score[order[o]][r] <= 0) break;
        const bool apart = std::all_of(kept.begin(), kept.end(), [&](std::size_t other) {
          return std::abs(trial[other].i - v.i) > 1 || std::abs(trial[other].j - v.j) > 1;
        });
        if (apart) kept.push_back(order[o]);
      }
      if (last) {
        for (const std::size_t v : kept) {
          best[r].push_back({trial[v].i * step, trial[v].j * step, static_cast<double>(score[v][r])});
        }
      }
      for (std::size_t rank = 0; rank < kept.size(); ++rank) {
        branches[trial[kept[rank]]] += score[kept[rank]][r] / static_cast<double>(1 + rank);
      }
    }
    if (last) return best;

    std::vector<std::pair<double, GridVelocity>> ranked;
    for (const auto& [velocity, support] : branches) ranked.push_back({support, velocity});
    std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
      return a.first != b.first ? a.first > b.first : a.second < b.second;
    });
    if (ranked.size() > options.max_branches) ranked.resize(options.max_branches);
    // The next level's step over its doubled slice is the same in px, hence half in px/s.
    std::map<GridVelocity, bool> next;
    for (const auto& [support, v] : ranked) {
      for (int dj = -1; dj <= 1; ++dj) {
        for (int di = -1; di <= 1; ++di) next[{2 * v.i + di, 2 * v.j + dj}] = true;
      }
    }
    if (ranked.empty()) {  // nothing coincides in this slice, if it has any events: the next one is asked the
                           // same
      for (const GridVelocity& v : trial) next[{2 * v.i, 2 * v.j}] = true;
    }
    trial.clear();
    for (const auto& [velocity, unused] : next) trial.push_back(velocity);
  }
}

}  // namespace emseg
