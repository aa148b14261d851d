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

// Pixel centres lie at integer coordinates, as in OpenCV.
struct Camera {
  ImageSize size;
  double fx = 1, fy = 1;  // focal lengths, px
  double cx = 0, cy = 0;  // principal point, px
  DistortionModel model = DistortionModel::none;
  std::array<double, 5> distortion{};
};

struct Point2 {
  double x = 0;
  double y = 0;
};

// Throws std::invalid_argument where the size, focal lengths or coefficients make no camera.  A distortion
// without an inverse somewhere on the sensor makes none: a fold of the polynomial, or a ray 90 degrees or
// more off the axis, would put events at places that no lens shows.
void check_camera(const Camera& camera);

// Where the lens puts a pixel of the undistorted image; the formula is evaluated as it stands, folds
// included.
Point2 distort_pixel(const Camera& camera, Point2 undistorted);

// The inverse of distort_pixel, on the branch that contains the principal point; exact to 1e-9 px.
// Throws std::invalid_argument that names the pixel where the distortion has no inverse.
Point2 undistort_pixel(const Camera& camera, Point2 distorted);

// Undistorted position, in pixels of the same intrinsics without distortion, of every sensor pixel.
struct UndistortionTable {
  ImageSize size;
  std::vector<float> x;  // height * width, row by row
  std::vector<float> y;
};

// Throws as check_camera does.
UndistortionTable make_undistortion_table(const Camera& camera);

}  // namespace emseg
