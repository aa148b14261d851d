// The one check of every derivative: central differences.
#pragma once

#include <cstddef>
#include <vector>

namespace emseg::testing {

// d f / d at[i] for every i; a step is the half-width of its difference.
template <typename Function>
std::vector<double> central_differences(const Function& f, std::vector<double> at,
                                        const std::vector<double>& steps) {
  std::vector<double> slopes(at.size());
  for (std::size_t i = 0; i < at.size(); ++i) {
    const double middle = at[i];
    at[i] = middle + steps[i];
    const double above = f(at);
    at[i] = middle - steps[i];
    const double below = f(at);
    at[i] = middle;
    slopes[i] = (above - below) / (2 * steps[i]);
  }
  return slopes;
}

}  // namespace emseg::testing
