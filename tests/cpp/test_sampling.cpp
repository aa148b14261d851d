#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <numeric>

#include "emseg/sampling.hpp"

using namespace emseg;

TEST_CASE("an even sample is sorted, distinct, as large as allowed, and its gaps differ by one at most") {
  for (std::size_t count = 0; count <= 130; ++count) {
    for (std::size_t most = 0; most <= 140; ++most) {
      CAPTURE(count);
      CAPTURE(most);
      const auto sample = even_sample(count, most);
      REQUIRE(sample.size() == std::min(count, most));
      if (sample.empty()) continue;
      REQUIRE(sample.front() == 0);
      // The end of the last gap is the end of all.
      const std::size_t gap = count / sample.size();
      for (std::size_t i = 0; i < sample.size(); ++i) {
        const std::size_t next = i + 1 < sample.size() ? sample[i + 1] : count;
        REQUIRE(next > sample[i]);
        REQUIRE(next - sample[i] >= gap);
        REQUIRE(next - sample[i] <= gap + 1);
        // Exactly where quotients lie: i * count / kept, which these numbers do not overflow.
        REQUIRE(sample[i] == i * count / sample.size());
      }
    }
  }
}

TEST_CASE("where there are no more, all are taken") {
  for (const std::size_t most : {std::size_t{5}, std::size_t{6}, std::numeric_limits<std::size_t>::max()}) {
    CHECK(even_sample(5, most) == std::vector<std::size_t>{0, 1, 2, 3, 4});
  }
}

TEST_CASE("counts as large as 64 bits hold are sampled without overflow") {
  constexpr std::size_t count = std::numeric_limits<std::size_t>::max();
  for (const std::size_t most : {1u, 2u, 7u, 1000u, 60'000u}) {
    const auto sample = even_sample(count, most);
    REQUIRE(sample.size() == most);
    CHECK(sample.front() == 0);
    for (std::size_t i = 0; i < most; ++i) {
      const std::size_t next = i + 1 < most ? sample[i + 1] : count;
      REQUIRE(next > sample[i]);
      const std::size_t length = next - sample[i];
      REQUIRE(length >= count / most);
      REQUIRE(length - count / most <= 1);
    }
  }
}
