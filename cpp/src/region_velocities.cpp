#include "emseg/region_velocities.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <map>
#include <optional>

#include "displacements.hpp"
#include "emseg/aligned.hpp"
#include "emseg/sampling.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {
namespace {

constexpr int reach = patch_reach;          // px that a displacement is looked for, either way
constexpr int slices_per_lag = 8;           // a motion of `reach` px a lag smears a slice over two pixels
constexpr std::uint16_t most_at_pixel = 8;  // more do not count: a hot pixel is not a motion
constexpr std::size_t most_in_tile = 65535 / most_at_pixel;  // whose votes a 16-bit count holds
constexpr std::size_t least_events = 40;  // of a region: fewer agree on something by chance
constexpr std::size_t patch_size = static_cast<std::size_t>(patch_rows) * patch_columns;
// Around the plane: patches reach out of it, and following a velocity may have moved places by as much.
constexpr int margin = 2 * reach + 2;

struct TileRect {
  int left, top, right, bottom;  // half-open, in tiles

  auto operator<=>(const TileRect&) const = default;
};

// Votes of events for the displacements to later ones of their polarity.
class EventPairs {
 public:
  EventPairs(const PointView& points, std::span<const std::uint8_t> positive, Region plane,
             std::size_t max_events)
      : padded_(expanded(plane, margin, margin)),
        columns_((plane.width + velocity_tile - 1) / velocity_tile),
        rows_((plane.height + velocity_tile - 1) / velocity_tile),
        first_(points.dt.front()),
        window_(points.seconds()),
        events_in_tile_(tile_count(), 0) {
    for (const std::size_t k : even_sample(points.size(), max_events)) {
      const int x = std::clamp(static_cast<int>(points.x[k]) - plane.x0, 0, plane.width - 1);
      const int y = std::clamp(static_cast<int>(points.y[k]) - plane.y0, 0, plane.height - 1);
      Events& events = events_[positive[k] != 0];
      events.x.push_back(points.x[k] - static_cast<float>(padded_.x0) + 0.5f);
      events.y.push_back(points.y[k] - static_cast<float>(padded_.y0) + 0.5f);
      events.dt.push_back(points.dt[k]);
      events.tile.push_back(y / velocity_tile * columns_ + x / velocity_tile);
      ++events_in_tile_[static_cast<std::size_t>(events.tile.back())];
    }
  }

  int columns() const { return columns_; }
  int rows() const { return rows_; }
  std::size_t tile_count() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  double window() const { return window_; }

  std::size_t events_in(const TileRect& rect) const {
    std::size_t sum = 0;
    for (int row = rect.top; row < rect.bottom; ++row) {
      for (int column = rect.left; column < rect.right; ++column)
        sum += events_in_tile_[static_cast<std::size_t>(row * columns_ + column)];
    }
    return sum;
  }

  // A worker's memory; pixels are zero between calls.
  struct Workspace {
    std::vector<std::uint16_t> pixels;
    std::vector<std::int32_t> later;
  };

  // Votes of tiles, patch_size counts a tile.  Tiles without voters, which may be most, take no memory.
  class TileVotes {
   public:
    void clear(std::size_t tile_count) {
      voters_.assign(tile_count, 0);
      place_.resize(tile_count);
      pages_.clear();
      taken_ = 0;
    }

    // Null where the tile's counts may not hold one more.
    std::uint16_t* add_voter(std::size_t tile) {
      if (voters_[tile] == most_in_tile) return nullptr;
      if (voters_[tile]++ == 0) {
        if (taken_ % per_page == 0) pages_.emplace_back(per_page * patch_size, std::uint16_t{0});
        place_[tile] = taken_++;
      }
      return pages_[place_[tile] / per_page].data() + place_[tile] % per_page * patch_size;
    }

    // Null where nobody voted.
    const std::uint16_t* of(std::size_t tile) const {
      if (voters_[tile] == 0) return nullptr;
      return pages_[place_[tile] / per_page].data() + place_[tile] % per_page * patch_size;
    }

   private:
    static constexpr std::size_t per_page = 16;

    std::vector<std::uint32_t> voters_;  // per tile
    std::vector<std::size_t> place_;     // per tile with voters, in the order of their first
    std::vector<std::vector<std::uint16_t, LineAllocator<std::uint16_t>>> pages_;
    std::size_t taken_ = 0;
  };

  // Votes of every tile for displacements between events `lag` seconds apart.
  void vote(double lag, bool polarity, std::size_t budget, Workspace& w, TileVotes& votes) const {
    votes.clear(tile_count());
    const auto add_patches = kernels().add_patches;
    const auto all = static_cast<double>(events_[0].dt.size() + events_[1].dt.size());
    for_each_pair(lag, polarity, 0, 0, static_cast<double>(budget) / all, w,
                  [&](std::int32_t tile, std::int32_t patch) {
                    std::uint16_t* const counts = votes.add_voter(static_cast<std::size_t>(tile));
                    if (counts != nullptr) add_patches(w.pixels.data(), padded_.width, &patch, 1, counts);
                  });
  }

  // Votes of one rectangle of tiles, once events are moved back by a velocity.
  Displacements<std::uint32_t> vote_in(const TileRect& rect, double lag, double vx, double vy,
                                       std::size_t budget, Workspace& w) const {
    std::vector<std::uint8_t> inside(tile_count(), 0);
    for (int row = rect.top; row < rect.bottom; ++row) {
      for (int column = rect.left; column < rect.right; ++column)
        inside[static_cast<std::size_t>(row * columns_ + column)] = 1;
    }
    const auto all = static_cast<double>(events_in(rect));
    Displacements<std::uint32_t> sum{};
    std::vector<std::uint16_t> votes(patch_size);
    const auto add_patches = kernels().add_patches;
    for (const bool polarity : {false, true}) {
      std::fill(votes.begin(), votes.end(), std::uint16_t{0});
      std::size_t used = 0;
      for_each_pair(lag, polarity, vx, vy, static_cast<double>(budget) / all, w,
                    [&](std::int32_t tile, std::int32_t patch) {
                      if (!inside[static_cast<std::size_t>(tile)] || used++ >= most_in_tile) return;
                      add_patches(w.pixels.data(), padded_.width, &patch, 1, votes.data());
                    });
      for (std::size_t i = 0; i < patch_size; ++i) sum[i] += votes[i];
    }
    return sum;
  }

 private:
  // Of one polarity; x and y in the padded plane, half a pixel added, so that whole parts are pixels.
  struct Events {
    std::vector<float> x, y, dt;
    std::vector<std::int32_t> tile;

    std::size_t at(double time) const {
      return static_cast<std::size_t>(std::lower_bound(dt.begin(), dt.end(), static_cast<float>(time)) -
                                      dt.begin());
    }
  };

  // For slices of the window, about `share` of them and evenly spread, and every event of a slice:
  // use(tile, begin of its patch), with the events about `lag` later counted in w.pixels.
  template <typename Use>
  void for_each_pair(double lag, bool polarity, double vx, double vy, double share, Workspace& w,
                     const Use& use) const {
    w.pixels.resize(padded_.area(), 0);
    const Events& events = events_[polarity];
    const double slice = lag / slices_per_lag;
    const auto slices = std::max<std::int64_t>(1, std::llround(std::ceil((window_ - lag) / slice)));
    const auto used = std::clamp<std::int64_t>(
        std::llround(std::ceil(std::min(1.0, share) * static_cast<double>(slices))), 1, slices);
    const auto u = static_cast<float>(vx), v = static_cast<float>(vy);
    for (std::int64_t i = 0; i < used; ++i) {
      const double start = first_ + static_cast<double>((2 * i + 1) * slices / (2 * used)) * slice;
      const double later = start + lag;
      const auto middle = static_cast<float>(start + 0.5 * slice);
      w.later.clear();
      for (std::size_t k = events.at(later), last = events.at(later + slice); k < last; ++k) {
        const std::int32_t pixel =
            pixel_at(events.x[k] - (events.dt[k] - middle) * u, events.y[k] - (events.dt[k] - middle) * v);
        if (pixel < 0) continue;
        w.later.push_back(pixel);
        std::uint16_t& count = w.pixels[static_cast<std::size_t>(pixel)];
        count = static_cast<std::uint16_t>(count + (count < most_at_pixel));
      }
      if (w.later.empty()) continue;
      for (std::size_t k = events.at(start), last = events.at(start + slice); k < last; ++k) {
        const std::int32_t pixel =
            pixel_at(events.x[k] - (events.dt[k] - middle) * u, events.y[k] - (events.dt[k] - middle) * v);
        if (pixel >= 0) use(events.tile[k], pixel - reach * padded_.width - reach);
      }
      for (const std::int32_t pixel : w.later) w.pixels[static_cast<std::size_t>(pixel)] = 0;
    }
  }

  // -1 where the patch around it would leave the padded plane.
  std::int32_t pixel_at(float x, float y) const {
    const bool inside = x >= reach && x < static_cast<float>(padded_.width - reach - 1) && y >= reach &&
                        y < static_cast<float>(padded_.height - reach);
    return inside ? static_cast<std::int32_t>(y) * padded_.width + static_cast<std::int32_t>(x) : -1;
  }

  Region padded_;
  int columns_, rows_;
  double first_, window_;  // s
  std::array<Events, 2> events_;
  std::vector<std::uint32_t> events_in_tile_;
};

}  // namespace

std::vector<std::vector<RegionVelocity>> find_region_velocities(const PointView& points,
                                                                std::span<const std::uint8_t> positive,
                                                                std::span<const Region> regions, Region plane,
                                                                const RegionVelocityOptions& options,
                                                                ThreadPool& pool) {
  std::vector<std::vector<RegionVelocity>> found(regions.size());
  if (points.size() < 2) return found;
  const double window = points.seconds();
  if (!(window > 0)) return found;

  const EventPairs pairs(points, positive, plane, options.max_events);
  std::vector<TileRect> rects;
  for (const Region& region : regions) {
    const auto tile_of = [](int pixel, int last) {
      return std::clamp(static_cast<int>(std::lround(static_cast<double>(pixel) / velocity_tile)), 0, last);
    };
    const int left = region.x0 - plane.x0, top = region.y0 - plane.y0;
    TileRect rect{tile_of(left, pairs.columns() - 1), tile_of(top, pairs.rows() - 1),
                  tile_of(left + region.width, pairs.columns()), tile_of(top + region.height, pairs.rows())};
    rect.right = std::max(rect.right, rect.left + 1);
    rect.bottom = std::max(rect.bottom, rect.top + 1);
    rects.push_back(rect);
  }
  std::vector<double> lags{window / 2};
  while (lags.back() * options.max_speed > reach && lags.size() < options.max_lags)
    lags.push_back(lags.back() / 3);

  // Votes of every tile, for every lag and polarity.
  std::vector<EventPairs::Workspace> workspaces(static_cast<std::size_t>(pool.worker_count()));
  std::vector<EventPairs::TileVotes> votes(2 * lags.size());
  pool.for_each(votes.size(), [&](std::size_t task, int worker) {
    pairs.vote(lags[task / 2], task % 2 == 1, options.max_voters,
               workspaces[static_cast<std::size_t>(worker)], votes[task]);
  });

  // Peaks of every region, for every lag; regions of the same tiles have the same.
  std::map<TileRect, std::size_t> first_of;
  std::vector<std::size_t> distinct;
  for (std::size_t r = 0; r < rects.size(); ++r) {
    if (first_of.try_emplace(rects[r], r).second) distinct.push_back(r);
  }
  std::vector<std::vector<DisplacementPeak>> peaks(regions.size() * lags.size());
  pool.for_each(distinct.size(), [&](std::size_t d, int) {
    const std::size_t r = distinct[d];
    if (pairs.events_in(rects[r]) < least_events) return;
    const auto add_counts = kernels().add_counts;
    for (std::size_t j = 0; j < lags.size(); ++j) {
      Displacements<std::uint32_t> sum{};
      for (int row = rects[r].top; row < rects[r].bottom; ++row) {
        for (int column = rects[r].left; column < rects[r].right; ++column) {
          const auto tile = static_cast<std::size_t>(row * pairs.columns() + column);
          for (const auto* of_lag : {&votes[2 * j], &votes[2 * j + 1]}) {
            const std::uint16_t* const counts = of_lag->of(tile);
            if (counts != nullptr) add_counts(counts, patch_size, sum.data());
          }
        }
      }
      const int limit = static_cast<int>(std::min<double>(reach, std::ceil(options.max_speed * lags[j]) + 1));
      for (const DisplacementPeak& peak :
           peaks_of(sum, limit, options.per_region, options.least_significance)) {
        // The next longer lag has seen what is slower.
        if (j > 0 && 3 * std::max(std::abs(peak.dx), std::abs(peak.dy)) < reach - 2) continue;
        peaks[r * lags.size() + j].push_back(peak);
      }
    }
  });
  for (std::size_t r = 0; r < rects.size(); ++r) {
    const std::size_t first = first_of.at(rects[r]);
    for (std::size_t j = 0; first != r && j < lags.size(); ++j) {
      peaks[r * lags.size() + j] = peaks[first * lags.size() + j];
    }
  }

  // Those of short lags are followed back to the longest: one for all regions that share it.
  const auto clamped = [&](double speed) { return std::clamp(speed, -options.max_speed, options.max_speed); };
  for (std::size_t j = 0; j < lags.size(); ++j) {
    struct Found {
      std::size_t region;
      DisplacementPeak peak;
    };
    std::vector<Found> all;
    for (std::size_t r = 0; r < regions.size(); ++r) {
      for (const DisplacementPeak& peak : peaks[r * lags.size() + j]) all.push_back({r, peak});
    }
    if (j == 0) {
      for (const auto& [r, peak] : all)
        found[r].push_back({clamped(peak.dx / lags[0]), clamped(peak.dy / lags[0]), peak.significance});
      continue;
    }
    std::stable_sort(all.begin(), all.end(), [](const Found& a, const Found& b) {
      return a.peak.significance > b.peak.significance;
    });
    std::vector<Found> leaders;
    const auto leader_of = [&](const DisplacementPeak& peak) {
      return static_cast<std::size_t>(std::find_if(leaders.begin(), leaders.end(),
                                                   [&](const Found& leader) {
                                                     return std::hypot(leader.peak.dx - peak.dx,
                                                                       leader.peak.dy - peak.dy) < 1;
                                                   }) -
                                      leaders.begin());
    };
    for (const Found& one : all) {
      if (leaders.size() < options.max_followed && leader_of(one.peak) == leaders.size())
        leaders.push_back(one);
    }
    std::vector<std::optional<RegionVelocity>> followed(leaders.size());
    pool.for_each(leaders.size(), [&](std::size_t i, int worker) {
      const auto& [r, peak] = leaders[i];
      RegionVelocity velocity{peak.dx / lags[j], peak.dy / lags[j], 0};
      for (std::size_t longer = j; longer-- > 0;) {
        // A third of a lag leaves a pixel or two to be found.
        const auto rest =
            peaks_of(pairs.vote_in(rects[r], lags[longer], velocity.vx, velocity.vy, options.max_followers,
                                   workspaces[static_cast<std::size_t>(worker)]),
                     5, 1, options.least_significance);
        if (rest.empty()) return;
        velocity.vx += rest.front().dx / lags[longer];
        velocity.vy += rest.front().dy / lags[longer];
      }
      followed[i] = velocity;
    });
    for (const auto& [r, peak] : all) {
      const std::size_t leader = leader_of(peak);
      if (leader == leaders.size() || !followed[leader]) continue;
      found[r].push_back({clamped(followed[leader]->vx), clamped(followed[leader]->vy), peak.significance});
    }
  }
  for (auto& velocities : found) {
    std::stable_sort(
        velocities.begin(), velocities.end(),
        [](const RegionVelocity& a, const RegionVelocity& b) { return a.significance > b.significance; });
    if (velocities.size() > options.per_region) velocities.resize(options.per_region);
  }
  return found;
}

}  // namespace emseg
