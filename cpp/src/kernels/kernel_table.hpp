// The hot loops, as one table of functions for each level of instructions.
//
// Kernel sources are compiled several times, with other flags each time, into a namespace named after the
// level. They include nothing but this file, vector.hpp and headers without code: an inline function of
// anyone else's would be compiled with AVX-512 here, and the linker might keep that copy for all.
#pragma once

#include <cstddef>
#include <cstdint>

#include "emseg/simd.hpp"

namespace emseg {

// A motion model bound to a frame, in single precision.
struct WarpField {
  enum class Form { translation, linear, projective, rotation };
  Form form = Form::translation;
  // x' = x - dt (v + B (x - c) + (x - c) (g, h)·(x - c))
  float vx = 0, vy = 0, b11 = 0, b12 = 0, b21 = 0, b22 = 0, cx = 0, cy = 0, g = 0, h = 0;
  // exp(-dt speed [a]x) on bearing vectors
  float speed = 0, ax = 0, ay = 0, az = 0, fx = 1, fy = 1, px = 0, py = 0;
};

// Inclusive; empty where min exceeds max.
struct CellBox {
  std::int32_t min_column = INT32_MAX, max_column = -1;
  std::int32_t min_row = INT32_MAX, max_row = -1;
};

// A region whose pixels have a border of cells around them, so that what lies partly outside needs no test:
// pixel (0, 0) of the region is cell (1, 1).  Rows are `stride` cells apart.
struct CellGrid {
  float x0 = 0, y0 = 0;         // place of pixel (0, 0), px
  float width = 0, height = 0;  // of the region, px
  std::int32_t stride = 0;
};

// Patches that votes of pairs are added up over: displacements of up to patch_reach px either way, with a
// last column that does not count.
constexpr int patch_reach = 15;
constexpr int patch_rows = 2 * patch_reach + 1;
constexpr int patch_columns = 2 * patch_reach + 2;

struct KernelTable {
  // Warped places of n points.
  void (*warp)(const WarpField& field, const float* x, const float* y, const float* dt, std::size_t n,
               float* warped_x, float* warped_y);

  // For each place the cell of its top left pixel and its offset from it to the right and down, in 0..1.
  // Places outside the region, infinite or undefined ones get cell 0 and no offset; `box` grows to hold the
  // cells of the others.
  void (*locate)(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t* cell,
                 float* right, float* low, CellBox* box);

  // Adds bilinear votes to a grid that holds two floats a cell, the share of its own row and that of the row
  // below: the four shares of a vote lie side by side.  A vote counts `sign`, or 1 where that is null.
  void (*scatter)(float* pairs, const std::int32_t* cell, const float* right, const float* low,
                  const float* sign, std::size_t n);

  // A row of the image from two rows of pairs: own[2 i] + above[2 i + 1].  The pairs above become zero.
  void (*fold)(const float* own, float* above, std::size_t n, float* row);

  // Bilinear interpolation in an image of cells, and its slopes.
  void (*sample_values)(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                        const float* low, std::size_t n, float* value);
  void (*sample_slopes)(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                        const float* low, std::size_t n, float* dx, float* dy);

  // sum[d] += sum over the points of slope · d(warped place)/d(coefficient d).  Coefficients are vx vy b11
  // b12 b21 b22 g h, or wx wy wz of a rotation.
  void (*add_gradient)(const WarpField& field, const float* x, const float* y, const float* dt,
                       const float* slope_x, const float* slope_y, std::size_t n, double* sum);

  // One pass of a symmetric filter of 2 radius + 1 taps along a row, of which radius elements on either side
  // can be read; and across rows[0 .. 2 radius].
  void (*filter_row)(const float* row, std::size_t n, const float* taps, int radius, float* filtered);
  void (*filter_rows)(const float* const* rows, std::size_t n, const float* taps, int radius,
                      float* filtered);

  // Cells of the nearest pixels in a region that has `padding` cells around it; 0 for places outside the
  // region and undefined ones.
  void (*nearest_cells)(const CellGrid& grid, const float* x, const float* y, std::size_t n,
                        std::int32_t padding, std::int32_t* cell);

  // The smaller of the elements of either, added up; it fits 32 bits.
  std::int32_t (*sum_of_minima)(const std::int32_t* a, const std::int32_t* b, std::size_t n);

  // Counts beyond `most` either way, negative ones as their complements, are cut down to it.
  void (*clamp_counts)(std::uint16_t* counts, std::size_t n, std::int16_t most);

  // The passes of a binomial filter, weights 1 4 6 4 1, over counts of -127 to 127, negative ones as their
  // complements: down five rows about `centre`, and along a row of such sums, divided by 16 and rounded to
  // zero.
  void (*smooth_counts_down)(const std::uint16_t* centre, std::ptrdiff_t stride, std::size_t n,
                             std::uint16_t* smooth);
  void (*smooth_counts_across)(const std::uint16_t* centre, std::size_t n, std::uint16_t* smooth);

  // sums += the patch of an image that begins at each place.
  void (*add_patches)(const std::uint16_t* image, std::int32_t stride, const std::int32_t* places,
                      std::size_t n, std::uint16_t* sums);

  // sums[i] += counts[i]
  void (*add_counts)(const std::uint16_t* counts, std::size_t n, std::uint32_t* sums);

  // Sum of the elements, and of their squares.
  void (*add_sums)(const float* row, std::size_t n, double* sum, double* square);
  // row[i] -= scale * profile[i]
  void (*subtract_scaled)(float* row, const float* profile, float scale, std::size_t n);
  // The largest of the elements' magnitudes, 0 of none.
  float (*largest_magnitude)(const float* values, std::size_t n);
  // Widens low .. high to hold the elements; undefined ones do not count.
  void (*widen)(const float* values, std::size_t n, float* low, float* high);
  void (*natural_log)(const float* values, std::size_t n, float* logs);
};

namespace baseline {
extern const KernelTable table;
}
namespace avx2 {
extern const KernelTable table;
}
namespace avx512 {
extern const KernelTable table;
}

// Of a level of simd_levels().
const KernelTable& kernels_at(SimdLevel level);
// Of simd_level().
const KernelTable& kernels();

}  // namespace emseg
