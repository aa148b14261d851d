#include "emseg/edge_directions.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace emseg {
namespace {

constexpr int margin = 2;  // px around the plane, for blur and gradients

// Gradients are central differences of images blurred by (1 2 1)/4 each way.  A single event makes this much
// of their products xx, and of yy.
constexpr double single_event = [] {
  constexpr double blur[] = {0, 0, 0.25, 0.5, 0.25, 0, 0};
  double sum = 0;
  for (int x = 1; x < 6; ++x) {
    for (int y = 1; y < 6; ++y) {
      const double gradient = (blur[x + 1] - blur[x - 1]) / 2 * blur[y];
      sum += gradient * gradient;
    }
  }
  return sum;
}();

// The signed image of some events, with its margin, and the sums of products of its gradients by block.
class SliceImage {
 public:
  explicit SliceImage(const BlockGrid& grid)
      : grid_(grid),
        width_(grid.plane.width + 2 * margin),
        height_(grid.plane.height + 2 * margin),
        votes_(area(), 0.0f),
        across_(area(), 0.0f),
        blurred_(area(), 0.0f) {}

  void clear() { std::fill(votes_.begin(), votes_.end(), 0.0f); }

  void vote(float x, float y, float sign) {
    const int column = static_cast<int>(std::floor(x + 0.5f)) - grid_.plane.x0;
    const int row = static_cast<int>(std::floor(y + 0.5f)) - grid_.plane.y0;
    if (column < 0 || row < 0 || column >= grid_.plane.width || row >= grid_.plane.height) return;
    votes_[at(row + margin) + static_cast<std::size_t>(column + margin)] += sign;
  }

  void add_products(std::vector<StructureTensor>& tensors) {
    const auto width = static_cast<std::size_t>(width_);
    for (int row = 0; row < height_; ++row) {
      const float* from = votes_.data() + at(row);
      float* to = across_.data() + at(row);
      for (std::size_t x = 1; x + 1 < width; ++x) to[x] = from[x - 1] + 2 * from[x] + from[x + 1];
    }
    for (int row = 1; row + 1 < height_; ++row) {
      const float* from = across_.data() + at(row);
      float* to = blurred_.data() + at(row);
      for (std::size_t x = 1; x + 1 < width; ++x) to[x] = from[x - width] + 2 * from[x] + from[x + width];
    }
    // Blur left out a factor of 16, differences one of 2.
    constexpr double scale = 1.0 / (32.0 * 32.0);
    for (int row = 0; row < grid_.plane.height; ++row) {
      const float* from = blurred_.data() + at(row + margin) + margin;
      StructureTensor* to = tensors.data() + static_cast<std::size_t>(row / grid_.block * grid_.columns);
      for (int first = 0; first < grid_.plane.width; first += grid_.block, ++to) {
        const int last = std::min(first + grid_.block, grid_.plane.width);
        float xx = 0, xy = 0, yy = 0;
        for (int x = first; x < last; ++x) {
          const float gx = from[x + 1] - from[x - 1], gy = from[x + width_] - from[x - width_];
          xx += gx * gx;
          xy += gx * gy;
          yy += gy * gy;
        }
        to->xx += scale * double{xx};
        to->xy += scale * double{xy};
        to->yy += scale * double{yy};
      }
    }
  }

 private:
  std::size_t area() const { return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_); }
  std::size_t at(int row) const { return static_cast<std::size_t>(row) * static_cast<std::size_t>(width_); }

  const BlockGrid& grid_;
  const int width_;
  const int height_;
  std::vector<float> votes_;
  std::vector<float> across_;   // blurred along the rows
  std::vector<float> blurred_;  // and down the columns
};

}  // namespace

void StructureTensor::add(const StructureTensor& other) {
  xx += other.xx;
  xy += other.xy;
  yy += other.yy;
  single += other.single;
}

std::vector<StructureTensor> structure_tensors(const PointView& points, const BlockGrid& grid, int slices) {
  assert(grid.of_event.size() == points.size() && slices > 0);
  std::vector<StructureTensor> tensors(grid.count());
  if (points.size() == 0) return tensors;
  SliceImage image(grid);
  std::size_t k = 0;
  for (int slice = 1; slice <= slices; ++slice) {
    const double end = double{points.dt.front()} + points.seconds() * slice / slices;
    image.clear();
    for (; k < points.size() && (slice == slices || double{points.dt[k]} < end); ++k)
      image.vote(points.x[k], points.y[k], points.sign.empty() ? 1.0f : points.sign[k]);
    image.add_products(tensors);
  }
  for (std::size_t b = 0; b < tensors.size(); ++b) {
    tensors[b].single = single_event * grid.event_count[b];
    tensors[b].xx -= tensors[b].single;
    tensors[b].yy -= tensors[b].single;
  }
  return tensors;
}

std::vector<EdgeDirection> edge_directions(const std::vector<StructureTensor>& tensors, const BlockGrid& grid,
                                           double plain) {
  constexpr double round = 0.25;  // ratio of the tensor's eigenvalues from which on edges are not straight
  constexpr double least = 10;    // events
  assert(tensors.size() == grid.count());
  std::vector<EdgeDirection> directions(tensors.size());
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) {
      StructureTensor near;
      for (int r = std::max(0, row - 1); r <= std::min(grid.rows - 1, row + 1); ++r) {
        for (int c = std::max(0, column - 1); c <= std::min(grid.columns - 1, column + 1); ++c)
          near.add(tensors[static_cast<std::size_t>(r * grid.columns + c)]);
      }
      const double mean = (near.xx + near.yy) / 2;
      const double apart = std::hypot((near.xx - near.yy) / 2, near.xy);
      if (mean + apart <= plain * near.single || near.single < least * single_event) continue;
      const double straight = std::max(0.0, 1 - std::max(0.0, mean - apart) / (mean + apart) / round);
      const double across = 0.5 * std::atan2(2 * near.xy, near.xx - near.yy);
      directions[static_cast<std::size_t>(row * grid.columns + column)] = {
          static_cast<float>(-std::sin(across) * straight), static_cast<float>(std::cos(across) * straight)};
    }
  }
  return directions;
}

}  // namespace emseg
