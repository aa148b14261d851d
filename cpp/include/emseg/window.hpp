// Windows: half-open intervals of a recording's events, by count or by duration.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace emseg {

struct Window {
  std::size_t begin = 0;  // first event
  std::size_t end = 0;    // one past the last

  std::size_t size() const { return end - begin; }
  friend bool operator==(const Window&, const Window&) = default;
};

// Successive windows of `count` events; the last one holds the rest.
// Throws std::invalid_argument where count is 0.
std::vector<Window> windows_by_count(std::size_t event_count, std::size_t count);

// Successive windows [t0 + k d, t0 + (k+1) d) of `duration_us` from the first event's time t0 on; windows
// without events are left out.  Right for all times that int64 holds, however far apart.
// Throws std::invalid_argument where the duration is not positive or times decrease.
std::vector<Window> windows_by_duration(std::span<const std::int64_t> t, std::int64_t duration_us);

}  // namespace emseg
