// Even samples of events in time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace emseg {

// Every n-th index of `count`, so that no more than `most` are left; all of them where there are no more.
inline std::vector<std::size_t> even_sample(std::size_t count, std::size_t most) {
  const std::size_t kept = std::min(count, most);
  std::vector<std::size_t> indices(kept);
  // Quotient and remainder apart, so that no product overflows.
  for (std::size_t i = 0; i < kept; ++i) indices[i] = i * (count / kept) + i * (count % kept) / kept;
  return indices;
}

}  // namespace emseg
