// Images of whole votes, and sums of counts and costs.
#include "kernels/kernels.hpp"
#include "kernels/vector.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {

void nearest_cells(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t padding,
                   std::int32_t* cell) {
  // Pixels, being whole numbers, lie half a pixel inside their cells.
  const float left = grid.x0 - 0.5f, top = grid.y0 - 0.5f, width = grid.width, height = grid.height;
  const std::int32_t stride = grid.stride;
  for (std::size_t k = 0; k < n; ++k) {
    const float u = x[k] - left, v = y[k] - top;
    const bool inside = u >= 0 && v >= 0 && u < width && v < height;
    const auto column = static_cast<std::int32_t>(inside ? u : 0);
    const auto row = static_cast<std::int32_t>(inside ? v : 0);
    cell[k] = inside ? (row + padding) * stride + column + padding : 0;
  }
}

std::int32_t sum_of_minima(const std::int32_t* a, const std::int32_t* b, std::size_t n) {
  std::int32_t sum = 0;
  for (std::size_t k = 0; k < n; ++k) sum += a[k] < b[k] ? a[k] : b[k];
  return sum;
}

void clamp_counts(std::uint16_t* counts, std::size_t n, std::int16_t most) {
  for (std::size_t i = 0; i < n; ++i) {
    const auto count = static_cast<std::int16_t>(counts[i]);
    const std::int16_t upper = count < most ? count : most;
    const auto least = static_cast<std::int16_t>(-most);
    counts[i] = static_cast<std::uint16_t>(upper > least ? upper : least);
  }
}

void smooth_counts_down(const std::uint16_t* centre, std::ptrdiff_t stride, std::size_t n,
                        std::uint16_t* smooth) {
  const std::uint16_t *above2 = centre - 2 * stride, *above = centre - stride, *below = centre + stride,
                      *below2 = centre + 2 * stride;
  for (std::size_t x = 0; x < n; ++x) {
    const auto ends = static_cast<std::uint16_t>(above2[x] + below2[x]);
    const auto sides = static_cast<std::uint16_t>(above[x] + below[x]);
    smooth[x] = static_cast<std::uint16_t>(ends + 4 * sides + 6 * centre[x]);
  }
}

void smooth_counts_across(const std::uint16_t* centre, std::size_t n, std::uint16_t* smooth) {
  const std::uint16_t *before2 = centre - 2, *before = centre - 1, *after = centre + 1, *after2 = centre + 2;
  for (std::size_t x = 0; x < n; ++x) {
    const auto ends = static_cast<std::uint16_t>(before2[x] + after2[x]);
    const auto sides = static_cast<std::uint16_t>(before[x] + after[x]);
    const auto sum = static_cast<std::uint16_t>(ends + 4 * sides + 6 * centre[x]);
    // Towards zero, so that rises and falls are counted alike.
    smooth[x] = static_cast<std::uint16_t>(static_cast<std::int16_t>(sum) / 16);
  }
}

void add_counts(const std::uint16_t* counts, std::size_t n, std::uint32_t* sums) {
  for (std::size_t i = 0; i < n; ++i) sums[i] += counts[i];
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
