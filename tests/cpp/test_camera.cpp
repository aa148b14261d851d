#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "emseg/camera.hpp"

using namespace emseg;

namespace {

const Camera dist_surf{{346, 260}, 289.77, 288.81, 185.98, 132.58, DistortionModel::radtan, {-.3617, .1587}};
const Camera tangential{
    {240, 180}, 199.1, 198.8, 132.2, 110.7, DistortionModel::radtan, {-.3684, .1509, -.003, .002, .01}};
const Camera fisheye{
    {640, 480}, 290, 291, 320, 240, DistortionModel::equidistant, {-.02, .004, -.003, .0005}};

// Whether the lens keeps orientation around a point, by central differences: false past a fold.
bool keeps_orientation(const Camera& camera, Point2 u) {
  const double h = 1e-4;
  const Point2 east = distort_pixel(camera, {u.x + h, u.y}), west = distort_pixel(camera, {u.x - h, u.y});
  const Point2 south = distort_pixel(camera, {u.x, u.y + h}), north = distort_pixel(camera, {u.x, u.y - h});
  return (east.x - west.x) * (south.y - north.y) - (east.y - west.y) * (south.x - north.x) > 0;
}

std::string complaint(const Camera& camera) {
  try {
    check_camera(camera);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("undistortion inverts distortion all over the sensor") {
  for (const Camera& camera : {dist_surf, tangential, fisheye}) {
    double worst = 0;
    bool oriented = true;
    for (int y = 0; y < camera.size.height; y += 3) {
      for (int x = 0; x < camera.size.width; x += 3) {
        const Point2 undistorted = undistort_pixel(camera, {double(x), double(y)});
        const Point2 back = distort_pixel(camera, undistorted);
        worst = std::max(worst, std::hypot(back.x - x, back.y - y));
        oriented = oriented && keeps_orientation(camera, undistorted);
      }
    }
    CHECK(worst < 1e-9);
    CHECK(oriented);
  }
}

TEST_CASE("the table holds every pixel's undistorted position, row by row") {
  const UndistortionTable table = make_undistortion_table(tangential);
  REQUIRE(table.x.size() == 240u * 180u);
  REQUIRE(table.y.size() == 240u * 180u);
  const Point2 expected = undistort_pixel(tangential, {17, 170});
  CHECK(table.x[170 * 240 + 17] == static_cast<float>(expected.x));
  CHECK(table.y[170 * 240 + 17] == static_cast<float>(expected.y));
}

TEST_CASE("every pixel of a table is the inverse of the distortion, as one alone is") {
  // Weak and strong lenses, and some of few rows or columns.
  const std::array<double, 5> barrel{-0.3633, 0.1249, -0.0001, 0, 0}, cushion{0.2, 0.05, 0.01, -0.02, 0.01};
  for (const Camera& camera :
       {tangential, Camera{{346, 260}, 257.68, 257.62, 188.33, 131.59, DistortionModel::radtan, barrel},
        Camera{{160, 120}, 90, 100, 70, 65, DistortionModel::radtan, cushion},
        Camera{{5, 1}, 50, 50, 2, 0, DistortionModel::radtan, barrel},
        Camera{{1, 7}, 50, 50, 0, 3, DistortionModel::radtan, cushion},
        Camera{{64, 48}, 60, 60, 32, 24, DistortionModel::equidistant, {0.01, 0.02, 0, 0, 0}}}) {
    CAPTURE(camera.size.width);
    const UndistortionTable table = make_undistortion_table(camera);
    for (int y = 0; y < camera.size.height; ++y) {
      for (int x = 0; x < camera.size.width; ++x) {
        const Point2 expected = undistort_pixel(camera, {double(x), double(y)});
        const auto pixel = static_cast<std::size_t>(y * camera.size.width + x);
        // What a float holds of a few hundred pixels.
        REQUIRE(std::abs(table.x[pixel] - expected.x) < 4e-5);
        REQUIRE(std::abs(table.y[pixel] - expected.y) < 4e-5);
      }
    }
  }
}

TEST_CASE("no distortion leaves pixels where they are") {
  const Camera pinhole{{3, 2}, 250, 250, 1, 1, DistortionModel::none, {}};
  const UndistortionTable table = make_undistortion_table(pinhole);
  CHECK(table.x == std::vector<float>{0, 1, 2, 0, 1, 2});
  CHECK(table.y == std::vector<float>{0, 0, 0, 1, 1, 1});
  const Point2 anywhere = undistort_pixel(pinhole, {-7.5, 9e9});
  CHECK(anywhere.x == -7.5);
  CHECK(anywhere.y == 9e9);
}

TEST_CASE("the principal point stays without tangential terms") {
  for (const Camera& camera : {dist_surf, fisheye}) {
    const Point2 centre = undistort_pixel(camera, {camera.cx, camera.cy});
    CHECK(centre.x == camera.cx);
    CHECK(centre.y == camera.cy);
  }
}

TEST_CASE("a barrel without its second term folds: inverted up to the fold, refused beyond") {
  // r (1 - r^2 / 3) rises up to r = 1, where it is 2/3.
  Camera camera{{100, 1}, 100, 100, 0, 0, DistortionModel::radtan, {-1. / 3}};
  camera.size.width = 67;  // the last pixel is at 66 < 66.67
  check_camera(camera);
  const double r = undistort_pixel(camera, {66, 0}).x / 100;
  CHECK(r < 1);
  CHECK(r * (1 - r * r / 3) == doctest::Approx(.66).epsilon(1e-12));
  camera.size.width = 68;
  CHECK(complaint(camera).find("no inverse at pixel (67.0") != std::string::npos);
  CHECK_THROWS_AS(undistort_pixel(camera, {67, 0}), std::invalid_argument);
  CHECK_THROWS_AS(make_undistortion_table(camera), std::invalid_argument);
}

TEST_CASE("past a fold a polynomial may rise again: that branch is not taken") {
  // 1 - 3 s + 2.5 s^2 (s = r^2) has its folds where 1 - 9 s + 12.5 s^2 = 0; afterwards it rises for ever.
  const Camera camera{{10, 10}, 100, 100, 5, 5, DistortionModel::radtan, {-3, 2.5}};
  check_camera(camera);
  const double fold = std::sqrt((9 - std::sqrt(81 - 50)) / 25);
  const double r = undistort_pixel(camera, {5 + 20, 5}).x / 100 - .05;
  CHECK(r < fold);
  CHECK(r * (1 - 3 * r * r + 2.5 * r * r * r * r) == doctest::Approx(.2).epsilon(1e-12));
  CHECK_THROWS_AS(undistort_pixel(camera, {5 + 100, 5}), std::invalid_argument);
}

TEST_CASE("a fisheye ray at 90 degrees or more has no place on a plane") {
  const Camera camera{{320, 1}, 100, 100, 0, 0, DistortionModel::equidistant, {}};
  CHECK(undistort_pixel(camera, {100, 0}).x == doctest::Approx(100 * std::tan(1.)).epsilon(1e-12));
  CHECK(std::isfinite(undistort_pixel(camera, {157, 0}).x));
  CHECK_THROWS_AS(undistort_pixel(camera, {158, 0}), std::invalid_argument);
  CHECK(complaint(camera).find("no inverse") != std::string::npos);
}

TEST_CASE("numbers that make no camera are named") {
  Camera camera = dist_surf;
  CHECK(complaint(camera) == "");
  SUBCASE("size") {
    camera.size.height = 0;
    CHECK(complaint(camera).find("size is 346x0") != std::string::npos);
  }
  SUBCASE("focal length") {
    camera.fx = 0;
    CHECK(complaint(camera).find("fx is 0") != std::string::npos);
  }
  SUBCASE("principal point") {
    camera.cy = std::numeric_limits<double>::quiet_NaN();
    CHECK(complaint(camera).find("cy is nan") != std::string::npos);
  }
  SUBCASE("coefficient") {
    camera.distortion[4] = std::numeric_limits<double>::infinity();
    CHECK(complaint(camera).find("coefficient is inf") != std::string::npos);
  }
}
