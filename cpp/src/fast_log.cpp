#include "emseg/fast_log.hpp"

#include <cassert>

#include "kernels/kernel_table.hpp"

namespace emseg {

void natural_logs(std::span<const float> values, std::span<float> logs) {
  assert(values.size() == logs.size());
  kernels().natural_log(values.data(), values.size(), logs.data());
}

}  // namespace emseg
