#include "emseg/event_slices.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>

namespace emseg {

namespace {

constexpr std::uint32_t count_scale = 50;
constexpr std::uint32_t full = 255;

// What a pixel gathers; times are relative to the slice's begin.
struct PixelSums {
  std::uint32_t falls = 0;
  std::uint32_t rises = 0;
  std::uint64_t time = 0;
};

std::uint8_t scaled_count(std::uint32_t count) {
  return static_cast<std::uint8_t>(count > full / count_scale ? full : count * count_scale);
}

std::uint8_t scaled_mean_time(const PixelSums& sums, std::uint64_t width) {
  const std::uint64_t count = std::uint64_t{sums.falls} + sums.rises;
  if (count == 0) return 0;
  const double mean = static_cast<double>(sums.time) / static_cast<double>(count * width);
  return static_cast<std::uint8_t>(mean * full + 0.5);
}

std::int64_t saturated_sum(std::int64_t a, std::int64_t b) {
  constexpr std::int64_t least = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t most = std::numeric_limits<std::int64_t>::max();
  if (b > 0 && a > most - b) return most;
  if (b < 0 && a < least - b) return least;
  return a + b;
}

void check_options(ImageSize size, const EventSliceOptions& options) {
  if (options.width_us <= 0) {
    throw std::invalid_argument("width is " + std::to_string(options.width_us) + " us, expected > 0");
  }
  const int side = std::min(size.width, size.height);
  if (options.shrink < 1 || options.shrink > side) {
    throw std::invalid_argument("shrink is " + std::to_string(options.shrink) + ", expected 1 .. " +
                                std::to_string(side));
  }
}

}  // namespace

std::vector<std::uint8_t> event_slices(const EventView& events, ImageSize size,
                                       std::span<const std::int64_t> times,
                                       const EventSliceOptions& options) {
  check_events(events, size);
  check_options(size, options);
  const auto shrink = static_cast<std::size_t>(options.shrink);
  const std::size_t columns = static_cast<std::size_t>(size.width) / shrink;
  const std::size_t rows = static_cast<std::size_t>(size.height) / shrink;
  const std::size_t area = columns * rows;
  const auto width = static_cast<std::uint64_t>(options.width_us);

  std::vector<std::uint8_t> images(times.size() * 3 * area);
  std::vector<PixelSums> sums(area);
  for (std::size_t n = 0; n < times.size(); ++n) {
    const std::int64_t start = saturated_sum(times[n], -(options.width_us / 2));
    const std::int64_t stop = saturated_sum(start, options.width_us);
    const auto first = std::ranges::lower_bound(events.t, start);
    const auto last = std::lower_bound(first, events.t.end(), stop);
    std::ranges::fill(sums, PixelSums{});
    const auto end = static_cast<std::size_t>(last - events.t.begin());
    for (auto k = static_cast<std::size_t>(first - events.t.begin()); k < end; ++k) {
      const std::size_t column = events.x[k] / shrink;
      const std::size_t row = events.y[k] / shrink;
      if (column >= columns || row >= rows) continue;
      PixelSums& pixel = sums[row * columns + column];
      ++(events.p[k] ? pixel.rises : pixel.falls);
      pixel.time += static_cast<std::uint64_t>(events.t[k]) - static_cast<std::uint64_t>(start);
    }
    std::uint8_t* image = images.data() + n * 3 * area;
    for (std::size_t i = 0; i < area; ++i) {
      image[i] = scaled_count(sums[i].rises);
      image[area + i] = scaled_mean_time(sums[i], width);
      image[2 * area + i] = scaled_count(sums[i].falls);
    }
  }
  return images;
}

}  // namespace emseg
