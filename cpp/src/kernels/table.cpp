#include "kernels/kernels.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {

extern const KernelTable table;
const KernelTable table{
    .warp = warp,
    .locate = locate,
    .scatter = scatter,
    .fold = fold,
    .sample_values = sample_values,
    .sample_slopes = sample_slopes,
    .add_gradient = add_gradient,
    .filter_row = filter_row,
    .filter_rows = filter_rows,
    .nearest_cells = nearest_cells,
    .sum_of_minima = sum_of_minima,
    .clamp_counts = clamp_counts,
    .smooth_counts_down = smooth_counts_down,
    .smooth_counts_across = smooth_counts_across,
    .add_patches = add_patches,
    .add_counts = add_counts,
    .add_sums = add_sums,
    .subtract_scaled = subtract_scaled,
    .largest_magnitude = largest_magnitude,
    .widen = widen,
    .natural_log = natural_log,
};

}  // namespace emseg::EMSEG_SIMD_LEVEL
