// Counter-based random numbers: a draw depends on key, stream and counter alone, so that it comes out the
// same whatever was drawn before it and on which thread.
#pragma once

#include <cmath>
#include <cstdint>

namespace emseg::simulation {

// The finaliser of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA
// 2014), used as a keyed function of a counter as in Salmon et al., "Parallel random numbers: as easy as 1,
// 2, 3", SC 2011.
class CounterRandom {
 public:
  explicit CounterRandom(std::uint64_t seed) : key_(mix(seed + golden)) {}

  std::uint64_t bits(std::uint64_t stream, std::uint64_t counter) const {
    return mix(mix(key_ ^ mix(stream * golden + 1)) + counter * golden);
  }

  // In (0, 1], 2^-53 apart.
  double uniform(std::uint64_t stream, std::uint64_t counter) const {
    return static_cast<double>((bits(stream, counter) >> 11) + 1) * 0x1p-53;
  }

  // Of mean 1.
  double exponential(std::uint64_t stream, std::uint64_t counter) const {
    return -std::log(uniform(stream, counter));
  }

  // Of mean 0 and variance 1: the sum of twelve uniform numbers, which needs no function that differs between
  // machines and never exceeds 6.  Uses the counters counter .. counter+2.
  double normal(std::uint64_t stream, std::uint64_t counter) const {
    std::int64_t sum = 0;
    for (std::uint64_t k = 0; k < 3; ++k) {
      const std::uint64_t word = bits(stream, counter + k);
      for (int shift = 0; shift < 64; shift += 16) sum += static_cast<std::int64_t>((word >> shift) & 0xffff);
    }
    return static_cast<double>(sum - 6 * 0xffff) * 0x1p-16;
  }

 private:
  static constexpr std::uint64_t golden = 0x9e3779b97f4a7c15;

  static constexpr std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }

  std::uint64_t key_;
};

}  // namespace emseg::simulation
