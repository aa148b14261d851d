// Which instructions the hot loops use, chosen once when they are first needed.
//
// The kernels in cpp/src/kernels are compiled once for each level. They round the same on all of them: no
// fused multiply-add, no reordered sums, sums in a fixed number of parts.  A level changes the speed, not a
// bit of any result.
#pragma once

#include <string_view>
#include <vector>

namespace emseg {

// Ascending; baseline is what every processor of the architecture has (SSE2, NEON).
enum class SimdLevel { baseline, avx2, avx512 };

std::string_view name_of(SimdLevel level);

// Levels that this build has and this processor runs, ascending; baseline is always there.
std::vector<SimdLevel> simd_levels();

// The level in use: the highest of simd_levels(), or a lower one that the environment variable EMSEG_SIMD
// names.  Throws std::invalid_argument where it names none of them.
SimdLevel simd_level();

}  // namespace emseg
