// Bilinear votes and samples at places that are located once.
#include "kernels/kernels.hpp"
#include "kernels/vector.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {

void locate(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t* cell,
            float* right, float* low, CellBox* box) {
  const float x0 = grid.x0, y0 = grid.y0, width = grid.width, height = grid.height;
  const std::int32_t stride = grid.stride;
  CellBox grown = *box;
  std::int32_t min_column = grown.min_column, max_column = grown.max_column;
  std::int32_t min_row = grown.min_row, max_row = grown.max_row;
  for (std::size_t k = 0; k < n; ++k) {
    const float u = x[k] - x0;
    const float v = y[k] - y0;
    // Also false for NaN, so that the conversion to int is always defined.
    const bool inside = (u > -1) & (v > -1) & (u < width) & (v < height);
    const float bounded_u = inside ? u : -1.0f;
    const float bounded_v = inside ? v : -1.0f;
    const auto column = static_cast<std::int32_t>(bounded_u + 1);  // of cells: one more than the floor of u
    const auto row = static_cast<std::int32_t>(bounded_v + 1);
    cell[k] = row * stride + column;
    right[k] = bounded_u - static_cast<float>(column - 1);
    low[k] = bounded_v - static_cast<float>(row - 1);
    const std::int32_t low_column = inside ? column : min_column, low_row = inside ? row : min_row;
    min_column = low_column < min_column ? low_column : min_column;
    min_row = low_row < min_row ? low_row : min_row;
    const std::int32_t high_column = inside ? column : -1, high_row = inside ? row : -1;
    max_column = high_column > max_column ? high_column : max_column;
    max_row = high_row > max_row ? high_row : max_row;
  }
  *box = {min_column, max_column, min_row, max_row};
}

void scatter(float* pairs, const std::int32_t* cell, const float* right, const float* low, std::size_t n) {
  typedef float Quad __attribute__((vector_size(16)));
  // Own row and the row below, of the cell and of its right neighbour.
  constexpr Quad left_share = {1, 1, 0, 0}, left_slope = {-1, -1, 1, 1};
  constexpr Quad top_share = {1, 0, 1, 0}, top_slope = {-1, 1, -1, 1};
  for (std::size_t k = 0; k < n; ++k) {
    float* const at = pairs + 2 * static_cast<std::size_t>(cell[k]);
    const Quad shares = (left_share + left_slope * right[k]) * (top_share + top_slope * low[k]);
    Quad sum;
    __builtin_memcpy(&sum, at, sizeof sum);
    sum += shares;
    __builtin_memcpy(at, &sum, sizeof sum);
  }
}

void fold(const float* own, const float* above, std::size_t n, float* row) {
  for (std::size_t i = 0; i < n; ++i) row[i] = own[2 * i] + above[2 * i + 1];
}

namespace {

// The four pixels around each of up to `chunk` places, gathered so that the arithmetic runs in vectors.
constexpr std::size_t chunk = 64;

struct Corners {
  float top_left[chunk], top_right[chunk], bottom_left[chunk], bottom_right[chunk];

  void gather(const float* image, std::int32_t stride, const std::int32_t* cell, std::size_t n) {
    for (std::size_t k = 0; k < n; ++k) {
      const float* const top = image + cell[k];
      top_left[k] = top[0];
      top_right[k] = top[1];
      bottom_left[k] = top[stride];
      bottom_right[k] = top[stride + 1];
    }
  }
};

}  // namespace

void sample_values(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                   const float* low, std::size_t n, float* value) {
  Corners at;
  for (std::size_t first = 0; first < n; first += chunk) {
    const std::size_t count = n - first < chunk ? n - first : chunk;
    at.gather(image, stride, cell + first, count);
    for (std::size_t k = 0; k < count; ++k) {
      const float top = at.top_left[k] + right[first + k] * (at.top_right[k] - at.top_left[k]);
      const float bottom = at.bottom_left[k] + right[first + k] * (at.bottom_right[k] - at.bottom_left[k]);
      value[first + k] = top + low[first + k] * (bottom - top);
    }
  }
}

void sample_slopes(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                   const float* low, std::size_t n, float* dx, float* dy) {
  Corners at;
  for (std::size_t first = 0; first < n; first += chunk) {
    const std::size_t count = n - first < chunk ? n - first : chunk;
    at.gather(image, stride, cell + first, count);
    for (std::size_t k = 0; k < count; ++k) {
      const float along_top = at.top_right[k] - at.top_left[k];
      const float along_bottom = at.bottom_right[k] - at.bottom_left[k];
      dx[first + k] = along_top + low[first + k] * (along_bottom - along_top);
      dy[first + k] = (at.bottom_left[k] - at.top_left[k]) + right[first + k] * (along_bottom - along_top);
    }
  }
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
