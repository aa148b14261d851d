#include <doctest/doctest.h>

#include <stdexcept>
#include <string>
#include <vector>

#include "emseg/event.hpp"

using namespace emseg;

namespace {

struct Columns {
  std::vector<std::uint16_t> x{0, 5, 9};
  std::vector<std::uint16_t> y{0, 3, 7};
  std::vector<std::int64_t> t{-10, 4, 4};
  std::vector<std::uint8_t> p{0, 1, 1};

  EventView view() const { return {x, y, t, p}; }
};

std::string complaint(const Columns& columns, ImageSize size = {10, 8}) {
  try {
    check_events(columns.view(), size);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("events that are in order and on the sensor pass") {
  CHECK(complaint({}) == "");
  CHECK(complaint({{}, {}, {}, {}}) == "");
}

TEST_CASE("the first offending event is named") {
  Columns columns;
  SUBCASE("x off the sensor") {
    columns.x[1] = 10;
    CHECK(complaint(columns).find("event 1 lies at (10, 3)") == 0);
  }
  SUBCASE("y off the sensor") {
    columns.y[2] = 8;
    CHECK(complaint(columns).find("event 2 lies at (9, 8)") == 0);
  }
  SUBCASE("polarity") {
    columns.p[2] = 2;
    CHECK(complaint(columns).find("event 2 has polarity 2") == 0);
  }
  SUBCASE("time order") {
    columns.t[2] = 3;
    CHECK(complaint(columns).find("event 2 has time 3 us") == 0);
  }
  SUBCASE("columns of different lengths") {
    columns.p.pop_back();
    CHECK(complaint(columns).find("different lengths") != std::string::npos);
  }
  SUBCASE("no sensor") { CHECK(complaint(columns, {0, 8}).find("sensor size is 0x8") == 0); }
  SUBCASE("sensor beyond 16-bit coordinates") {
    CHECK(complaint(columns, {65537, 8}).find("sensor size is 65537x8") == 0);
  }
}

TEST_CASE("a slice borrows the events between its bounds") {
  const Columns columns;
  const EventView slice = columns.view().slice(1, 3);
  REQUIRE(slice.size() == 2);
  CHECK(slice.x.data() == columns.x.data() + 1);
  CHECK(slice.p.data() == columns.p.data() + 1);
  CHECK(slice.slice(2, 2).empty());
}
