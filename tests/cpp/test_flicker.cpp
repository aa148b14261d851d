#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>

#include "emseg/flicker.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{240, 180};

// Events with a source: 0 of what moves, 1 of what is to be told from it.
struct Timed {
  int x, y;
  std::int64_t t;
  std::int32_t source;
};

RecordedEvents sorted(std::vector<Timed> events) {
  std::stable_sort(events.begin(), events.end(), [](const Timed& a, const Timed& b) { return a.t < b.t; });
  RecordedEvents columns;
  for (const Timed& event : events) columns.add(event.x, event.y, event.t, 1, event.source);
  return columns;
}

int below(std::mt19937& random, int end) { return static_cast<int>(random() % static_cast<unsigned>(end)); }

// Edges that cross the view, at 1 px/ms: as many events at any time, each on one of them.
std::vector<Timed> moving_edges(std::mt19937& random, int count, std::int64_t duration) {
  std::vector<Timed> events;
  for (int k = 0; k < count; ++k) {
    const auto t = static_cast<std::int64_t>(uniform(random, 0, static_cast<double>(duration)));
    const int edge = 20 * below(random, 12);
    events.push_back(
        {(edge + static_cast<int>(t / 1000)) % sensor.width, below(random, sensor.height), t, 0});
  }
  return events;
}

// Of the events of a source, the share that is called flicker.
double share_found(const RecordedEvents& events, std::int32_t source) {
  const auto flicker = find_flicker(events.view(), sensor);
  REQUIRE(flicker.size() == events.size());
  double found = 0, all = 0;
  for (std::size_t k = 0; k < events.size(); ++k) {
    if (events.source[k] != source) continue;
    found += flicker[k];
    all += 1;
  }
  return found / std::max(all, 1.0);
}

bool any_found(const RecordedEvents& events) { return share_found(events, 0) + share_found(events, 1) > 0; }

}  // namespace

TEST_CASE("bursts all over the view are found, and what moves between them is not") {
  std::mt19937 random(1);
  std::vector<Timed> events = moving_edges(random, 20'000, 40'000);
  // A lamp at 100 Hz, each time for 0.6 ms.
  for (const std::int64_t begin : {3'000, 13'000, 23'000, 33'000}) {
    for (int k = 0; k < 2500; ++k)
      events.push_back({below(random, 240), below(random, 180), begin + below(random, 600), 1});
  }
  const RecordedEvents recorded_events = sorted(std::move(events));
  CHECK(share_found(recorded_events, 1) > 0.95);
  // Bins of 300 us that hold a part of a burst: three at the most of each.
  CHECK(share_found(recorded_events, 0) <= 4 * 3 * 300 / 40'000.0 * 1.1);
}

TEST_CASE("a bin is flicker as a whole or not at all") {
  std::mt19937 random(2);
  std::vector<Timed> events = moving_edges(random, 20'000, 40'000);
  events.push_back({0, 0, 0, 0});  // where bins begin
  for (int k = 0; k < 3000; ++k)
    events.push_back({below(random, 240), below(random, 180), 20'100 + below(random, 900), 1});
  const RecordedEvents recorded_events = sorted(std::move(events));
  const auto flicker = find_flicker(recorded_events.view(), sensor);
  // 20 100 us is where bin 67 begins.
  for (std::size_t k = 0; k < flicker.size(); ++k)
    REQUIRE(flicker[k] == (recorded_events.t[k] >= 20'100 && recorded_events.t[k] < 21'000));
}

TEST_CASE("an object that appears at once is no flicker, nor is one that blinks") {
  std::mt19937 random(3);
  std::vector<Timed> events = moving_edges(random, 20'000, 40'000);
  for (const std::int64_t begin : {9'000, 21'000}) {
    for (int k = 0; k < 2500; ++k)
      events.push_back({100 + below(random, 30), 60 + below(random, 30), begin + below(random, 600), 1});
  }
  CHECK(!any_found(sorted(std::move(events))));
}

TEST_CASE("a motion that is half as fast again, or that grows and falls, is no flicker") {
  std::mt19937 random(4);
  for (const bool gradual : {false, true}) {
    std::vector<Timed> events = moving_edges(random, 20'000, 40'000);
    // A stretch of the recording in which the same edges make half as many events again.
    for (const Timed& more : moving_edges(random, 10'000, 40'000)) {
      const double begun = static_cast<double>(more.t) / 40'000;
      const double rise = gradual ? 1 - std::abs(2 * begun - 1) : begun > 0.4 && begun < 0.6 ? 1 : 0;
      if (uniform(random, 0, 1) < rise) events.push_back(more);
    }
    CHECK(!any_found(sorted(std::move(events))));
  }
}

TEST_CASE("what is steady is no flicker, whatever its rate") {
  std::mt19937 random(5);
  for (const int count : {30, 300, 3000, 30'000, 100'000}) {
    CAPTURE(count);
    CHECK(!any_found(sorted(moving_edges(random, count, 40'000))));
  }
}

TEST_CASE("windows of next to nothing, and times as far apart as 64 bits allow, hold no flicker") {
  RecordedEvents events;
  CHECK(find_flicker(events.view(), sensor).empty());
  events.add(3, 4, std::numeric_limits<std::int64_t>::min());
  CHECK(!any_found(events));
  events.add(3, 4, -5);
  for (int k = 0; k < 2000; ++k)
    events.add(k % 240, k % 180, std::numeric_limits<std::int64_t>::max() - 2000 + k);
  CHECK(!any_found(events));
  RecordedEvents one_time;
  for (int k = 0; k < 2000; ++k) one_time.add(k % 240, k % 180, 77);
  CHECK(!any_found(one_time));
}
