#include "emseg/pixel_footprint.hpp"

#include <cstdint>

namespace emseg {
namespace {

// Mixes all bits (SplitMix64: Steele, Lea, Flood, OOPSLA 2014).
std::uint64_t mix(std::uint64_t h) {
  h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9u;
  h = (h ^ (h >> 27)) * 0x94D049BB133111EBu;
  return h ^ (h >> 31);
}

// -1/2 .. 1/2 of 16 bits.
float centred(std::uint64_t bits) { return static_cast<float>(bits & 0xFFFF) * (1.0f / 65536) - 0.5f; }

}  // namespace

void scatter_over_pixels(const EventView& events, std::int64_t t_ref, Points& points) {
  for (std::size_t k = 0; k < points.size(); ++k) {
    const std::uint64_t since = static_cast<std::uint64_t>(events.t[k]) - static_cast<std::uint64_t>(t_ref);
    const std::uint64_t bits =
        mix(since * 0x9E3779B97F4A7C15u + (std::uint64_t{events.y[k]} << 17 | events.x[k]));
    points.x[k] += centred(bits);
    points.y[k] += centred(bits >> 16);
  }
}

}  // namespace emseg
