// Bilinear votes and samples at places that are located once.
#include "kernels/kernels.hpp"
#include "kernels/vector.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {

namespace {

// Of a vector of places: where they vote, and the columns and rows of cells that are touched.
struct Locator {
  const CellGrid& grid;
  Ints min_column, max_column, min_row, max_row;

  Locator(const CellGrid& cells, const CellBox& box)
      : grid(cells),
        min_column(Ints{} + box.min_column),
        max_column(Ints{} + box.max_column),
        min_row(Ints{} + box.min_row),
        max_row(Ints{} + box.max_row) {}

  void operator()(const float* x, const float* y, std::int32_t* cell, float* right, float* low) {
    const Floats u = load(x) - grid.x0;
    const Floats v = load(y) - grid.y0;
    // Also false for NaN, so that the conversion to int is always defined.
    const Ints inside = (u > -1) & (v > -1) & (u < grid.width) & (v < grid.height);
    const Floats bounded_u = inside ? u : Floats{} - 1;
    const Floats bounded_v = inside ? v : Floats{} - 1;
    const Ints column = __builtin_convertvector(bounded_u + 1, Ints);  // one more than the floor of u
    const Ints row = __builtin_convertvector(bounded_v + 1, Ints);
    const Ints at = row * grid.stride + column;
    __builtin_memcpy(cell, &at, sizeof at);
    store(right, bounded_u - __builtin_convertvector(column - 1, Floats));
    store(low, bounded_v - __builtin_convertvector(row - 1, Floats));
    min_column = (inside & (column < min_column)) ? column : min_column;
    max_column = (inside & (column > max_column)) ? column : max_column;
    min_row = (inside & (row < min_row)) ? row : min_row;
    max_row = (inside & (row > max_row)) ? row : max_row;
  }

  CellBox box() const {
    CellBox all{min_column[0], max_column[0], min_row[0], max_row[0]};
    for (std::size_t i = 1; i < lanes; ++i) {
      all.min_column = min_column[i] < all.min_column ? min_column[i] : all.min_column;
      all.max_column = max_column[i] > all.max_column ? max_column[i] : all.max_column;
      all.min_row = min_row[i] < all.min_row ? min_row[i] : all.min_row;
      all.max_row = max_row[i] > all.max_row ? max_row[i] : all.max_row;
    }
    return all;
  }
};

}  // namespace

void locate(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t* cell,
            float* right, float* low, CellBox* box) {
  Locator locator(grid, *box);
  std::size_t k = 0;
  for (; k + lanes <= n; k += lanes) locator(x + k, y + k, cell + k, right + k, low + k);
  if (k < n) {
    // Outside, what is not a place.
    float last_x[lanes], last_y[lanes], last_right[lanes], last_low[lanes];
    std::int32_t last_cell[lanes];
    for (std::size_t i = 0; i < lanes; ++i) {
      last_x[i] = k + i < n ? x[k + i] : __builtin_inff();
      last_y[i] = k + i < n ? y[k + i] : __builtin_inff();
    }
    locator(last_x, last_y, last_cell, last_right, last_low);
    for (std::size_t i = 0; k + i < n; ++i) {
      cell[k + i] = last_cell[i];
      right[k + i] = last_right[i];
      low[k + i] = last_low[i];
    }
  }
  *box = locator.box();
}

namespace {

template <bool is_signed>
void scatter_votes(float* pairs, const std::int32_t* cell, const float* right, const float* low,
                   const float* sign, std::size_t n) {
  typedef float Quad __attribute__((vector_size(16)));
  // Own row and the row below, of the cell and of its right neighbour.
  constexpr Quad left_share = {1, 1, 0, 0}, left_slope = {-1, -1, 1, 1};
  constexpr Quad top_share = {1, 0, 1, 0}, top_slope = {-1, 1, -1, 1};
  for (std::size_t k = 0; k < n; ++k) {
    float* const at = pairs + 2 * static_cast<std::size_t>(cell[k]);
    Quad shares = (left_share + left_slope * right[k]) * (top_share + top_slope * low[k]);
    if constexpr (is_signed) shares *= sign[k];
    Quad sum;
    __builtin_memcpy(&sum, at, sizeof sum);
    sum += shares;
    __builtin_memcpy(at, &sum, sizeof sum);
  }
}

}  // namespace

void scatter(float* pairs, const std::int32_t* cell, const float* right, const float* low, const float* sign,
             std::size_t n) {
  if (sign != nullptr) {
    scatter_votes<true>(pairs, cell, right, low, sign, n);
  } else {
    scatter_votes<false>(pairs, cell, right, low, sign, n);
  }
}

void fold(const float* own, float* above, std::size_t n, float* row) {
  for (std::size_t i = 0; i < n; ++i) row[i] = own[2 * i] + above[2 * i + 1];
  // While they are in the first-level cache.
  for (std::size_t i = 0; i < 2 * n; ++i) above[i] = 0;
}

namespace {

// The four pixels around each of up to `chunk` places, gathered so that the arithmetic runs in vectors: left
// and right in turn.
constexpr std::size_t chunk = 64;

struct Corners {
  float top[2 * chunk], bottom[2 * chunk];

  void gather(const float* image, std::int32_t stride, const std::int32_t* cell, std::size_t n) {
    for (std::size_t k = 0; k < n; ++k) {
      __builtin_memcpy(top + 2 * k, image + cell[k], 2 * sizeof(float));
      __builtin_memcpy(bottom + 2 * k, image + cell[k] + stride, 2 * sizeof(float));
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
      const float top = at.top[2 * k] + right[first + k] * (at.top[2 * k + 1] - at.top[2 * k]);
      const float bottom = at.bottom[2 * k] + right[first + k] * (at.bottom[2 * k + 1] - at.bottom[2 * k]);
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
      const float along_top = at.top[2 * k + 1] - at.top[2 * k];
      const float along_bottom = at.bottom[2 * k + 1] - at.bottom[2 * k];
      dx[first + k] = along_top + low[first + k] * (along_bottom - along_top);
      dy[first + k] = (at.bottom[2 * k] - at.top[2 * k]) + right[first + k] * (along_bottom - along_top);
    }
  }
}

void add_patches(const std::uint16_t* image, std::int32_t stride, const std::int32_t* places, std::size_t n,
                 std::uint16_t* sums) {
  typedef std::uint16_t Counts __attribute__((vector_size(4 * lanes)));
  constexpr int wide = static_cast<int>(2 * lanes);
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint16_t* patch = image + places[k];
    for (int row = 0; row < patch_rows; ++row, patch += stride) {
      for (int column = 0; column < patch_columns; column += wide) {
        std::uint16_t* const to = sums + row * patch_columns + column;
        Counts counts, sum;
        __builtin_memcpy(&counts, patch + column, sizeof counts);
        __builtin_memcpy(&sum, to, sizeof sum);
        sum += counts;
        __builtin_memcpy(to, &sum, sizeof sum);
      }
    }
  }
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
