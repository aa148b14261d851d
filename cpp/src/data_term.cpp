#include "emseg/data_term.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <string>

#include "kernels/kernel_table.hpp"

namespace emseg {

namespace {

// Sharpness, as a share of the reference, below which differences say little: what passes by chance.
constexpr float floor_share = 0.05f;

}  // namespace

std::string_view name_of(DataTerm term) { return term == DataTerm::published ? "published" : "logarithmic"; }

DataTerm data_term(std::string_view name) {
  for (const DataTerm term : {DataTerm::published, DataTerm::logarithmic}) {
    if (name == name_of(term)) return term;
  }
  throw std::invalid_argument("unknown data term '" + std::string(name) +
                              "', expected published or logarithmic");
}

void evaluate_support(const PointView& points, const MotionModel& model, const WarpFrame& frame,
                      Region canvas, std::span<const float> taps, IweWorkspace& workspace,
                      ModelSupport& support) {
  support.sharpness.resize(points.size());
  support.peak = sample_iwe(points, model, frame, canvas, taps, workspace, support.sharpness);
}

double reference_sharpness(DataTerm term, std::span<const ModelSupport* const> supports) {
  if (supports.empty()) return 0;
  if (term == DataTerm::published) {
    float peak = 0;
    for (const ModelSupport* support : supports) peak = std::max(peak, support->peak);
    return peak;
  }
  std::vector<float> best = supports.front()->sharpness;
  for (const ModelSupport* support : supports.subspan(1)) {
    for (std::size_t k = 0; k < best.size(); ++k) best[k] = std::max(best[k], support->sharpness[k]);
  }
  if (best.empty()) return 0;
  // Linear interpolation between order statistics, as numpy.quantile.
  const double rank = 0.95 * static_cast<double>(best.size() - 1);
  const auto low = static_cast<std::size_t>(rank);
  const auto middle = best.begin() + static_cast<std::ptrdiff_t>(low);
  std::nth_element(best.begin(), middle, best.end());
  const double below = *middle;
  if (low + 1 == best.size()) return below;
  const double above = *std::min_element(middle + 1, best.end());
  return below + (rank - static_cast<double>(low)) * (above - below);
}

float event_cost(DataTerm term, float sharpness, float reference) {
  constexpr float f = floor_share;
  if (!(reference > 0)) return 0;
  const float share = std::clamp(sharpness / reference, 0.0f, 1.0f);
  if (term == DataTerm::published) return 255.0f * (1.0f - share);
  return 255.0f * std::log((1.0f + f) / (share + f)) / std::log((1.0f + f) / f);
}

std::int32_t integer_cost(DataTerm term, float sharpness, double reference, double lambda_data) {
  const float cost = event_cost(term, sharpness, static_cast<float>(reference));
  return static_cast<std::int32_t>(std::lround(static_cast<float>(lambda_data) * cost));
}

void integer_costs(DataTerm term, std::span<const float> sharpness, double reference, double lambda_data,
                   std::span<std::int32_t> costs) {
  assert(costs.size() == sharpness.size());
  const auto g_ref = static_cast<float>(reference);
  const auto lambda = static_cast<float>(lambda_data);
  if (term == DataTerm::published || !(g_ref > 0)) {
    for (std::size_t k = 0; k < costs.size(); ++k)
      costs[k] = integer_cost(term, sharpness[k], reference, lambda_data);
    return;
  }
  // As event_cost and lround, a chunk at a time: logarithms of many numbers cost a tenth.
  const float scale = lambda * 255.0f / std::log((1.0f + floor_share) / floor_share);
  const float inverse = 1 / g_ref;
  std::array<float, 256> ratio;
  for (std::size_t first = 0; first < costs.size(); first += ratio.size()) {
    const std::size_t n = std::min(ratio.size(), costs.size() - first);
    const float* const from = sharpness.data() + first;
    for (std::size_t i = 0; i < n; ++i) {
      const float share = std::min(from[i] * inverse, 1.0f);
      ratio[i] = (1.0f + floor_share) / (share + floor_share);
    }
    kernels().natural_log(ratio.data(), n, ratio.data());
    std::int32_t* const to = costs.data() + first;
    for (std::size_t i = 0; i < n; ++i) to[i] = static_cast<std::int32_t>(scale * ratio[i] + 0.5f);
  }
}

}  // namespace emseg
