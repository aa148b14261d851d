// Symmetric filters of rows, and sums over rows.
#include <utility>

#include "kernels/kernels.hpp"
#include "kernels/vector.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {
namespace {

// Wider filters are rare: their taps are added one after the other.
constexpr int unrolled_radius = 8;

// value_at(x) for every x of a row: whole vectors, the last of which may overlap the one before.
template <typename VectorAt, typename ScalarAt>
inline void fill_row(float* out, std::size_t n, const VectorAt& vector_at, const ScalarAt& scalar_at) {
  if (n < lanes) {
    for (std::size_t x = 0; x < n; ++x) out[x] = scalar_at(x);
    return;
  }
  std::size_t x = 0;
  for (; x + lanes <= n; x += lanes) store(out + x, vector_at(x));
  if (x < n) store(out + n - lanes, vector_at(n - lanes));
}

// With the radius known to the compiler all taps of a pixel are added up in registers.  Taps and pointers are
// copied, for the compiler does not know that the stores leave them alone.
template <int Radius>
inline void filter_row_of(const float* row, std::size_t n, const float* taps, float* filtered) {
  float tap[Radius + 1];
  for (int d = 0; d <= Radius; ++d) tap[d] = taps[d];
  fill_row(
      filtered, n,
      [=](std::size_t x) {
        Floats sum = tap[0] * load(row + x);
        for (int d = 1; d <= Radius; ++d) sum += tap[d] * (load(row + x - d) + load(row + x + d));
        return sum;
      },
      [=](std::size_t x) {
        float sum = tap[0] * row[x];
        for (int d = 1; d <= Radius; ++d) sum += tap[d] * ((row + x)[-d] + (row + x)[d]);
        return sum;
      });
}

#if defined(__AVX512F__)
// Elements Shift .. Shift + 15 of two vectors in a row.
template <int Shift, int... I>
inline Floats shifted(Floats low, Floats high, std::integer_sequence<int, I...>) {
  return __builtin_shufflevector(low, high, (Shift + I)...);
}

template <int Radius, int... D>
inline Floats filtered_between(const float* tap, Floats before, Floats here, Floats after,
                               std::integer_sequence<int, D...>) {
  constexpr std::make_integer_sequence<int, lanes> all;
  Floats sum = tap[0] * here;
  ((sum += tap[D + 1] * (shifted<lanes - 1 - D>(before, here, all) + shifted<D + 1>(here, after, all))), ...);
  return sum;
}

// As above, with shifted vectors made of whole ones: a load of 64 bytes anywhere else straddles two cache
// lines.
template <int Radius>
inline void filter_long_row_of(const float* row, std::size_t n, const float* taps, float* filtered) {
  if (n < 3 * lanes) return filter_row_of<Radius>(row, n, taps, filtered);
  float tap[Radius + 1];
  for (int d = 0; d <= Radius; ++d) tap[d] = taps[d];
  filter_row_of<Radius>(row, lanes, taps, filtered);
  Floats before = load(row), here = load(row + lanes);
  std::size_t x = lanes;
  for (; x + 2 * lanes <= n; x += lanes) {
    const Floats after = load(row + x + lanes);
    store(filtered + x,
          filtered_between<Radius>(tap, before, here, after, std::make_integer_sequence<int, Radius>()));
    before = here;
    here = after;
  }
  filter_row_of<Radius>(row + x, n - x, taps, filtered + x);
}
#else
template <int Radius>
inline void filter_long_row_of(const float* row, std::size_t n, const float* taps, float* filtered) {
  filter_row_of<Radius>(row, n, taps, filtered);
}
#endif

template <int Radius>
inline void filter_rows_of(const float* const* rows, std::size_t n, const float* taps, float* filtered) {
  const float* row[2 * Radius + 1];
  for (int i = 0; i <= 2 * Radius; ++i) row[i] = rows[i];
  float tap[Radius + 1];
  for (int d = 0; d <= Radius; ++d) tap[d] = taps[d];
  fill_row(
      filtered, n,
      [=](std::size_t x) {
        Floats sum = tap[0] * load(row[Radius] + x);
        for (int d = 1; d <= Radius; ++d)
          sum += tap[d] * (load(row[Radius - d] + x) + load(row[Radius + d] + x));
        return sum;
      },
      [=](std::size_t x) {
        float sum = tap[0] * row[Radius][x];
        for (int d = 1; d <= Radius; ++d) sum += tap[d] * (row[Radius - d][x] + row[Radius + d][x]);
        return sum;
      });
}

// Of any radius, in the same order.
inline void filter_wide_row(const float* row, std::size_t n, const float* taps, int radius, float* filtered) {
  for (std::size_t x = 0; x < n; ++x) filtered[x] = taps[0] * row[x];
  for (int d = 1; d <= radius; ++d) {
    const float tap = taps[d];
    for (std::size_t x = 0; x < n; ++x) filtered[x] += tap * ((row + x)[-d] + (row + x)[d]);
  }
}

inline void filter_wide_rows(const float* const* rows, std::size_t n, const float* taps, int radius,
                             float* filtered) {
  for (std::size_t x = 0; x < n; ++x) filtered[x] = taps[0] * rows[radius][x];
  for (int d = 1; d <= radius; ++d) {
    const float* const above = rows[radius - d];
    const float* const below = rows[radius + d];
    const float tap = taps[d];
    for (std::size_t x = 0; x < n; ++x) filtered[x] += tap * (above[x] + below[x]);
  }
}

template <int Radius>
inline void choose_row(const float* row, std::size_t n, const float* taps, int radius, float* filtered) {
  if constexpr (Radius > unrolled_radius) {
    filter_wide_row(row, n, taps, radius, filtered);
  } else if (radius == Radius) {
    filter_long_row_of<Radius>(row, n, taps, filtered);
  } else {
    choose_row<Radius + 1>(row, n, taps, radius, filtered);
  }
}

template <int Radius>
inline void choose_rows(const float* const* rows, std::size_t n, const float* taps, int radius,
                        float* filtered) {
  if constexpr (Radius > unrolled_radius) {
    filter_wide_rows(rows, n, taps, radius, filtered);
  } else if (radius == Radius) {
    filter_rows_of<Radius>(rows, n, taps, filtered);
  } else {
    choose_rows<Radius + 1>(rows, n, taps, radius, filtered);
  }
}

}  // namespace

void filter_row(const float* row, std::size_t n, const float* taps, int radius, float* filtered) {
  choose_row<1>(row, n, taps, radius, filtered);
}

void filter_rows(const float* const* rows, std::size_t n, const float* taps, int radius, float* filtered) {
  choose_rows<1>(rows, n, taps, radius, filtered);
}

void add_sums(const float* row, std::size_t n, double* sum, double* square) {
  BlockSum values, squares;
  for_each_vector({row}, n, [&](const float* const* at, std::size_t i) {
    const Floats value = load(at[0] + i);
    values.add(i, value);
    squares.add(i, value * value);
  });
  *sum += values.total();
  *square += squares.total();
}

void subtract_scaled(float* row, const float* profile, float scale, std::size_t n) {
  for (std::size_t x = 0; x < n; ++x) row[x] -= scale * profile[x];
}

float largest_magnitude(const float* values, std::size_t n) {
  Floats highest = {};
  for_each_vector({values}, n, [&](const float* const* at, std::size_t i) {
    const Floats value = load(at[0] + i);
    const Floats magnitude = value < 0 ? -value : value;
    highest = magnitude > highest ? magnitude : highest;
  });
  float result = 0;
  for (std::size_t i = 0; i < lanes; ++i) result = highest[i] > result ? highest[i] : result;
  return result;
}

void widen(const float* values, std::size_t n, float* low, float* high) {
  Floats lowest = Floats{} + *low, highest = Floats{} + *high;
  std::size_t k = 0;
  for (; k + lanes <= n; k += lanes) {
    const Floats value = load(values + k);
    lowest = value < lowest ? value : lowest;
    highest = value > highest ? value : highest;
  }
  for (std::size_t i = 0; i < lanes; ++i) {
    *low = lowest[i] < *low ? lowest[i] : *low;
    *high = highest[i] > *high ? highest[i] : *high;
  }
  for (; k < n; ++k) {
    *low = values[k] < *low ? values[k] : *low;
    *high = values[k] > *high ? values[k] : *high;
  }
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
