#include "emseg/split_apart.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

namespace emseg {
namespace {

// Cells that are this far from the origin hold all that is further out: no grid is larger than memory allows,
// and no sensor reaches as far.
constexpr int outermost_cell = 4096;

struct Cell {
  int column = 0;
  int row = 0;
};

Cell cell_of(Vec2f place, float gap) {
  const auto clamped = [](float value) {
    return static_cast<int>(std::clamp(std::floor(value), -float{outermost_cell}, float{outermost_cell}));
  };
  return {clamped(place.x / gap), clamped(place.y / gap)};
}

bool is_finite(Vec2f place) { return std::isfinite(place.x) && std::isfinite(place.y); }

}  // namespace

std::vector<std::int32_t> connected_components(std::span<const std::uint8_t> occupied, int columns) {
  assert(columns > 0 || occupied.empty());
  std::vector<std::int32_t> components(occupied.size(), -1);
  if (occupied.empty()) return components;
  const int rows = static_cast<int>(occupied.size()) / columns;
  std::int32_t count = 0;
  std::vector<Cell> reached;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const auto index = [&](Cell at) { return static_cast<std::size_t>(at.row * columns + at.column); };
      if (!occupied[index({column, row})] || components[index({column, row})] >= 0) continue;
      components[index({column, row})] = count;
      reached.assign(1, {column, row});
      while (!reached.empty()) {
        const Cell from = reached.back();
        reached.pop_back();
        for (int y = std::max(0, from.row - 1); y <= std::min(rows - 1, from.row + 1); ++y) {
          for (int x = std::max(0, from.column - 1); x <= std::min(columns - 1, from.column + 1); ++x) {
            if (!occupied[index({x, y})] || components[index({x, y})] >= 0) continue;
            components[index({x, y})] = count;
            reached.push_back({x, y});
          }
        }
      }
      ++count;
    }
  }
  return components;
}

std::vector<std::int32_t> split_apart(std::span<const Vec2f> places, int gap) {
  if (gap <= 0) throw std::invalid_argument("gap is " + std::to_string(gap) + " px, expected above 0");
  std::vector<Cell> cells(places.size());
  Cell least{outermost_cell + 1, outermost_cell + 1}, most{-outermost_cell - 1, -outermost_cell - 1};
  for (std::size_t k = 0; k < places.size(); ++k) {
    if (!is_finite(places[k])) continue;
    cells[k] = cell_of(places[k], static_cast<float>(gap));
    least = {std::min(least.column, cells[k].column), std::min(least.row, cells[k].row)};
    most = {std::max(most.column, cells[k].column), std::max(most.row, cells[k].row)};
  }
  std::vector<std::int32_t> parts(places.size(), -1);
  if (least.column > most.column) return parts;

  // Column by column, so that of parts of one size the one further left comes first.
  const int height = most.row - least.row + 1;
  const auto index = [&](Cell cell) {
    return static_cast<std::size_t>((cell.column - least.column) * height + cell.row - least.row);
  };
  std::vector<std::uint8_t> occupied(index(most) + 1, 0);
  for (std::size_t k = 0; k < places.size(); ++k) {
    if (is_finite(places[k])) occupied[index(cells[k])] = 1;
  }
  const std::vector<std::int32_t> component = connected_components(occupied, height);
  std::vector<std::int64_t> sizes;
  for (std::size_t k = 0; k < places.size(); ++k) {
    if (!is_finite(places[k])) continue;
    parts[k] = component[index(cells[k])];
    const auto own = static_cast<std::size_t>(parts[k]);
    if (own >= sizes.size()) sizes.resize(own + 1, 0);
    ++sizes[own];
  }

  const auto largest = static_cast<double>(*std::max_element(sizes.begin(), sizes.end()));
  const double enough = std::min(std::max(30.0, largest / 25), largest);
  std::vector<std::size_t> order(sizes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return sizes[a] > sizes[b]; });
  std::vector<std::int32_t> rank(sizes.size(), -1);
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (static_cast<double>(sizes[order[i]]) >= enough) rank[order[i]] = static_cast<std::int32_t>(i);
  }
  for (std::int32_t& part : parts) {
    if (part >= 0) part = rank[static_cast<std::size_t>(part)];
  }
  return parts;
}

std::vector<std::vector<std::int64_t>> positions_of_values(std::span<const std::int32_t> values,
                                                           std::int32_t count) {
  assert(count >= 0);
  const auto counts = [&](std::int32_t value) { return value >= 0 && value < count; };
  std::vector<std::size_t> sizes(static_cast<std::size_t>(count), 0);
  for (const std::int32_t value : values) {
    if (counts(value)) ++sizes[static_cast<std::size_t>(value)];
  }
  std::vector<std::vector<std::int64_t>> positions(sizes.size());
  for (std::size_t v = 0; v < sizes.size(); ++v) positions[v].reserve(sizes[v]);
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (counts(values[k])) positions[static_cast<std::size_t>(values[k])].push_back(std::int64_t(k));
  }
  return positions;
}

}  // namespace emseg
