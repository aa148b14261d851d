// Camera models: intrinsics, lens distortion, and the table that undistorts every pixel once.
#pragma once

#include <array>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

enum class DistortionModel {
  none,
  radtan,       // k1 k2 p1 p2 [k3]: Brown-Conrady, as OpenCV's first five coefficients
  equidistant,  // k1 k2 k3 k4: Kannala-Brandt, as OpenCV's fisheye module
};

struct Camera {
  ImageSize size;
  double fx = 1, fy = 1;  // focal lengths, px
  double cx = 0, cy = 0;  // principal point, px
  DistortionModel model = DistortionModel::none;
  std::array<double, 5> distortion{};
};

// Throws std::invalid_argument where the size, focal lengths or coefficients make no camera.
void check_camera(const Camera& camera);

struct Point2 {
  double x = 0;
  double y = 0;
};

Point2 distort_pixel(const Camera& camera, Point2 undistorted);
Point2 undistort_pixel(const Camera& camera, Point2 distorted);

// Undistorted position, in pixels of the same intrinsics without distortion, of every sensor pixel.
struct UndistortionTable {
  ImageSize size;
  std::vector<float> x;  // height * width, row by row
  std::vector<float> y;
};

UndistortionTable make_undistortion_table(const Camera& camera);

}  // namespace emseg
