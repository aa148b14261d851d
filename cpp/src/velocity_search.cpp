#include "velocity_search.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "displacements.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {
namespace {

constexpr int reach = patch_reach;          // px that a displacement is looked for, either way
constexpr std::size_t most_events = 8000;   // that may look for partners at each lag
constexpr int slices_per_lag = 8;           // a motion of `reach` px a lag smears a slice over two pixels
constexpr std::uint16_t most_at_pixel = 8;  // more do not count: a hot pixel is not a motion
constexpr double least_significance = 6;    // the largest by chance, among all displacements, is about 4
constexpr std::size_t most_velocities = 4;  // of each lag
static_assert(most_events * most_at_pixel <= 65535);

class PairSearch {
 public:
  PairSearch(const PointView& points, std::span<const std::uint8_t> positive, Region plane,
             std::size_t max_events)
      : points_(points),
        positive_(positive),
        max_events_(std::min(max_events, most_events)),
        padded_(expanded(plane, margin, margin)),
        pixels_(padded_.area()) {}

  // Displacements between events `lag` apart beyond those of a velocity.
  const Displacements<std::uint16_t>& displacements(double lag, double vx, double vy) {
    counts_.fill(0);
    const double first = points_.dt.front(), window = points_.dt.back() - first;
    const double slice = lag / slices_per_lag;
    const auto slices = static_cast<std::size_t>(std::max(1.0, std::ceil((window - lag) / slice)));
    // Slices spread over the window, as many as the budget of events allows.
    const double share = (window - lag) / window;
    const double expected =
        std::max(1.0, static_cast<double>(points_.size()) * share / static_cast<double>(slices));
    const auto used = std::clamp<std::size_t>(
        static_cast<std::size_t>(static_cast<double>(max_events_) / expected), 1, slices);
    std::size_t budget = max_events_;
    for (std::size_t s = 0; s < used && budget > 0; ++s) {
      const double start = first + static_cast<double>((2 * s + 1) * slices / (2 * used)) * slice;
      const auto [a, a_end] = between(start, start + slice);
      const auto [b, b_end] = between(start + lag, start + lag + slice);
      if (a == a_end || b == b_end) continue;
      const double middle = start + 0.5 * slice;
      for (const bool polarity : {false, true}) {
        moved(b, b_end, polarity, vx, vy, middle, later_);
        for (const std::int32_t at : later_) {
          auto& count = pixels_[static_cast<std::size_t>(at)];
          count = std::min<std::uint16_t>(most_at_pixel, static_cast<std::uint16_t>(count + 1));
        }
        moved(a, a_end, polarity, vx, vy, middle, earlier_);
        if (earlier_.size() > budget) earlier_.resize(budget);
        budget -= earlier_.size();
        for (std::int32_t& at : earlier_) at -= reach * padded_.width + reach;  // where its patch begins
        kernels().add_patches(pixels_.data(), padded_.width, earlier_.data(), earlier_.size(),
                              counts_.data());
        for (const std::int32_t at : later_) pixels_[static_cast<std::size_t>(at)] = 0;
      }
    }
    return counts_;
  }

 private:
  // Around the plane: patches reach out of it, and a velocity may have moved places by as much.
  static constexpr int margin = 2 * reach + 2;

  std::pair<std::size_t, std::size_t> between(double begin, double end) const {
    const auto at = [&](double time) {
      return static_cast<std::size_t>(
          std::lower_bound(points_.dt.begin(), points_.dt.end(), static_cast<float>(time)) -
          points_.dt.begin());
    };
    return {at(begin), at(end)};
  }

  // Pixels of events first .. last - 1 of one polarity, moved to `time` by the velocity.
  void moved(std::size_t first, std::size_t last, bool polarity, double vx, double vy, double time,
             std::vector<std::int32_t>& pixels) const {
    pixels.clear();
    const auto u = static_cast<float>(vx), v = static_cast<float>(vy), t = static_cast<float>(time);
    const float low = reach;
    const auto right = static_cast<float>(padded_.width - reach - 1),
               bottom = static_cast<float>(padded_.height - reach);
    const auto x0 = static_cast<float>(padded_.x0), y0 = static_cast<float>(padded_.y0);
    for (std::size_t k = first; k < last; ++k) {
      if ((positive_[k] != 0) != polarity) continue;
      const float x = points_.x[k] - (points_.dt[k] - t) * u - x0 + 0.5f;
      const float y = points_.y[k] - (points_.dt[k] - t) * v - y0 + 0.5f;
      if (!(x >= low && x < right && y >= low && y < bottom)) continue;
      pixels.push_back(static_cast<std::int32_t>(y) * padded_.width + static_cast<std::int32_t>(x));
    }
  }

  const PointView& points_;
  std::span<const std::uint8_t> positive_;
  std::size_t max_events_;
  Region padded_;
  std::vector<std::uint16_t> pixels_;
  std::vector<std::int32_t> earlier_, later_;
  alignas(64) Displacements<std::uint16_t> counts_{};  // a row of it is a cache line
};

}  // namespace

std::vector<FoundVelocity> find_velocities(const PointView& points, std::span<const std::uint8_t> positive,
                                           Region plane, double max_speed, std::size_t max_events) {
  std::vector<FoundVelocity> found;
  if (points.size() < 2) return found;
  const double window = points.seconds();
  if (!(window > 0)) return found;
  std::vector<double> lags{window / 2};
  constexpr std::size_t most_lags = 16;
  while (lags.back() * max_speed > reach && lags.size() < most_lags) lags.push_back(lags.back() / 3);

  PairSearch search(points, positive, plane, max_events);
  for (std::size_t j = 0; j < lags.size(); ++j) {
    const int limit = static_cast<int>(std::min<double>(reach, std::ceil(max_speed * lags[j]) + 1));
    for (const DisplacementPeak& peak :
         peaks_of(search.displacements(lags[j], 0, 0), limit, most_velocities, least_significance)) {
      // The next longer lag has seen what is slower.
      if (j > 0 && 3 * std::max(std::abs(peak.dx), std::abs(peak.dy)) < reach - 2) continue;
      FoundVelocity velocity{peak.dx / lags[j], peak.dy / lags[j], peak.significance};
      for (std::size_t longer = j; longer-- > 0;) {
        // A third of a lag leaves a pixel or two to be found.
        const auto rest =
            peaks_of(search.displacements(lags[longer], velocity.vx, velocity.vy), 5, 1, least_significance);
        if (rest.empty()) break;
        velocity.vx += rest.front().dx / lags[longer];
        velocity.vy += rest.front().dy / lags[longer];
        velocity.significance = rest.front().significance;
      }
      velocity.vx = std::clamp(velocity.vx, -max_speed, max_speed);
      velocity.vy = std::clamp(velocity.vy, -max_speed, max_speed);
      found.push_back(velocity);
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const FoundVelocity& a, const FoundVelocity& b) {
    return a.significance > b.significance;
  });
  return found;
}

double count_coincidences(const PointView& points, std::span<const std::uint8_t> positive,
                          const MotionModel& model, const WarpFrame& frame, Region region,
                          std::size_t max_events) {
  constexpr float cell = 2;  // px
  const std::size_t n = std::min(points.size(), max_events);
  if (n == 0 || region.area() == 0) return 0;
  Points thinned;
  thinned.reserve(n);
  for (std::size_t i = 0; i < n; ++i) thinned.push_back(points, i * points.size() / n);
  std::vector<float> x(n), y(n);
  warp_points(thinned.view(), model, frame, x, y);
  const int columns = region.width / 2 + 1, rows = region.height / 2 + 1;
  const auto plane = static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  std::vector<std::uint16_t> cells(2 * plane);
  std::uint64_t pairs = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const float u = (x[i] - static_cast<float>(region.x0) + 0.5f) / cell;
    const float v = (y[i] - static_cast<float>(region.y0) + 0.5f) / cell;
    if (!(u >= 0 && v >= 0 && u < static_cast<float>(columns) && v < static_cast<float>(rows))) continue;
    const std::size_t at =
        static_cast<std::size_t>(v) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(u);
    pairs += cells[at + (positive[i * points.size() / n] ? plane : 0)]++;
  }
  return static_cast<double>(pairs);
}

}  // namespace emseg
