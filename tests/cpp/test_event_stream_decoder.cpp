#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "emseg/event_stream_decoder.hpp"

using namespace emseg;

TEST_CASE("events of a DVS and of an ATIS") {
  const std::vector<std::uint8_t> dvs = {0xff, 0xff, 46 << 1, 5, 1, 6, 0, 0xfe, 3 << 1 | 1, 7, 0, 8, 2};
  EventStreamDecoder decoder(EventStreamKind::dvs);
  const auto events = decoder.decode(dvs);
  CHECK(events.x == std::vector<std::uint16_t>{261, 7});
  CHECK(events.y == std::vector<std::uint16_t>{6, 520});
  CHECK(events.t == std::vector<std::int64_t>{300, 303});
  CHECK(events.p == std::vector<std::uint8_t>{0, 1});

  // Once 63 us; a rise; a measurement of exposure, which takes time but is no event; a fall.
  const std::vector<std::uint8_t> atis = {0xfd, 35 << 2 | 2, 1, 0,      2, 0, 2 << 2 | 1, 9,
                                          0,    9,           0, 1 << 2, 3, 0, 4,          0};
  EventStreamDecoder other(EventStreamKind::atis);
  const auto changes = other.decode(atis);
  CHECK(changes.x == std::vector<std::uint16_t>{1, 3});
  CHECK(changes.t == std::vector<std::int64_t>{98, 101});
  CHECK(changes.p == std::vector<std::uint8_t>{1, 0});
}

TEST_CASE("wherever an Event Stream is cut, the events are the same") {
  std::mt19937 random(2);
  std::vector<std::uint8_t> bytes(3000);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  for (const EventStreamKind kind : {EventStreamKind::dvs, EventStreamKind::atis}) {
    EventStreamDecoder whole(kind);
    const auto expected = whole.decode(bytes);
    EventStreamDecoder pieces(kind);
    EventColumns events;
    for (std::size_t begin = 0; begin < bytes.size();) {
      const std::size_t length = std::min<std::size_t>(random() % 12, bytes.size() - begin);
      const auto part = pieces.decode(std::span(bytes).subspan(begin, length));
      for (std::size_t k = 0; k < part.size(); ++k) {
        events.append(part.x[k], part.y[k], part.t[k], part.p[k] != 0);
      }
      begin += length;
    }
    CHECK(events.size() > 100);
    CHECK(events.x == expected.x);
    CHECK(events.y == expected.y);
    CHECK(events.t == expected.t);
    CHECK(events.p == expected.p);
    CHECK(pieces.pending() == whole.pending());
  }
}
