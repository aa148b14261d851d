#include "emseg/simd.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <stdexcept>
#include <string>

#include "kernels/kernel_table.hpp"

namespace emseg {
namespace {

constexpr std::array all_levels{SimdLevel::baseline, SimdLevel::avx2, SimdLevel::avx512};

bool runs(SimdLevel level) {
#ifdef EMSEG_X86_LEVELS
  if (level == SimdLevel::avx2) return __builtin_cpu_supports("avx2");
  if (level == SimdLevel::avx512) {
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  }
#endif
  return level == SimdLevel::baseline;
}

SimdLevel chosen_level() {
  const auto levels = simd_levels();
  const char* const wanted = std::getenv("EMSEG_SIMD");
  if (!wanted || !*wanted) return levels.back();
  std::string known;
  for (const SimdLevel level : levels) {
    if (wanted == name_of(level)) return level;
    known += (known.empty() ? "" : ", ") + std::string(name_of(level));
  }
  throw std::invalid_argument("EMSEG_SIMD is '" + std::string(wanted) + "', expected one of " + known +
                              " on this processor");
}

}  // namespace

std::string_view name_of(SimdLevel level) {
  constexpr std::array<std::string_view, all_levels.size()> names{"baseline", "avx2", "avx512"};
  return names[static_cast<std::size_t>(level)];
}

std::vector<SimdLevel> simd_levels() {
  std::vector<SimdLevel> levels;
  std::copy_if(all_levels.begin(), all_levels.end(), std::back_inserter(levels), runs);
  return levels;
}

SimdLevel simd_level() {
  static const SimdLevel level = chosen_level();
  return level;
}

const KernelTable& kernels_at(SimdLevel level) {
#ifdef EMSEG_X86_LEVELS
  if (level == SimdLevel::avx2) return avx2::table;
  if (level == SimdLevel::avx512) return avx512::table;
#endif
  static_cast<void>(level);
  return baseline::table;
}

const KernelTable& kernels() {
  static const KernelTable& table = kernels_at(simd_level());
  return table;
}

}  // namespace emseg
