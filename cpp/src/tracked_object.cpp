#include "emseg/tracked_object.hpp"

#include <algorithm>

#include "emseg/iwe.hpp"

namespace emseg {
namespace {

constexpr int cell = 4;  // px

// The cells of a canvas: which of them an object is expected in.
class ExpectedCells {
 public:
  explicit ExpectedCells(Region canvas)
      : canvas_(canvas),
        columns_(canvas.width / cell + 1),
        rows_(canvas.height / cell + 1),
        expected_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_), 0) {}

  // The cell of a place and those about it.
  void expect(float x, float y) {
    if (!inside(x, y)) return;
    const int column = at(x, canvas_.x0), row = at(y, canvas_.y0);
    for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r) {
      for (int c = std::max(0, column - 1); c <= std::min(columns_ - 1, column + 1); ++c) {
        expected_[index(c, r)] = 1;
      }
    }
  }

  std::uint8_t expected(float x, float y) const {
    return inside(x, y) ? expected_[index(at(x, canvas_.x0), at(y, canvas_.y0))] : std::uint8_t{0};
  }

 private:
  bool inside(float x, float y) const {
    const auto left = static_cast<float>(canvas_.x0), top = static_cast<float>(canvas_.y0);
    return x >= left && x < left + static_cast<float>(canvas_.width) && y >= top &&
           y < top + static_cast<float>(canvas_.height);
  }
  static int at(float place, int first) { return static_cast<int>(place - static_cast<float>(first)) / cell; }
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  Region canvas_;
  int columns_, rows_;
  std::vector<std::uint8_t> expected_;
};

}  // namespace

std::vector<std::uint8_t> where_expected(const PointView& points, const TrackedObject& object,
                                         const WarpFrame& frame, Region plane) {
  if (object.places.empty()) return {};
  Points then;
  for (const Vec2f place : object.places) {
    then.x.push_back(place.x);
    then.y.push_back(place.y);
    then.dt.push_back(static_cast<float>(object.seen));
  }
  std::vector<float> x(then.size()), y(then.size());
  warp_points(then.view(), object.model, frame, x, y);
  ExpectedCells cells(canvas_of(plane));
  for (std::size_t i = 0; i < then.size(); ++i) cells.expect(x[i], y[i]);

  x.resize(points.size());
  y.resize(points.size());
  warp_points(points, object.model, frame, x, y);
  std::vector<std::uint8_t> expected(points.size());
  for (std::size_t k = 0; k < points.size(); ++k) expected[k] = cells.expected(x[k], y[k]);
  return expected;
}

}  // namespace emseg
