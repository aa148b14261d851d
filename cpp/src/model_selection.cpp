#include "emseg/model_selection.hpp"

#include <algorithm>
#include <limits>

#include "kernels/kernel_table.hpp"

namespace emseg {

BlockGrid make_block_grid(const PointView& points, Region plane, int block) {
  BlockGrid grid;
  grid.block = block;
  grid.plane = plane;
  grid.columns = (plane.width + block - 1) / block;
  grid.rows = (plane.height + block - 1) / block;
  grid.of_event.resize(points.size());
  grid.event_count.assign(grid.count(), 0);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const int column = static_cast<int>(points.x[k] - static_cast<float>(plane.x0)) / block;
    const int row = static_cast<int>(points.y[k] - static_cast<float>(plane.y0)) / block;
    grid.of_event[k] =
        std::clamp(row, 0, grid.rows - 1) * grid.columns + std::clamp(column, 0, grid.columns - 1);
    ++grid.event_count[static_cast<std::size_t>(grid.of_event[k])];
  }
  return grid;
}

std::vector<std::int32_t> block_costs(const BlockGrid& grid, std::span<const std::uint16_t> sharpness,
                                      std::span<const std::uint8_t> cost_of,
                                      std::span<const std::int32_t> doubts) {
  std::vector<std::int32_t> own(grid.count(), 0);
  for (std::size_t k = 0; k < grid.of_event.size(); ++k) {
    own[static_cast<std::size_t>(grid.of_event[k])] += cost_of[sharpness[k]];
  }
  for (std::size_t b = 0; b < doubts.size(); ++b) own[b] += grid.event_count[b] * doubts[b];
  std::vector<std::int32_t> costs(grid.count());
  const auto columns = static_cast<std::size_t>(grid.columns), rows = static_cast<std::size_t>(grid.rows);
  const auto mean_at = [&](std::size_t column, std::size_t row) {
    const std::size_t b = row * columns + column;
    std::int32_t sum = 2 * own[b], weight = 2;
    if (column > 0) sum += own[b - 1], ++weight;
    if (row > 0) sum += own[b - columns], ++weight;
    if (column + 1 < columns) sum += own[b + 1], ++weight;
    if (row + 1 < rows) sum += own[b + columns], ++weight;
    return sum / weight;
  };
  for (std::size_t row = 0; row < rows; ++row) {
    std::int32_t* const to = costs.data() + row * columns;
    const std::int32_t* const at = own.data() + row * columns;
    if (row == 0 || row + 1 == rows || columns < 2) {
      for (std::size_t column = 0; column < columns; ++column) to[column] = mean_at(column, row);
      continue;
    }
    // Inside there are four neighbours, and division by a constant.
    const std::int32_t *above = at - columns, *below = at + columns;
    for (std::size_t column = 1; column + 1 < columns; ++column) {
      to[column] = (2 * at[column] + at[column - 1] + at[column + 1] + above[column] + below[column]) / 6;
    }
    to[0] = mean_at(0, row);
    to[columns - 1] = mean_at(columns - 1, row);
  }
  return costs;
}

namespace {

using Costs = std::vector<std::int32_t>;

std::int64_t total(const Costs& minimum) {
  std::int64_t sum = 0;
  for (const std::int32_t cost : minimum) sum += cost;
  return sum;
}

Costs minimum_over(const std::vector<Costs>& costs, const std::vector<std::size_t>& chosen) {
  Costs minimum(costs.front().size(), std::numeric_limits<std::int32_t>::max());
  for (const std::size_t m : chosen) {
    for (std::size_t b = 0; b < minimum.size(); ++b) minimum[b] = std::min(minimum[b], costs[m][b]);
  }
  return minimum;
}

std::int64_t total_with(const Costs& minimum, const Costs& candidate) {
  return kernels().sum_of_minima(minimum.data(), candidate.data(),
                                 minimum.size());  // at most the candidate's own
}

// The candidate that lowers the total most when added to `minimum`, and the total with its label.
std::pair<std::int64_t, std::size_t> best_addition(const std::vector<Costs>& costs,
                                                   std::span<const std::int64_t> label_costs,
                                                   const Costs& minimum) {
  std::pair<std::int64_t, std::size_t> best{std::numeric_limits<std::int64_t>::max(), 0};
  for (std::size_t m = 0; m < costs.size(); ++m) {
    const std::int64_t sum = total_with(minimum, costs[m]) + label_costs[m];
    if (sum < best.first) best = {sum, m};
  }
  return best;
}

}  // namespace

Selection select_models(const std::vector<std::vector<std::int32_t>>& costs,
                        std::span<const std::int64_t> label_costs) {
  const auto labels_of = [&](const std::vector<std::size_t>& chosen) {
    std::int64_t sum = 0;
    for (const std::size_t m : chosen) sum += label_costs[m];
    return sum;
  };
  Selection selection;
  auto& chosen = selection.chosen;
  std::int64_t cost = std::numeric_limits<std::int64_t>::max();
  for (bool improved = true; improved;) {
    improved = false;
    while (true) {
      const auto [sum, candidate] = best_addition(costs, label_costs, minimum_over(costs, chosen));
      const std::int64_t with = sum + labels_of(chosen);
      if (!(with < cost)) break;
      chosen.push_back(candidate);
      cost = with;
    }
    // Drops and swaps: take one out, and put the best other in if that is cheaper than going without.
    for (std::size_t i = 0; i < chosen.size() && chosen.size() > 1; ++i) {
      std::vector<std::size_t> rest = chosen;
      rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
      const Costs without = minimum_over(costs, rest);
      const std::int64_t dropped = total(without) + labels_of(rest);
      const auto [sum, candidate] = best_addition(costs, label_costs, without);
      const std::int64_t swapped = sum + labels_of(rest);
      if (std::min(dropped, swapped) < cost) {
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
