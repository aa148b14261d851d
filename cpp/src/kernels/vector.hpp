// Vectors as wide as the level's registers, and loops over elements in blocks of a fixed size.
//
// Included by kernel sources only (see kernel_table.hpp).
#pragma once

#include <cstddef>
#include <cstdint>

namespace emseg::EMSEG_SIMD_LEVEL {

#if defined(__AVX512F__)
constexpr std::size_t lanes = 16;
#elif defined(__AVX2__)
constexpr std::size_t lanes = 8;
#else
constexpr std::size_t lanes = 4;
#endif

typedef float Floats __attribute__((vector_size(4 * lanes)));
typedef std::int32_t Ints __attribute__((vector_size(4 * lanes)));

inline Floats load(const float* from) {
  Floats value;
  __builtin_memcpy(&value, from, sizeof value);
  return value;
}
inline void store(float* to, Floats value) { __builtin_memcpy(to, &value, sizeof value); }

// Sums are kept in 16 parts at every level, so that they round alike: element i goes to part i mod 16.
constexpr std::size_t block = 16;

class BlockSum {
 public:
  // Elements i .. i + lanes - 1 of a block.
  void add(std::size_t i, Floats values) { parts_[i / lanes] += values; }

  // Halves are added until one is left.
  double total() const {
    float each[block];
    for (std::size_t i = 0; i < block; i += lanes) store(each + i, parts_[i / lanes]);
    for (std::size_t half = block / 2; half > 0; half /= 2) {
      for (std::size_t i = 0; i < half; ++i) each[i] += each[i + half];
    }
    return static_cast<double>(each[0]);
  }

 private:
  Floats parts_[block / lanes] = {};
};

// body(at, i) for every vector: at[s] + i is its place in stream s.  The last block is a copy, filled up with
// zeros.
template <std::size_t Streams, typename Body>
inline void for_each_vector(const float* const (&streams)[Streams], std::size_t n, const Body& body) {
  const float* at[Streams];
  std::size_t k = 0;
  for (; k + block <= n; k += block) {
    for (std::size_t s = 0; s < Streams; ++s) at[s] = streams[s] + k;
    for (std::size_t i = 0; i < block; i += lanes) body(at, i);
  }
  if (k == n) return;
  float last[Streams][block] = {};
  for (std::size_t s = 0; s < Streams; ++s) {
    for (std::size_t i = 0; i < n - k; ++i) last[s][i] = streams[s][k + i];
    at[s] = last[s];
  }
  for (std::size_t i = 0; i < block; i += lanes) body(at, i);
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
