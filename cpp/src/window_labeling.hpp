// Labelling problems of whole windows: checked at the boundary, evaluated without the event graph.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/band_expansion.hpp"

namespace emseg {

// Throws std::invalid_argument where shapes or signs do not fit or the energy could overflow.  Returns a
// bound on the range of the data costs of any group of events plus twice the weight of the edges at it.
std::int64_t check_window_labeling(const PixelGraph& graph, const WindowLabeling& problem);

void check_window_labels(const PixelGraph& graph, const WindowLabeling& problem,
                         std::span<const std::int32_t> labels);

// The energy of what has been checked.
std::int64_t evaluate_window(const PixelGraph& graph, const WindowLabeling& problem,
                             std::span<const std::int32_t> labels);

// Labels merged whole as long as that lowers the energy (see LabelTotals).
struct MergedLabels {
  std::vector<std::int32_t> labels;
  std::int64_t energy = 0;  // of the labels given
  std::int64_t gain = 0;
};
MergedLabels merge_window_labels(const PixelGraph& graph, const WindowLabeling& problem,
                                 std::span<const std::int32_t> labels);

}  // namespace emseg
