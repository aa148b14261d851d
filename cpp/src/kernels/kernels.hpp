// The functions of a level's table, for the table; see kernel_table.hpp for what they do.
#pragma once

#include "kernels/kernel_table.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {

void warp(const WarpField& field, const float* x, const float* y, const float* dt, std::size_t n,
          float* warped_x, float* warped_y);
void add_gradient(const WarpField& field, const float* x, const float* y, const float* dt,
                  const float* slope_x, const float* slope_y, std::size_t n, double* sum);
void locate(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t* cell,
            float* right, float* low, CellBox* box);
void scatter(float* pairs, const std::int32_t* cell, const float* right, const float* low, const float* sign,
             std::size_t n);
void fold(const float* own, float* above, std::size_t n, float* row);
void sample_values(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                   const float* low, std::size_t n, float* value);
void sample_slopes(const float* image, std::int32_t stride, const std::int32_t* cell, const float* right,
                   const float* low, std::size_t n, float* dx, float* dy);
void filter_row(const float* row, std::size_t n, const float* taps, int radius, float* filtered);
void filter_rows(const float* const* rows, std::size_t n, const float* taps, int radius, float* filtered);
void nearest_cells(const CellGrid& grid, const float* x, const float* y, std::size_t n, std::int32_t padding,
                   std::int32_t* cell);
std::int32_t sum_of_minima(const std::int32_t* a, const std::int32_t* b, std::size_t n);
void clamp_counts(std::uint16_t* counts, std::size_t n, std::int16_t most);
void smooth_counts_down(const std::uint16_t* centre, std::ptrdiff_t stride, std::size_t n,
                        std::uint16_t* smooth);
void smooth_counts_across(const std::uint16_t* centre, std::size_t n, std::uint16_t* smooth);
void add_patches(const std::uint16_t* image, std::int32_t stride, const std::int32_t* places, std::size_t n,
                 std::uint16_t* sums);
void add_counts(const std::uint16_t* counts, std::size_t n, std::uint32_t* sums);
void add_sums(const float* row, std::size_t n, double* sum, double* square);
void subtract_scaled(float* row, const float* profile, float scale, std::size_t n);
float largest_magnitude(const float* values, std::size_t n);
void widen(const float* values, std::size_t n, float* low, float* high);
void natural_log(const float* values, std::size_t n, float* logs);

}  // namespace emseg::EMSEG_SIMD_LEVEL
