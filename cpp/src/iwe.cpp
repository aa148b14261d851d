#include "emseg/iwe.hpp"

#include <array>
#include <cassert>

#include "iwe_rows.hpp"

namespace emseg {

void vote_warped(VoteGrid& grid, const PointView& points, const WarpField& field, VotePlaces& places,
                 Places wanted) {
  // A chunk at a time, so that warped places stay in the first-level cache.
  constexpr std::size_t chunk = 512;
  std::array<float, chunk> x, y;
  places.resize(wanted == Places::kept ? points.size() : chunk);
  for (std::size_t first = 0; first < points.size(); first += chunk) {
    const std::size_t count = std::min(chunk, points.size() - first);
    kernels().warp(field, points.x.data() + first, points.y.data() + first, points.dt.data() + first, count,
                   x.data(), y.data());
    const auto sign = points.sign.empty() ? points.sign : points.sign.subspan(first, count);
    grid.vote({x.data(), count}, {y.data(), count}, sign, places, wanted == Places::kept ? first : 0);
  }
}

void make_iwe(Image& image, const PointView& points, const MotionModel& model, const WarpFrame& frame,
              std::span<const float> taps, IweWorkspace& workspace) {
  VoteGrid& grid = workspace.grid;
  grid.reset(image.region);
  vote_warped(grid, points, warp_field(model, frame), workspace.places, Places::forgotten);
  image.reset(image.region);
  if (image.region.area() == 0) return;
  const auto nothing = [](int, float*) {};
  if (taps.size() == 1) {
    const Region voted = grid.voted();
    for (int y = voted.y0; y < voted.y0 + voted.height; ++y) grid.take_row(y, image.row(y) + voted.x0);
  } else {
    const Region area = blurred_area(grid.voted(), image.region, taps);
    take_blurred(grid, area, taps, workspace.blur, [&](int y) { return image.row(y) + area.x0; }, nothing);
  }
}

float sample_iwe(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region canvas,
                 std::span<const float> taps, IweWorkspace& workspace, std::span<float> values) {
  assert(values.size() == points.size());
  workspace.x.resize(points.size());
  workspace.y.resize(points.size());
  warp_points(points, model, frame, workspace.x, workspace.y);
  const Region region = bounding_region(workspace.x, workspace.y, 0, canvas);
  VoteGrid& grid = workspace.grid;
  grid.reset(region);
  workspace.places.resize(points.size());
  grid.vote(workspace.x, workspace.y, points.sign, workspace.places);
  float* const cells = grid.cells_without_border(workspace.cells);
  const Region area = blurred_area(grid.voted(), region, taps);
  float peak = 0;
  take_blurred(
      grid, area, taps, workspace.blur, [&](int y) { return cells + grid.cell_of(area.x0, y); },
      [&](int, const float* row) {
        peak = std::max(peak, kernels().largest_magnitude(row, static_cast<std::size_t>(area.width)));
      });
  sample_values(cells, grid.stride(), workspace.places, values);
  for (std::size_t k = 0; k < points.sign.size(); ++k) values[k] = std::max(0.0f, points.sign[k] * values[k]);
  return peak;
}

Region image_plane(ImageSize size, const UndistortionTable* table) {
  if (!table) return sensor_region(size);
  const auto [left, right] = std::minmax_element(table->x.begin(), table->x.end());
  const auto [top, bottom] = std::minmax_element(table->y.begin(), table->y.end());
  const int x0 = static_cast<int>(std::floor(*left));
  const int y0 = static_cast<int>(std::floor(*top));
  return {x0, y0, static_cast<int>(std::ceil(*right)) - x0 + 1,
          static_cast<int>(std::ceil(*bottom)) - y0 + 1};
}

Region bounding_region(std::span<const float> x, std::span<const float> y, int margin, Region limit) {
  if (x.empty() || limit.area() == 0) return {limit.x0, limit.y0, 0, 0};
  // A bilinear vote touches floor(x) and the pixel after it.
  const auto range = [margin](std::span<const float> values, int first, int last, int& begin, int& length) {
    float low = static_cast<float>(last), high = static_cast<float>(first);
    kernels().widen(values.data(), values.size(), &low, &high);
    const auto clamped = [&](float value) {
      return std::clamp(value, static_cast<float>(first), static_cast<float>(last));
    };
    begin = std::max(first, static_cast<int>(std::floor(clamped(low))) - margin);
    const int end = std::min(last, static_cast<int>(std::floor(clamped(high))) + 1 + margin);
    length = std::max(0, end - begin + 1);
  };
  Region region;
  range(x, limit.x0, limit.x0 + limit.width - 1, region.x0, region.width);
  range(y, limit.y0, limit.y0 + limit.height - 1, region.y0, region.height);
  return region;
}

}  // namespace emseg
