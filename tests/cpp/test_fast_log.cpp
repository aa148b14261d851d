#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "emseg/fast_log.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using emseg::testing::uniform;

TEST_CASE("logarithms are within their bound over all normal floats") {
  std::mt19937 random(1);
  std::vector<float> values{1.0f, 2.0f, 0.5f, std::numeric_limits<float>::min(),
                            std::numeric_limits<float>::max()};
  for (int trial = 0; trial < 200000; ++trial)
    values.push_back(static_cast<float>(std::exp(uniform(random, -87, 88))));
  // Around 1, where the logarithm has few digits left, and around the seams of the exponent.
  for (int trial = 0; trial < 200000; ++trial) values.push_back(static_cast<float>(uniform(random, 0.25, 4)));
  for (const double seam : {std::sqrt(0.5), 1.0, std::sqrt(2.0)}) {
    for (int ulps = -100; ulps <= 100; ++ulps) values.push_back(static_cast<float>(seam * (1 + ulps * 6e-8)));
  }
  std::vector<float> logs(values.size());
  natural_logs(values, logs);
  double worst = 0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double expected = std::log(static_cast<double>(values[k]));
    worst = std::max(worst, std::abs(logs[k] - expected) / std::max(1.0, std::abs(expected)));
  }
  CHECK(worst < 3e-7);
  CHECK(logs[0] == 0);
}
