// Images of warped events (IWE): each event votes, bilinearly, at its place at t_ref.
#pragma once

#include "emseg/image.hpp"
#include "emseg/motion_model.hpp"
#include "emseg/vote_grid.hpp"

namespace emseg {

// Adds `weight` at (x, y), shared bilinearly among the four pixels around it; shares outside the image are
// lost.
inline void bilinear_vote(Image& image, float x, float y, float weight = 1.0f) {
  const int width = image.region.width;
  const int height = image.region.height;
  const float u = x - static_cast<float>(image.region.x0);
  const float v = y - static_cast<float>(image.region.y0);
  // Also false for NaN, so that the conversion to int is always defined.
  if (!(u > -1 && v > -1 && u < static_cast<float>(width) && v < static_cast<float>(height))) return;
  const int i = static_cast<int>(u + 1) - 1;  // floor, for u > -1
  const int j = static_cast<int>(v + 1) - 1;
  const float right = u - static_cast<float>(i);
  const float low = v - static_cast<float>(j);
  const float top_weight = weight * (1 - low);
  const float low_weight = weight * low;
  if (i >= 0 && j >= 0 && i + 1 < width && j + 1 < height) {
    float* top = image.row(j) + i;
    float* bottom = top + width;
    top[0] += top_weight * (1 - right);
    top[1] += top_weight * right;
    bottom[0] += low_weight * (1 - right);
    bottom[1] += low_weight * right;
    return;
  }
  for (int dy = 0; dy < 2; ++dy) {
    if (j + dy < 0 || j + dy >= height) continue;
    float* row = image.row(j + dy);
    const float row_weight = dy == 0 ? top_weight : low_weight;
    // u + 1 may round up to a whole number, which puts i on the border itself.
    if (i >= 0 && i < width) row[i] += row_weight * (1 - right);
    if (i + 1 < width) row[i + 1] += row_weight * right;
  }
}

// Value and spatial derivatives of the bilinear interpolation at a point; zero outside the image.
struct BilinearSample {
  float value = 0;
  float dx = 0;
  float dy = 0;
};

inline BilinearSample bilinear_sample(const Image& image, float x, float y) {
  const int width = image.region.width;
  const int height = image.region.height;
  const float u = x - static_cast<float>(image.region.x0);
  const float v = y - static_cast<float>(image.region.y0);
  if (!(u > -1 && v > -1 && u < static_cast<float>(width) && v < static_cast<float>(height))) return {};
  const int i = static_cast<int>(u + 1) - 1;
  const int j = static_cast<int>(v + 1) - 1;
  const float right = u - static_cast<float>(i);
  const float low = v - static_cast<float>(j);
  float a, b, c, d;  // top left, top right, bottom left, bottom right
  if (i >= 0 && j >= 0 && i + 1 < width && j + 1 < height) {
    const float* top = image.row(j) + i;
    a = top[0];
    b = top[1];
    c = top[width];
    d = top[width + 1];
  } else {
    const auto at = [&](int column, int row) {
      return column < 0 || row < 0 || column >= width || row >= height ? 0.0f : image.row(row)[column];
    };
    a = at(i, j);
    b = at(i + 1, j);
    c = at(i, j + 1);
    d = at(i + 1, j + 1);
  }
  const float top = a + right * (b - a);
  const float bottom = c + right * (d - c);
  return {top + low * (bottom - top), (1 - low) * (b - a) + low * (d - c), bottom - top};
}

// The interpolated value alone.
inline float bilinear_value(const Image& image, float x, float y) {
  return bilinear_sample(image, x, y).value;
}

// Scratch of what follows; keeps its memory from one image to the next.
struct IweWorkspace {
  VoteGrid grid;
  VotePlaces places;
  BlurWorkspace blur;
  std::vector<float> x, y;  // warped places
  LineFloats cells;         // the blurred image with a border
};

// The blurred IWE of all points under a model, over image.region.
void make_iwe(Image& image, const PointView& points, const MotionModel& model, const WarpFrame& frame,
              std::span<const float> taps, IweWorkspace& workspace);

// The value of the blurred IWE at each point's own place, without the image: the largest magnitude of its
// pixels is returned.  Votes and values outside `canvas` count as zero.  Points with signs vote theirs and
// see the image by it: where the other sign prevails their value is 0.
float sample_iwe(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region canvas,
                 std::span<const float> taps, IweWorkspace& workspace, std::span<float> values);

// Region of the whole sensor.
inline Region sensor_region(ImageSize size) { return {0, 0, size.width, size.height}; }

// The image plane of a sensor: the smallest region that holds every undistorted pixel, or the sensor itself.
Region image_plane(ImageSize size, const UndistortionTable* table = nullptr);

// Where warped events are followed to: the image plane and half as much again on every side.  Events that
// move out of the sensor's frame keep their votes and find those of their neighbours; what goes further is
// dropped.
inline Region canvas_of(Region plane) { return expanded(plane, plane.width / 2, plane.height / 2); }

// Smallest region that holds the votes of all points at (x, y), `margin` px wider on each side, cut to
// `limit`.
Region bounding_region(std::span<const float> x, std::span<const float> y, int margin, Region limit);

}  // namespace emseg
