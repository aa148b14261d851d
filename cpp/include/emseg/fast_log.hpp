// Logarithms of many floats at once.
#pragma once

#include <span>

namespace emseg {

// Natural logarithms of normal positive floats, within 3e-7 of the true value or of its size, whichever is
// more; the same bits on every processor. Zero gives about -88.
void natural_logs(std::span<const float> values, std::span<float> logs);

}  // namespace emseg
