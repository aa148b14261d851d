#include "emseg/model_selection.hpp"

#include <algorithm>
#include <limits>

namespace emseg {

BlockGrid make_block_grid(const PointView& points, Region plane, int block) {
  BlockGrid grid;
  grid.block = block;
  grid.plane = plane;
  grid.columns = (plane.width + block - 1) / block;
  grid.rows = (plane.height + block - 1) / block;
  grid.of_event.resize(points.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const int column = static_cast<int>(points.x[k] - static_cast<float>(plane.x0)) / block;
    const int row = static_cast<int>(points.y[k] - static_cast<float>(plane.y0)) / block;
    grid.of_event[k] =
        std::clamp(row, 0, grid.rows - 1) * grid.columns + std::clamp(column, 0, grid.columns - 1);
  }
  return grid;
}

std::vector<float> block_costs(const BlockGrid& grid, const ModelSupport& support, DataTerm term,
                               double reference, double lambda_data) {
  std::vector<float> own(grid.count(), 0.0f);
  const auto g_ref = static_cast<float>(reference);
  const auto lambda = static_cast<float>(lambda_data);
  for (std::size_t k = 0; k < grid.of_event.size(); ++k) {
    own[static_cast<std::size_t>(grid.of_event[k])] += lambda * event_cost(term, support.sharpness[k], g_ref);
  }
  // Half weight for the four neighbours; a mean, so that costs stay those of a block's worth of events.
  std::vector<float> costs(grid.count());
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      float sum = 0;
      int neighbours = 0;
      const auto at = [&](int c, int r) { return own[static_cast<std::size_t>(r * grid.columns + c)]; };
      if (column > 0) sum += at(column - 1, row), ++neighbours;
      if (row > 0) sum += at(column, row - 1), ++neighbours;
      if (column + 1 < grid.columns) sum += at(column + 1, row), ++neighbours;
      if (row + 1 < grid.rows) sum += at(column, row + 1), ++neighbours;
      costs[static_cast<std::size_t>(row * grid.columns + column)] =
          (at(column, row) + 0.5f * sum) / (1 + 0.5f * static_cast<float>(neighbours));
    }
  }
  return costs;
}

namespace {

double total(const std::vector<float>& minimum) {
  double sum = 0;
  for (const float cost : minimum) sum += cost;
  return sum;
}

std::vector<float> minimum_over(const std::vector<std::vector<float>>& costs,
                                const std::vector<std::size_t>& chosen) {
  std::vector<float> minimum(costs.front().size(), std::numeric_limits<float>::max());
  for (const std::size_t m : chosen) {
    for (std::size_t b = 0; b < minimum.size(); ++b) minimum[b] = std::min(minimum[b], costs[m][b]);
  }
  return minimum;
}

double total_with(const std::vector<float>& minimum, const std::vector<float>& candidate) {
  double sum = 0;
  for (std::size_t b = 0; b < minimum.size(); ++b) sum += std::min(minimum[b], candidate[b]);
  return sum;
}

// The candidate that lowers the total most when added to `minimum`.
std::pair<double, std::size_t> best_addition(const std::vector<std::vector<float>>& costs,
                                             const std::vector<float>& minimum) {
  std::pair<double, std::size_t> best{std::numeric_limits<double>::infinity(), 0};
  for (std::size_t m = 0; m < costs.size(); ++m) {
    const double sum = total_with(minimum, costs[m]);
    if (sum < best.first) best = {sum, m};
  }
  return best;
}

}  // namespace

Selection select_models(const std::vector<std::vector<float>>& costs, double label_cost) {
  Selection selection;
  auto& chosen = selection.chosen;
  double cost = std::numeric_limits<double>::infinity();
  for (bool improved = true; improved;) {
    improved = false;
    while (true) {
      const auto [sum, candidate] = best_addition(costs, minimum_over(costs, chosen));
      const double with = sum + label_cost * static_cast<double>(chosen.size() + 1);
      if (!(with < cost)) break;
      chosen.push_back(candidate);
      cost = with;
    }
    // Drops and swaps: take one out, and put the best other in if that is cheaper than going without.
    for (std::size_t i = 0; i < chosen.size() && chosen.size() > 1; ++i) {
      std::vector<std::size_t> rest = chosen;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      const std::vector<float> without = minimum_over(costs, rest);
      const double dropped = total(without) + label_cost * static_cast<double>(rest.size());
      const auto [sum, candidate] = best_addition(costs, without);
      const double swapped = sum + label_cost * static_cast<double>(chosen.size());
      if (std::min(dropped, swapped) < cost - 1e-6 * cost) {
        if (swapped < dropped) rest.push_back(candidate);
        cost = std::min(dropped, swapped);
        chosen = rest;
        improved = true;
      }
    }
  }
  selection.cost = cost;
  selection.of_block.assign(costs.front().size(), 0);
  for (std::size_t b = 0; b < selection.of_block.size(); ++b) {
    for (std::size_t i = 1; i < chosen.size(); ++i) {
      if (costs[chosen[i]][b] < costs[chosen[static_cast<std::size_t>(selection.of_block[b])]][b]) {
        selection.of_block[b] = static_cast<std::int32_t>(i);
      }
    }
  }
  return selection;
}

}  // namespace emseg
