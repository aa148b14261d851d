#include <doctest/doctest.h>

#include <limits>
#include <stdexcept>

#include "emseg/window.hpp"

using namespace emseg;

namespace {

constexpr std::int64_t earliest = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t latest = std::numeric_limits<std::int64_t>::max();

}  // namespace

TEST_CASE("windows by count follow one another; the last holds the rest") {
  CHECK(windows_by_count(0, 3).empty());
  CHECK(windows_by_count(7, 3) == std::vector<Window>{{0, 3}, {3, 6}, {6, 7}});
  CHECK(windows_by_count(6, 3) == std::vector<Window>{{0, 3}, {3, 6}});
  CHECK(windows_by_count(2, std::numeric_limits<std::size_t>::max()) == std::vector<Window>{{0, 2}});
  CHECK_THROWS_AS(windows_by_count(7, 0), std::invalid_argument);
}

TEST_CASE("windows by duration are half open and leave out what holds no event") {
  CHECK(windows_by_duration({}, 10).empty());
  const std::vector<std::int64_t> t{-5, -5, 4, 5, 14, 15, 95};
  CHECK(windows_by_duration(t, 10) == std::vector<Window>{{0, 3}, {3, 5}, {5, 6}, {6, 7}});
  CHECK(windows_by_duration(t, 1000) == std::vector<Window>{{0, 7}});
}

TEST_CASE("windows by duration span all of int64") {
  const std::vector<std::int64_t> t{earliest, -1, 0, latest};
  CHECK(windows_by_duration(t, latest) == std::vector<Window>{{0, 1}, {1, 3}, {3, 4}});
  CHECK(windows_by_duration(t, 1) == std::vector<Window>{{0, 1}, {1, 2}, {2, 3}, {3, 4}});
}

TEST_CASE("windows by duration refuse what is no duration or not in order") {
  const std::vector<std::int64_t> t{2, 1};
  CHECK_THROWS_AS(windows_by_duration(t, 0), std::invalid_argument);
  CHECK_THROWS_AS(windows_by_duration(t, -1), std::invalid_argument);
  CHECK_THROWS_AS(windows_by_duration(t, 10), std::invalid_argument);
}
