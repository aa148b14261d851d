#include "emseg/window.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace emseg {

std::vector<Window> windows_by_count(std::size_t event_count, std::size_t count) {
  if (count == 0) throw std::invalid_argument("window count is 0, expected at least 1 event a window");
  std::vector<Window> windows;
  windows.reserve(event_count / count + 1);
  for (std::size_t begin = 0; begin < event_count;) {
    const std::size_t end = begin + std::min(count, event_count - begin);
    windows.push_back({begin, end});
    begin = end;
  }
  return windows;
}

std::vector<Window> windows_by_duration(std::span<const std::int64_t> t, std::int64_t duration_us) {
  if (duration_us <= 0) {
    throw std::invalid_argument("window duration is " + std::to_string(duration_us) +
                                " us, expected at least 1 us");
  }
  // Times since the first are unsigned: they fit even where a difference of int64 does not.
  const auto duration = static_cast<std::uint64_t>(duration_us);
  std::vector<Window> windows;
  std::size_t begin = 0;
  std::uint64_t window_start = 0;  // since the first event
  for (std::size_t k = 1; k < t.size(); ++k) {
    if (t[k] < t[k - 1]) {
      throw std::invalid_argument("event " + std::to_string(k) + " has time " + std::to_string(t[k]) +
                                  " us, before its predecessor's " + std::to_string(t[k - 1]) +
                                  " us; events must be sorted by time");
    }
    const std::uint64_t since_first = static_cast<std::uint64_t>(t[k]) - static_cast<std::uint64_t>(t[0]);
    if (since_first - window_start >= duration) {
      windows.push_back({begin, k});
      begin = k;
      window_start = since_first - since_first % duration;
    }
  }
  if (begin < t.size()) windows.push_back({begin, t.size()});
  return windows;
}

}  // namespace emseg
