// Motion models in the form that the kernels take.
#pragma once

#include <array>
#include <span>

#include "emseg/motion_model.hpp"
#include "kernels/kernel_table.hpp"

namespace emseg {

// The model bound to a frame.
WarpField warp_field(const MotionModel& model, const WarpFrame& frame);

// Derivatives by the model's parameters from those by its field's coefficients (KernelTable::add_gradient).
std::array<double, 8> parameter_gradient(const MotionModel& model, const WarpFrame& frame,
                                         std::span<const double, 8> by_coefficient);

}  // namespace emseg
