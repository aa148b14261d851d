#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <stdexcept>
#include <vector>

#include "emseg/event_filter.hpp"

using namespace emseg;

namespace {

struct Stream {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;
  std::vector<std::uint8_t> p;

  EventView view() const { return {x, y, t, p}; }
};

Stream scattered(std::size_t count, ImageSize size) {
  std::mt19937 random(3);
  Stream events;
  std::int64_t t = -50;
  for (std::size_t k = 0; k < count; ++k) {
    t += random() % 4;
    events.x.push_back(static_cast<std::uint16_t>(random() % static_cast<unsigned>(size.width)));
    events.y.push_back(static_cast<std::uint16_t>(random() % static_cast<unsigned>(size.height)));
    events.t.push_back(t);
    events.p.push_back(1);
  }
  return events;
}

}  // namespace

TEST_CASE("events with a neighbour not long before them stay") {
  const ImageSize size{13, 9};
  const std::int64_t duration = 40;
  const Stream events = scattered(1000, size);
  std::vector<std::uint8_t> expected(events.t.size());
  for (std::size_t k = 0; k < events.t.size(); ++k) {
    for (std::size_t j = 0; j < k; ++j) {
      const int dx = std::abs(events.x[k] - events.x[j]);
      const int dy = std::abs(events.y[k] - events.y[j]);
      if (dx <= 1 && dy <= 1 && dx + dy > 0 && events.t[k] - events.t[j] <= duration) expected[k] = 1;
    }
  }
  BackgroundActivityFilter filter(size, duration);
  CHECK(filter.keep(events.view()) == expected);

  BackgroundActivityFilter in_chunks(size, duration);
  std::vector<std::uint8_t> kept;
  for (std::size_t begin = 0; begin < events.t.size(); begin += 77) {
    const auto part = in_chunks.keep(events.view().slice(begin, std::min(begin + 77, events.t.size())));
    kept.insert(kept.end(), part.begin(), part.end());
  }
  CHECK(kept == expected);
}

TEST_CASE("bad settings and events are refused") {
  CHECK_THROWS_AS(BackgroundActivityFilter({4, 4}, 0), std::invalid_argument);
  CHECK_THROWS_AS(BackgroundActivityFilter({0, 4}, 1), std::invalid_argument);
  BackgroundActivityFilter filter({4, 4}, 1);
  const Stream off{{4}, {0}, {0}, {0}};
  CHECK_THROWS_AS(filter.keep(off.view()), std::invalid_argument);
}
