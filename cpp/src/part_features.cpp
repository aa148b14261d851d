#include "emseg/part_features.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "event_positions.hpp"

namespace emseg {
namespace {

bool is_finite(Vec2f place) { return std::isfinite(place.x) && std::isfinite(place.y); }

[[noreturn]] void throw_off_sensor(std::size_t event) {
  throw std::invalid_argument("event " + std::to_string(event) + " is outside the sensor");
}

// The smallest index whose counts, with those before it, are more than `rank`.
int index_of_rank(std::span<const std::int32_t> counts, std::int64_t rank) {
  std::int64_t seen = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    seen += counts[i];
    if (seen > rank) return static_cast<int>(i);
  }
  return static_cast<int>(counts.size()) - 1;
}

// What `outermost` of the events, and no more, lie below and above of in a column of coordinates, which are
// less than `side`.
std::array<double, 2> outer_pixels(const EventView& events, std::span<const std::uint16_t> column,
                                   std::span<const std::int64_t> own, int side, std::int64_t outermost) {
  std::vector<std::int32_t> counts(static_cast<std::size_t>(side), 0);
  for (const std::int64_t position : own) {
    const std::size_t k = event_at(position, events);
    if (column[k] >= side) throw_off_sensor(k);
    ++counts[column[k]];
  }
  const auto last = static_cast<std::int64_t>(own.size()) - 1;
  return {double(index_of_rank(counts, outermost)), double(index_of_rank(counts, last - outermost))};
}

// Order statistics of one coordinate of places, without sorting more than the few that matter: values are
// counted in buckets of one width, and only those of the buckets in question are looked at.
class Coordinate {
 public:
  Coordinate(std::span<const Vec2f> places, float Vec2f::* member) {
    values_.reserve(places.size());
    float most = -std::numeric_limits<float>::infinity();
    for (const Vec2f place : places) {
      if (!is_finite(place)) continue;
      values_.push_back(place.*member);
      least_ = std::min(least_, values_.back());
      most = std::max(most, values_.back());
    }
    per_px_ = most > least_ ? (buckets - 1) / (double{most} - double{least_}) : 0;
    bucket_.resize(values_.size());
    for (std::size_t k = 0; k < values_.size(); ++k) bucket_[k] = bucket_of(values_[k]);
    for (const std::uint16_t bucket : bucket_) ++counts_[bucket];
  }

  std::size_t count() const { return values_.size(); }

  // The value that is `share` of the way from the least to the largest, between two by interpolation.
  double quantile(double share) const {
    const double rank = share * static_cast<double>(count() - 1);
    const auto below = static_cast<std::size_t>(rank);
    const auto [first, second] = values_at(below, std::min(below + 1, count() - 1));
    return first + (rank - static_cast<double>(below)) * (second - first);
  }

 private:
  static constexpr std::size_t buckets = 1024;

  // Rises with the value, so that ranks follow the buckets.
  std::uint16_t bucket_of(float value) const {
    return static_cast<std::uint16_t>((double{value} - double{least_}) * per_px_);
  }

  // The values of a rank and of the same or the next one.
  std::pair<double, double> values_at(std::size_t rank, std::size_t next) const {
    std::size_t first = 0, before = 0;  // bucket of the rank, and how many lie in those before it
    while (before + counts_[first] <= rank) before += counts_[first++];
    std::size_t last = first, until = before + counts_[first];
    while (until <= next) until += counts_[++last];
    std::vector<float> values;
    values.reserve(until - before);
    for (std::size_t k = 0; k < values_.size(); ++k) {
      if (bucket_[k] >= first && bucket_[k] <= last) values.push_back(values_[k]);
    }
    const auto at = [&](std::size_t k) {
      const auto found = values.begin() + static_cast<std::ptrdiff_t>(k - before);
      std::nth_element(values.begin(), found, values.end());
      return double{*found};
    };
    return {at(rank), at(next)};
  }

  std::vector<float> values_;          // the finite ones
  std::vector<std::uint16_t> bucket_;  // of each
  float least_ = std::numeric_limits<float>::infinity();
  double per_px_ = 0;
  std::array<std::size_t, buckets> counts_{};
};

// The events of a sample of at most `most`, evenly spread from the first to the last.
std::vector<std::size_t> spread_sample(const EventView& events, std::span<const std::int64_t> own,
                                       std::size_t most) {
  const std::size_t n = std::min(own.size(), most);
  std::vector<std::size_t> sample(n);
  const double step = n > 1 ? static_cast<double>(own.size() - 1) / static_cast<double>(n - 1) : 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = i + 1 == n ? own.size() - 1 : static_cast<std::size_t>(double(i) * step);
    sample[i] = event_at(own[from], events);
  }
  return sample;
}

}  // namespace

TileGrid tiles_of(ImageSize sensor, int side) {
  if (side < 1) {
    throw std::invalid_argument("tiles are " + std::to_string(side) + " px wide, expected 1 or more");
  }
  return {(sensor.width + side - 1) / side, (sensor.height + side - 1) / side, side};
}

std::vector<std::int32_t> winners_of_tiles(const EventView& events,
                                           std::span<const std::span<const std::int64_t>> groups,
                                           const TileGrid& tiles) {
  constexpr std::int32_t few = 2;
  std::vector<std::int32_t> winners(tiles.size(), -1), most(tiles.size(), few), counts(tiles.size());
  for (std::size_t g = 0; g < groups.size(); ++g) {
    std::fill(counts.begin(), counts.end(), 0);
    for (const std::int64_t own : groups[g]) {
      const std::size_t k = event_at(own, events);
      const int column = events.x[k] / tiles.side, row = events.y[k] / tiles.side;
      if (column >= tiles.columns || row >= tiles.rows) throw_off_sensor(k);
      ++counts[static_cast<std::size_t>(row * tiles.columns + column)];
    }
    for (std::size_t tile = 0; tile < tiles.size(); ++tile) {
      if (counts[tile] <= most[tile]) continue;
      most[tile] = counts[tile];
      winners[tile] = static_cast<std::int32_t>(g);
    }
  }
  return winners;
}

double spread_of_tiles(std::span<const std::uint8_t> held, int columns) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (std::size_t tile = 0; tile < held.size(); ++tile) {
    if (!held[tile]) continue;
    const auto column = static_cast<double>(tile % static_cast<std::size_t>(columns));
    const auto row = static_cast<double>(tile / static_cast<std::size_t>(columns));
    n += 1;
    x += column;
    y += row;
    xx += column * column;
    xy += column * row;
    yy += row * row;
  }
  if (n == 0) return 0;
  // Sums of whole numbers are exact.  1/12: the variance of a tile within itself.
  const double var_x = (n * xx - x * x) / (n * n) + 1.0 / 12;
  const double var_y = (n * yy - y * y) / (n * n) + 1.0 / 12;
  const double cov = (n * xy - x * y) / (n * n);
  return std::sqrt(std::max(0.0, var_x * var_y - cov * cov)) * 12 / static_cast<double>(held.size());
}

Box inner_box(const EventView& events, std::span<const std::int64_t> own, ImageSize sensor) {
  if (own.empty()) throw std::invalid_argument("a part has no events, expected one at least");
  const auto outermost = static_cast<std::int64_t>(own.size() / 50);
  const auto [left, right] = outer_pixels(events, events.x, own, sensor.width, outermost);
  const auto [top, bottom] = outer_pixels(events, events.y, own, sensor.height, outermost);
  return {left, top, right, bottom};
}

Box outer_box(std::span<const Vec2f> places) {
  constexpr double outermost = 0.01;
  const Coordinate x(places, &Vec2f::x), y(places, &Vec2f::y);
  if (x.count() == 0) return {};
  return {x.quantile(outermost), y.quantile(outermost), x.quantile(1 - outermost), y.quantile(1 - outermost)};
}

double share_gone(const EventView& events, std::span<const std::int64_t> own, Vec2d along) {
  constexpr double told = 5;          // px from which on going can be told from staying
  constexpr std::size_t enough = 10;  // events of either third
  constexpr std::size_t most = 1500;  // that are looked at
  constexpr double unknown = 0.5;
  const double length = std::hypot(along.x, along.y);
  if (length < told || own.size() < 3 * enough) return unknown;
  const std::vector<std::size_t> sample = spread_sample(events, own, most);
  const std::int64_t first = events.t[sample.front()];
  const double whole = seconds_between(first, events.t[sample.back()]);
  std::vector<double> early, late;
  for (const std::size_t k : sample) {
    const double place = (events.x[k] * along.x + events.y[k] * along.y) / length;
    const double since = seconds_between(first, events.t[k]);
    if (since < whole / 3) early.push_back(place);
    if (since > whole - whole / 3) late.push_back(place);
  }
  if (std::min(early.size(), late.size()) < enough) return unknown;
  std::sort(early.begin(), early.end());
  std::sort(late.begin(), late.end());
  constexpr std::array ranks{0.1, 0.5, 0.9};
  double gone = 0;
  for (const double rank : ranks) {
    const auto at = [&](const std::vector<double>& places) {
      return places[static_cast<std::size_t>(rank * static_cast<double>(places.size() - 1))];
    };
    gone += at(late) - at(early);
  }
  return std::clamp(gone / ranks.size() / (length * 2 / 3), -0.5, 1.5);
}

double events_beyond(const EventView& events, std::span<const std::int64_t> own, Vec2d along,
                     ImageSize sensor) {
  constexpr std::size_t most = 4000;           // that are looked at
  constexpr std::array shares{1.3, 1.6, 2.0};  // of the displacement
  constexpr double gap = 2.5;                  // px further
  constexpr int farthest_aside = 3;            // px
  const double length = std::hypot(along.x, along.y);
  if (own.empty() || !(length > 0)) return 0;
  if (events.p.size() != events.size()) throw std::invalid_argument("events have no polarities");
  const std::vector<std::size_t> sample = spread_sample(events, own, most);
  const std::int32_t width = sensor.width, height = sensor.height, off_sensor = width * height;
  std::vector<std::int32_t> sums(static_cast<std::size_t>(off_sensor) + 1, 0);  // off the sensor none is met
  std::vector<std::int32_t> x, y, sign;
  for (const std::size_t k : sample) {
    if (events.x[k] >= width || events.y[k] >= height) throw_off_sensor(k);
    x.push_back(events.x[k]);
    y.push_back(events.y[k]);
    sign.push_back(events.p[k] > 0 ? 1 : -1);
    sums[static_cast<std::size_t>(y.back() * width + x.back())] += sign.back();
  }
  // Events lie on whole pixels, so that the nearest pixel is equally far from all.
  const auto whole = [&](double px) {
    const double farthest = std::max(width, height);
    return static_cast<std::int32_t>(std::nearbyint(std::clamp(px, -farthest, farthest)));
  };
  const auto sum_met = [&](std::int32_t dx, std::int32_t dy) {
    std::int64_t sum = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const std::int32_t column = x[i] + dx, row = y[i] + dy;
      const bool inside = column >= 0 && column < width && row >= 0 && row < height;
      sum += sign[i] * sums[static_cast<std::size_t>(inside ? row * width + column : off_sensor)];
    }
    return sum;
  };
  const Vec2d ahead{along.x / length, along.y / length};
  double met = 0;
  for (const double way : {-1.0, 1.0}) {
    for (const double share : shares) {
      const double lag = way * (share * length + gap);
      std::int64_t fullest = std::numeric_limits<std::int64_t>::min();
      for (int aside = -farthest_aside; aside <= farthest_aside; ++aside) {
        fullest = std::max(
            fullest, sum_met(whole(lag * ahead.x - aside * ahead.y), whole(lag * ahead.y + aside * ahead.x)));
      }
      met += static_cast<double>(fullest) / static_cast<double>(sample.size());
    }
  }
  return met / (2 * shares.size());
}

}  // namespace emseg
