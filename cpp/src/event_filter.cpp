#include "emseg/event_filter.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>

namespace emseg {

namespace {

constexpr std::int64_t never = std::numeric_limits<std::int64_t>::min();

std::size_t padded_area(ImageSize size) {
  return (static_cast<std::size_t>(size.width) + 2) * (static_cast<std::size_t>(size.height) + 2);
}

}  // namespace

BackgroundActivityFilter::BackgroundActivityFilter(ImageSize size, std::int64_t duration_us) : size_(size) {
  check_events({}, size);
  if (duration_us <= 0) {
    throw std::invalid_argument("duration is " + std::to_string(duration_us) + " us, expected > 0");
  }
  duration_us_ = static_cast<std::uint64_t>(duration_us);
  last_.assign(padded_area(size), never);
}

std::vector<std::uint8_t> BackgroundActivityFilter::keep(const EventView& events) {
  check_events(events, size_);
  const std::size_t row = static_cast<std::size_t>(size_.width) + 2;
  std::vector<std::uint8_t> kept(events.size());
  for (std::size_t k = 0; k < events.size(); ++k) {
    const std::size_t here = (std::size_t{events.y[k]} + 1) * row + events.x[k] + 1;
    const std::int64_t* above = &last_[here - row];
    const std::int64_t* below = &last_[here + row];
    const std::int64_t latest = std::max(
        {above[-1], above[0], above[1], last_[here - 1], last_[here + 1], below[-1], below[0], below[1]});
    const std::uint64_t age = static_cast<std::uint64_t>(events.t[k]) - static_cast<std::uint64_t>(latest);
    kept[k] = latest != never && age <= duration_us_;
    last_[here] = events.t[k];
  }
  return kept;
}

}  // namespace emseg
