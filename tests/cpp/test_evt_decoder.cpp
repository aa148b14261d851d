#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "emseg/evt_decoder.hpp"

using namespace emseg;

namespace {

template <typename Word>
std::vector<std::uint8_t> bytes_of(const std::vector<Word>& words) {
  std::vector<std::uint8_t> bytes;
  for (const Word word : words) {
    for (std::size_t k = 0; k < sizeof(Word); ++k)
      bytes.push_back(static_cast<std::uint8_t>(word >> (8 * k)));
  }
  return bytes;
}

void check_event(const EventColumns& events, std::size_t k, int x, int y, std::int64_t t, int p) {
  CAPTURE(k);
  CHECK(events.x[k] == x);
  CHECK(events.y[k] == y);
  CHECK(events.t[k] == t);
  CHECK(events.p[k] == p);
}

bool equal(const EventColumns& a, const EventColumns& b) {
  return a.x == b.x && a.y == b.y && a.t == b.t && a.p == b.p;
}

}  // namespace

TEST_CASE("EVT 2 words, before and after their first time") {
  EvtDecoder decoder(EvtEncoding::evt2);
  const auto events = decoder.decode(bytes_of<std::uint32_t>({
      0x10000000 | 5U << 22 | 7U << 11 | 9U,  // no time yet: left out
      0x80000000 | 1000U,
      0x10000000 | 63U << 22 | 2047U << 11 | 1023U,
      0x00000000 | 1U << 22 | 3U << 11 | 4U,
      0xa0000001,  // a trigger
      0x80000000 | 1001U,
      0x10000000 | 0U << 22 | 1U << 11 | 2U,
  }));
  REQUIRE(events.size() == 3);
  check_event(events, 0, 2047, 1023, 64063, 1);
  check_event(events, 1, 3, 4, 64001, 0);  // as encoded: order is not the decoder's business
  check_event(events, 2, 1, 2, 64064, 1);
  CHECK(decoder.origin() == 64000);
}

TEST_CASE("the high part of a time starts again from 0 after its range") {
  EvtDecoder decoder(EvtEncoding::evt2);
  const auto events = decoder.decode(bytes_of<std::uint32_t>(
      {0x8fffffff, 0x10000000 | 63U << 22, 0x80000000, 0x10000000, 0x80000001, 0x10000000}));
  REQUIRE(events.size() == 3);
  CHECK(events.t[0] == (std::int64_t{1} << 34) - 1);
  CHECK(events.t[1] == std::int64_t{1} << 34);
  CHECK(events.t[2] == (std::int64_t{1} << 34) + 64);
}

TEST_CASE("EVT 2.1 words hold up to 32 pixels of a row") {
  const std::vector<std::uint64_t> words = {
      std::uint64_t{0x80000002} << 32,
      std::uint64_t{0x10000000 | 3U << 22 | 64U << 11 | 5U} << 32 | 0x80000005U,
      std::uint64_t{0x00000000 | 4U << 22 | 32U << 11 | 6U} << 32 | 0x1U,
      std::uint64_t{0x10000000 | 4U << 22 | 32U << 11 | 6U} << 32,
  };
  EvtDecoder decoder(EvtEncoding::evt21);
  const auto events = decoder.decode(bytes_of(words));
  REQUIRE(events.size() == 4);
  check_event(events, 0, 64, 5, 131, 1);
  check_event(events, 1, 66, 5, 131, 1);
  check_event(events, 2, 95, 5, 131, 1);
  check_event(events, 3, 32, 6, 132, 0);

  SUBCASE("with the halves of each word exchanged") {
    std::vector<std::uint64_t> swapped;
    for (const std::uint64_t word : words) swapped.push_back(word << 32 | word >> 32);
    EvtDecoder legacy(EvtEncoding::evt21_swapped);
    CHECK(equal(events, legacy.decode(bytes_of(swapped))));
  }
}

TEST_CASE("EVT 3 sends only what changes") {
  EvtDecoder decoder(EvtEncoding::evt3);
  const auto events = decoder.decode(bytes_of<std::uint16_t>({
      0x2005,  // no time yet: left out
      0x8001,
      0x6010,  // 4096 + 16
      0x0007,
      0x2805,  // row 7, column 5, rise
      0x3014,
      0x4801,  // from column 20: 20 and 31, fall
      0x5081,  // from column 32: 32 and 39
      0x8001,
      0x2006,  // the same high part again: the low one stays
      0x8002,
      0x2007,  // a new high part: the low one is 0
      0x7fff,
      0xe123,  // not events
      0x6001,
      0x0807,
      0x2008,  // row 7 of the other camera of a pair is row 7
  }));
  REQUIRE(events.size() == 8);
  check_event(events, 0, 5, 7, 4112, 1);
  check_event(events, 1, 20, 7, 4112, 0);
  check_event(events, 2, 31, 7, 4112, 0);
  check_event(events, 3, 32, 7, 4112, 0);
  check_event(events, 4, 39, 7, 4112, 0);
  check_event(events, 5, 6, 7, 4112, 0);
  check_event(events, 6, 7, 7, 8192, 0);
  check_event(events, 7, 8, 7, 8193, 0);
  CHECK(decoder.origin() == 0);
}

TEST_CASE("wherever a stream is cut, the events are the same") {
  std::mt19937 random(5);
  std::vector<std::uint8_t> bytes(4096);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  for (const EvtEncoding encoding : {EvtEncoding::evt2, EvtEncoding::evt21, EvtEncoding::evt3}) {
    EvtDecoder whole(encoding);
    const auto expected = whole.decode(bytes);
    CHECK(expected.size() > 0);
    EvtDecoder pieces(encoding);
    EventColumns events;
    for (std::size_t begin = 0; begin < bytes.size();) {
      const std::size_t length = std::min<std::size_t>(random() % 23, bytes.size() - begin);
      const auto part = pieces.decode(std::span(bytes).subspan(begin, length));
      for (std::size_t k = 0; k < part.size(); ++k)
        events.append(part.x[k], part.y[k], part.t[k], part.p[k] != 0);
      begin += length;
    }
    CHECK(equal(events, expected));
    CHECK(pieces.pending() == 0);
    pieces.decode(std::span(bytes).first(1));
    CHECK(pieces.pending() == 1);
  }
}

TEST_CASE("packets of libcaer") {
  const auto events = decode_libcaer_packet(bytes_of<std::uint16_t>({
      0x2009,
      0x3805,  // column 9, row 5, rise, at the time base
      0x1003,
      0x3004,  // 3 us later, row 4, fall
      0x0001,
      0x1002,
      0x4810,  // 4098 us; a column of rises from row 16
      0x5003,
      0x5080,  // rows 16, 17 and 31
  }));
  REQUIRE(events.size() == 5);
  check_event(events, 0, 9, 5, 0, 1);
  check_event(events, 1, 9, 4, 3, 0);
  check_event(events, 2, 9, 16, 4098, 1);
  check_event(events, 3, 9, 17, 4098, 1);
  check_event(events, 4, 9, 31, 4098, 1);
  CHECK(decode_libcaer_packet({}).size() == 0);
  CHECK_THROWS_WITH_AS(decode_libcaer_packet(bytes_of<std::uint16_t>({0x2009, 0x7000})),
                       "byte 2: word of kind 7, expected 0..5", std::invalid_argument);
  CHECK_THROWS_AS(decode_libcaer_packet(bytes_of<std::uint8_t>({1})), std::invalid_argument);
}
