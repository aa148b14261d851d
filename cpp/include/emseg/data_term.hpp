// The data term: how badly a motion model explains an event, from the sharpness of the image it makes.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "emseg/iwe.hpp"

namespace emseg {

// With g = min(1, G / G_ref):
enum class DataTerm {
  published,    // 255 (1 - g), G_ref the largest pixel of any model's image
  logarithmic,  // 255 log((1 + f) / (g + f)) / log((1 + f) / f), f = 0.05, G_ref the 95 % quantile over the
                // events of the best G that any model gives them: a log-likelihood ratio, and one hot pixel
                // moves nothing
};

std::string_view name_of(DataTerm term);
// Throws std::invalid_argument that lists the known names.
DataTerm data_term(std::string_view name);

// What one model makes of a window: G, the blurred image of all its warped events, where each event falls.
struct ModelSupport {
  std::vector<float> sharpness;  // G per event
  float peak = 0;                // largest pixel of the image
};

// The image covers all warped events within `canvas`.
void evaluate_support(const PointView& points, const MotionModel& model, const WarpFrame& frame,
                      Region canvas, std::span<const float> taps, IweWorkspace& workspace,
                      ModelSupport& support);

// G_ref of a set of models.
double reference_sharpness(DataTerm term, std::span<const ModelSupport* const> supports);

// Cost of sharpness G, 0..255; what is sharper than the reference costs nothing.
float event_cost(DataTerm term, float sharpness, float reference);

// The cost lambda_data times, rounded: the integers that the energy is made of.
std::int32_t integer_cost(DataTerm term, float sharpness, double reference, double lambda_data);

// Of all events.
void integer_costs(DataTerm term, std::span<const float> sharpness, double reference, double lambda_data,
                   std::span<std::int32_t> costs);

}  // namespace emseg
