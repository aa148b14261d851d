#include "emseg/velocity_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace emseg {
namespace {

constexpr int tile_cells = 8;  // cells along a tile's side
constexpr int cells_per_tile = tile_cells * tile_cells;

// No more events than a 16-bit cell can count, should they all fall into one.
constexpr std::size_t most_votes = 65535;

// Sums of one velocity over a tile and one polarity.
struct TileVotes {
  std::uint32_t votes = 0;
  std::uint32_t pairs = 0;  // of votes in one cell: sum I (I - 1) / 2
};

// Events of a slice of the window's middle, thinned evenly, in units of cells.
struct Slice {
  std::vector<float> u, v, dt;
  std::vector<std::uint32_t> first_cell;  // of the plane of its polarity
};

// The image plane in cells, kept tile by tile: first all tiles of one polarity, then of the other, then one
// for what leaves the image.
class TileGrid {
 public:
  TileGrid(Region plane, double cell) : plane_(plane), cell_(cell) {
    columns_ = static_cast<int>(std::ceil(plane.width / tile()));
    rows_ = static_cast<int>(std::ceil(plane.height / tile()));
  }

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  double tile() const { return tile_cells * cell_; }
  int tile_count() const { return columns_ * rows_; }

  // A worker's memory; cells are zero between scorings.
  struct Workspace {
    std::vector<std::uint16_t> cells;
    std::vector<std::uint32_t> cell_of_event;
    std::vector<TileVotes> tiles;
    std::vector<double> excess, votes;  // summed-area tables, a row and a column of zeros first
  };

  Slice cut_slice(const PointView& points, std::span<const std::uint8_t> positive, double duration,
                  std::size_t max_events) const {
    const auto half = static_cast<float>(0.5 * duration);
    const float middle = 0.5f * (points.dt.front() + points.dt.back());
    const auto first = static_cast<std::size_t>(
        std::lower_bound(points.dt.begin(), points.dt.end(), middle - half) - points.dt.begin());
    const auto last = static_cast<std::size_t>(
        std::upper_bound(points.dt.begin(), points.dt.end(), middle + half) - points.dt.begin());
    const std::size_t count = last - first;
    const std::size_t kept = std::min({count, max_events, most_votes});
    const auto inverse_cell = static_cast<float>(1 / cell_);
    // Pixels, being whole numbers, lie half a pixel inside their cells.
    const float x0 = static_cast<float>(plane_.x0) - 0.5f, y0 = static_cast<float>(plane_.y0) - 0.5f;
    Slice slice;
    for (std::size_t i = 0; i < kept; ++i) {
      const std::size_t k = first + i * count / kept;
      slice.u.push_back((points.x[k] - x0) * inverse_cell);
      slice.v.push_back((points.y[k] - y0) * inverse_cell);
      slice.dt.push_back(points.dt[k] - middle);
      slice.first_cell.push_back(positive[k] ? static_cast<std::uint32_t>(tile_count() * cells_per_tile) : 0);
    }
    return slice;
  }

  // Fills the workspace's tables with one velocity's (px/s) votes that coincide beyond chance, and all votes.
  void score(const Slice& slice, double vx, double vy, Workspace& workspace) const {
    const std::size_t n = slice.u.size();
    workspace.cells.resize(static_cast<std::size_t>(2 * tile_count() + 1) * cells_per_tile, 0);
    workspace.cell_of_event.resize(n);
    workspace.tiles.assign(static_cast<std::size_t>(2 * tile_count() + 1), {});
    const auto su = static_cast<float>(vx / cell_), sv = static_cast<float>(vy / cell_);
    const auto width = static_cast<float>(columns_ * tile_cells);
    const auto height = static_cast<float>(rows_ * tile_cells);
    const auto outside = static_cast<std::uint32_t>(2 * tile_count() * cells_per_tile);
    const auto columns = static_cast<std::uint32_t>(columns_);
    const std::uint32_t* const first_cell = slice.first_cell.data();
    const float *slice_u = slice.u.data(), *slice_v = slice.v.data(), *slice_dt = slice.dt.data();
    std::uint32_t* const cell_of_event = workspace.cell_of_event.data();
    for (std::size_t k = 0; k < n; ++k) {
      const float u = slice_u[k] - slice_dt[k] * su;
      const float v = slice_v[k] - slice_dt[k] * sv;
      const bool inside = u >= 0 && v >= 0 && u < width && v < height;
      // Through signed integers, which the processor converts to; unsigned ones divide by shifts.
      const auto column = static_cast<std::uint32_t>(static_cast<std::int32_t>(inside ? u : 0));
      const auto row = static_cast<std::uint32_t>(static_cast<std::int32_t>(inside ? v : 0));
      const std::uint32_t tile = row / tile_cells * columns + column / tile_cells;
      const std::uint32_t cell =
          tile * cells_per_tile + row % tile_cells * tile_cells + column % tile_cells;
      cell_of_event[k] = inside ? cell + first_cell[k] : outside;
    }
    std::uint16_t* const cells = workspace.cells.data();
    TileVotes* const tiles = workspace.tiles.data();
    for (std::size_t k = 0; k < n; ++k) {
      const std::uint32_t cell = cell_of_event[k];
      TileVotes& tile = tiles[cell / cells_per_tile];
      tile.pairs += cells[cell]++;
      ++tile.votes;
    }
    for (std::size_t k = 0; k < n; ++k) cells[cell_of_event[k]] = 0;  // fewer than there are cells
    integrate(workspace);
  }

 private:
  void integrate(Workspace& workspace) const {
    const auto stride = static_cast<std::size_t>(columns_ + 1);
    workspace.excess.resize(stride * static_cast<std::size_t>(rows_ + 1));
    workspace.votes.resize(workspace.excess.size());
    std::fill_n(workspace.excess.begin(), stride, 0.0);
    std::fill_n(workspace.votes.begin(), stride, 0.0);
    const TileVotes* negative = workspace.tiles.data();
    const TileVotes* positive = negative + tile_count();
    for (int row = 0; row < rows_; ++row) {
      double excess = 0, votes = 0;  // of the row so far
      const std::size_t first = static_cast<std::size_t>(row + 1) * stride;
      workspace.excess[first] = workspace.votes[first] = 0;
      for (int column = 0; column < columns_; ++column, ++negative, ++positive) {
        // sum I(I-1) less its expectation M^2/A for votes scattered at random
        const double m = negative->votes, p = positive->votes;
        excess += 2.0 * negative->pairs + 2.0 * positive->pairs - (m * m + p * p) * (1.0 / cells_per_tile);
        votes += m + p;
        const std::size_t at = first + static_cast<std::size_t>(column) + 1;
        workspace.excess[at] = workspace.excess[at - stride] + excess;
        workspace.votes[at] = workspace.votes[at - stride] + votes;
      }
    }
  }

  Region plane_;
  double cell_;
  int columns_ = 0, rows_ = 0;
};

// Doublings at the most: times, as floats, are not told apart over more, and velocities in steps still fit an
// int. Windows this long end with a slice of their middle.
constexpr int most_levels = 24;

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

  const TileGrid grid(plane, options.cell);
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

  std::vector<TileGrid::Workspace> workspaces(static_cast<std::size_t>(pool.worker_count()));
  for (int level = 0;; ++level, duration *= 2) {
    const Slice slice = grid.cut_slice(points, positive, duration, options.max_events);
    const double step = options.step / duration;  // px/s
    // score[velocity][region]
    std::vector<std::vector<float>> score(trial.size(), std::vector<float>(regions.size()));
    pool.for_each(trial.size(), [&](std::size_t v, int worker) {
      auto& workspace = workspaces[static_cast<std::size_t>(worker)];
      grid.score(slice, trial[v].i * step, trial[v].j * step, workspace);
      for (std::size_t r = 0; r < rects.size(); ++r) {
        const double votes = sum_over(workspace.votes, grid.columns(), rects[r]);
        score[v][r] = static_cast<float>(sum_over(workspace.excess, grid.columns(), rects[r]) / (votes + 16));
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
