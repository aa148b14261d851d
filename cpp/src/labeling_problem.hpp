// Checks of labelling problems at the boundary, in the one place where their sums are proven to fit.
#pragma once

#include <cstdint>
#include <span>

#include "emseg/expansion.hpp"

namespace emseg {

// Checks shapes, indices, signs and totals; throws std::invalid_argument.  Returns the largest capacity that
// an expansion move can meet: the range of the data costs plus twice the weights at any one site.
template <typename Cost>
std::int64_t check_problem(const BasicLabelingProblem<Cost>& problem);

template <typename Cost>
void check_labels(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels);

// The energy of labels that have been checked.
template <typename Cost>
std::int64_t evaluate(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels);

}  // namespace emseg
