// Contrast (focus) of an image of warped events, with its exact gradient by the model's parameters.
#pragma once

#include <array>
#include <span>
#include <string_view>

#include "emseg/iwe.hpp"

namespace emseg {

// Of the blurred image H over a region of N pixels.
enum class ContrastMeasure {
  variance,            // mean((H - mean H)^2)
  mean_square,         // mean(H^2)
  gradient_magnitude,  // mean(|grad H|^2), central differences, zero outside
};

// Throws std::invalid_argument that lists the known names.
ContrastMeasure contrast_measure(std::string_view name);

struct ContrastOptions {
  ContrastMeasure measure = ContrastMeasure::variance;
  double sigma = 1.0;  // Gaussian blur, px
};

struct ContrastResult {
  double value = 0;
  std::array<double, 8> gradient{};  // by the model's parameters; the first dof entries count
};

struct ContrastWorkspace {
  IweWorkspace iwe;      // its cells hold the derivative of the value by each vote
  LineFloats padded;     // one row of the blurred image, with zeros on either side
  LineFloats rows;       // the blurred image, blurred once more along its rows
  Image image, adjoint;  // of the gradient magnitude alone
};

// Contrast of the points' IWE over `region`.
// The gradient is exact for the bilinear vote: with H = G*I, d value/d theta = sum_k grad J(x'_k) ·
// dx'_k/dtheta, where J = G*(d value/dH) is interpolated bilinearly (Gallego et al., CVPR 2018, with the
// adjoint of the blur).
double contrast(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region region,
                const ContrastOptions& options, ContrastWorkspace& workspace);
ContrastResult contrast_and_gradient(const PointView& points, const MotionModel& model,
                                     const WarpFrame& frame, Region region, const ContrastOptions& options,
                                     ContrastWorkspace& workspace);

}  // namespace emseg
