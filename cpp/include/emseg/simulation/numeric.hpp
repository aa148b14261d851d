// Elementary functions from basic arithmetic alone: the same bits on every machine, and loops that vectorise.
#pragma once

#include <bit>
#include <cstdint>

namespace emseg::simulation {

// Natural logarithm of a positive, normal number; to 3e-7 relative or absolute, whichever is larger.
inline float fast_log(float x) {
  // x = m 2^e with m in [2/3, 4/3): log m = 2 artanh((m - 1) / (m + 1)), by its series.
  const auto bits = std::bit_cast<std::int32_t>(x);
  const std::int32_t exponent = (bits - 0x3f2aaaab) >> 23;
  const float m = std::bit_cast<float>(bits - (exponent << 23));
  const float s = (m - 1.0f) / (m + 1.0f), s2 = s * s;
  const float series = 1.0f + s2 * (1.0f / 3 + s2 * (1.0f / 5 + s2 * (1.0f / 7 + s2 * (1.0f / 9))));
  return 2.0f * s * series + 0.69314718056f * static_cast<float>(exponent);
}

// (1 - exp(-x)) for x >= 0, to 2e-4; exactly 0 at 0 and rising towards 1.
inline float fast_saturation(float x) {
  // exp(-x) = (1 / exp(x / 4))^4, the inner one by its series, which overshoots for no x.
  const float q = 0.25f * x;
  const float e = 1.0f + q * (1.0f + q * (0.5f + q * (1.0f / 6 + q * (1.0f / 24))));
  const float e2 = e * e;
  return 1.0f - 1.0f / (e2 * e2);
}

}  // namespace emseg::simulation
