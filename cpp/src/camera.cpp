#include "emseg/camera.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

namespace emseg {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Value of c0 + c1 s + c2 s^2 + ...
double polynomial(std::span<const double> coefficients, double s) {
  double value = 0;
  for (std::size_t k = coefficients.size(); k-- > 0;) value = value * s + coefficients[k];
  return value;
}

// All sign changes of a polynomial on (0, upper], in order.  Between two critical points a polynomial is
// monotone, so each piece holds one root at most and bisection finds it.
std::vector<double> positive_roots(std::span<const double> coefficients, double upper) {
  if (coefficients.size() < 2) return {};
  std::vector<double> derivative;
  for (std::size_t k = 1; k < coefficients.size(); ++k) {
    derivative.push_back(static_cast<double>(k) * coefficients[k]);
  }
  std::vector<double> ends = positive_roots(derivative, upper);
  ends.push_back(upper);
  std::vector<double> roots;
  double low = 0;
  for (const double end : ends) {
    const bool rises = polynomial(coefficients, low) <= 0;
    double inside = low, outside = end;
    if ((polynomial(coefficients, outside) > 0) == rises) {
      for (double middle = (inside + outside) / 2; middle > inside && middle < outside;
           middle = (inside + outside) / 2) {
        ((polynomial(coefficients, middle) > 0) == rises ? outside : inside) = middle;
      }
      roots.push_back(outside);
    }
    low = end;
  }
  return roots;
}

// The radial part of a distortion: distorted over undistorted angle (equidistant) or radius (radtan), an odd
// polynomial r (c0 + c1 r^2 + c2 r^4 + ...) that rises from zero up to its first fold.
class RadialProfile {
 public:
  explicit RadialProfile(const Camera& camera) {
    const auto& d = camera.distortion;
    double natural_limit = infinity;
    if (camera.model == DistortionModel::radtan) coefficients_ = {1, d[0], d[1], d[4], 0};
    if (camera.model == DistortionModel::equidistant) {
      coefficients_ = {1, d[0], d[1], d[2], d[3]};
      natural_limit = std::numbers::pi / 2;
    }
    std::array<double, 5> slope{};
    for (std::size_t k = 0; k < slope.size(); ++k) {
      slope[k] = static_cast<double>(2 * k + 1) * coefficients_[k];
    }
    limit_ = std::min(natural_limit, first_fold(slope));
  }

  // End of the branch through the centre: the profile is invertible on [0, limit).
  double limit() const { return limit_; }

  double value(double r) const { return r * polynomial(coefficients_, r * r); }

  // The r in [0, limit) of this value, or infinity where there is none.  Newton's method inside a bracket.
  double invert(double target) const {
    double low = 0, high = limit_;
    if (std::isinf(high)) {
      for (high = 1; value(high) < target;) high *= 2;
    } else if (value(high) <= target) {
      return infinity;
    }
    double r = std::min(target, high);
    for (int iteration = 0; iteration < 100; ++iteration) {
      const double error = value(r) - target;
      if (std::abs(error) <= 1e-15 * target) break;
      (error > 0 ? high : low) = r;
      const double newton = r - error / slope_at(r);
      const double next = newton > low && newton < high ? newton : (low + high) / 2;
      if (next == r) break;
      r = next;
    }
    return r;
  }

 private:
  static double first_fold(std::span<const double> slope) {
    while (slope.size() > 1 && slope.back() == 0) slope = slope.first(slope.size() - 1);
    double largest = 0;
    for (const double c : slope) largest = std::max(largest, std::abs(c / slope.back()));
    const double root_bound = 1 + largest;  // Cauchy
    const std::vector<double> roots = positive_roots(slope, root_bound);
    return roots.empty() ? infinity : std::sqrt(roots.front());
  }

  double slope_at(double r) const {
    const double s = r * r;
    const auto& c = coefficients_;
    return c[0] + s * (3 * c[1] + s * (5 * c[2] + s * (7 * c[3] + s * 9 * c[4])));
  }

  std::array<double, 5> coefficients_{1, 0, 0, 0, 0};
  double limit_ = infinity;
};

struct Jacobian {
  double xx, xy, yx, yy;
};

// Brown-Conrady distortion of a point on the plane at unit depth, and its derivative.
inline Point2 distort_radtan(const Camera& camera, Point2 u, Jacobian* jacobian = nullptr) {
  const auto& [k1, k2, p1, p2, k3] = camera.distortion;
  const double r2 = u.x * u.x + u.y * u.y;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (jacobian != nullptr) {
    const double radial_slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d r2, times 2
    const double mixed = radial_slope * u.x * u.y + 2 * p1 * u.x + 2 * p2 * u.y;
    *jacobian = {radial + radial_slope * u.x * u.x + 2 * p1 * u.y + 6 * p2 * u.x, mixed, mixed,
                 radial + radial_slope * u.y * u.y + 6 * p1 * u.y + 2 * p2 * u.x};
  }
  return {u.x * radial + 2 * p1 * u.x * u.y + p2 * (r2 + 2 * u.x * u.x),
          u.y * radial + p1 * (r2 + 2 * u.y * u.y) + 2 * p2 * u.x * u.y};
}

Point2 distort_equidistant(const RadialProfile& profile, Point2 u) {
  const double r = std::hypot(u.x, u.y);
  if (r == 0) return u;
  const double scale = profile.value(std::atan(r)) / r;
  return {u.x * scale, u.y * scale};
}

Point2 to_plane(const Camera& camera, Point2 pixel) {
  return {(pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy};
}

Point2 to_pixel(const Camera& camera, Point2 plane) {
  return {camera.fx * plane.x + camera.cx, camera.fy * plane.y + camera.cy};
}

[[noreturn]] void throw_not_invertible(Point2 pixel) {
  throw std::invalid_argument("the lens distortion has no inverse at pixel (" + std::to_string(pixel.x) +
                              ", " + std::to_string(pixel.y) +
                              "), expected coefficients that are invertible all over the sensor");
}

// The point on the plane that radtan distortion moves to `target`, by Newton's method from `u`; none where it
// ends nowhere.
std::optional<Point2> solve_radtan(const Camera& camera, const RadialProfile& profile, Point2 target,
                                   Point2 u) {
  const double tolerance = 1e-10 / std::max(camera.fx, camera.fy);  // 1e-10 px
  const double inside = 0.999999 * profile.limit();
  for (int iteration = 0; iteration < 50; ++iteration) {
    Jacobian j;
    const Point2 d = distort_radtan(camera, u, &j);
    const double ex = target.x - d.x, ey = target.y - d.y;
    const double determinant = j.xx * j.yy - j.xy * j.yx;
    if (!(determinant > 0)) break;  // past a fold: no solution there is what the lens shows
    const double step_x = (j.yy * ex - j.xy * ey) / determinant;
    const double step_y = (j.xx * ey - j.yx * ex) / determinant;
    if (step_x * step_x + step_y * step_y <= tolerance * tolerance) return u;
    u = {u.x + step_x, u.y + step_y};
    if (u.x * u.x + u.y * u.y > inside * inside) {
      const double excess = std::hypot(u.x, u.y) / inside;
      u = {u.x / excess, u.y / excess};
    }
  }
  return std::nullopt;
}

// Starts from the inverse of the radial part; tangential terms are small, so that few steps follow.
Point2 undistort_radtan(const Camera& camera, const RadialProfile& profile, Point2 distorted_pixel) {
  const Point2 target = to_plane(camera, distorted_pixel);
  const double r_distorted = std::hypot(target.x, target.y);
  if (r_distorted == 0 && camera.distortion[2] == 0 && camera.distortion[3] == 0) return distorted_pixel;
  // Beyond the value at the radial fold a tangential term may still reach the point: start just inside.
  const double r = std::min(profile.invert(r_distorted), 0.999 * profile.limit());
  const double scale = r_distorted > 0 ? r / r_distorted : 0;
  const auto u = solve_radtan(camera, profile, target, {target.x * scale, target.y * scale});
  if (!u) throw_not_invertible(distorted_pixel);
  return to_pixel(camera, *u);
}

Point2 undistort_equidistant(const Camera& camera, const RadialProfile& profile, Point2 distorted_pixel) {
  const Point2 target = to_plane(camera, distorted_pixel);
  const double angle_distorted = std::hypot(target.x, target.y);
  if (angle_distorted == 0) return distorted_pixel;
  const double angle = profile.invert(angle_distorted);
  if (std::isinf(angle)) throw_not_invertible(distorted_pixel);
  const double scale = std::tan(angle) / angle_distorted;
  return to_pixel(camera, {target.x * scale, target.y * scale});
}

Point2 undistort(const Camera& camera, const RadialProfile& profile, Point2 distorted) {
  switch (camera.model) {
    case DistortionModel::radtan:
      return undistort_radtan(camera, profile, distorted);
    case DistortionModel::equidistant:
      return undistort_equidistant(camera, profile, distorted);
    case DistortionModel::none:
      break;
  }
  return distorted;
}

void check_number(const char* name, double value, bool valid, const char* expectation) {
  if (!valid) {
    throw std::invalid_argument("camera: " + std::string(name) + " is " + std::to_string(value) +
                                ", expected " + expectation);
  }
}

}  // namespace

void check_camera(const Camera& camera) {
  const auto [width, height] = camera.size;
  if (width <= 0 || height <= 0 || width > 65536 || height > 65536) {
    throw std::invalid_argument("camera: size is " + std::to_string(width) + "x" + std::to_string(height) +
                                ", expected 1..65536 each way");
  }
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  check_number("fx", camera.fx, positive(camera.fx), "a positive number of pixels");
  check_number("fy", camera.fy, positive(camera.fy), "a positive number of pixels");
  check_number("cx", camera.cx, std::isfinite(camera.cx), "a finite number of pixels");
  check_number("cy", camera.cy, std::isfinite(camera.cy), "a finite number of pixels");
  for (const double coefficient : camera.distortion) {
    check_number("distortion coefficient", coefficient, std::isfinite(coefficient), "a finite number");
  }
  if (camera.model == DistortionModel::none) return;
  // Distortions grow outwards: what is invertible all along the border is invertible inside.
  const RadialProfile profile(camera);
  for (int x = 0; x < width; ++x) {
    for (const int y : {0, height - 1}) undistort(camera, profile, {double(x), double(y)});
  }
  for (int y = 0; y < height; ++y) {
    for (const int x : {0, width - 1}) undistort(camera, profile, {double(x), double(y)});
  }
}

Point2 distort_pixel(const Camera& camera, Point2 undistorted) {
  const Point2 u = to_plane(camera, undistorted);
  switch (camera.model) {
    case DistortionModel::radtan:
      return to_pixel(camera, distort_radtan(camera, u));
    case DistortionModel::equidistant:
      return to_pixel(camera, distort_equidistant(RadialProfile(camera), u));
    case DistortionModel::none:
      break;
  }
  return undistorted;
}

Point2 undistort_pixel(const Camera& camera, Point2 distorted) {
  return undistort(camera, RadialProfile(camera), distorted);
}

namespace {

// Rows of what a camera's pixels come from, on the plane, for radtan distortion.
class RadtanRows {
 public:
  RadtanRows(const Camera& camera, const RadialProfile& profile)
      : camera_(camera),
        profile_(profile),
        rows_(4, std::vector<Point2>(static_cast<std::size_t>(camera.size.width))),
        steps_(rows_[0].size()) {
    for (int x = 0; x < camera.size.width; ++x) target_x_.push_back(to_plane(camera, {double(x), 0}).x);
  }

  // Row y, after row y - 1.  Valid until the next.
  const std::vector<Point2>& next(int y) {
    std::rotate(rows_.begin(), rows_.end() - 1, rows_.end());
    std::vector<Point2>& row = rows_[0];
    if (y < 3) {
      for (std::size_t x = 0; x < row.size(); ++x) row[x] = from_scratch(x, y);
      return row;
    }
    // Where the last three rows lead, by a parabola, Newton's method is a step away; the second shows that it was the last.
    // All pixels alike, so that one need not wait for another.
    const double target_y = to_plane(camera_, {0, double(y)}).y;
    const std::vector<Point2>&a = rows_[1], &b = rows_[2], &c = rows_[3];
    for (std::size_t x = 0; x < row.size(); ++x) {
      const Point2 guess{3 * (a[x].x - b[x].x) + c[x].x, 3 * (a[x].y - b[x].y) + c[x].y};
      const Point2 target{target_x_[x], target_y};
      const Point2 once = step(target, guess);
      row[x] = step(target, once);
      const double dx = row[x].x - once.x, dy = row[x].y - once.y;
      steps_[x] = dx * dx + dy * dy;
    }
    const double tolerance = 1e-10 / std::max(camera_.fx, camera_.fy);
    const double inside = 0.999 * profile_.limit();
    for (std::size_t x = 0; x < row.size(); ++x) {
      const bool found = steps_[x] <= tolerance * tolerance &&  // not NaN
                         row[x].x * row[x].x + row[x].y * row[x].y < inside * inside;
      if (!found) row[x] = from_scratch(x, y);
    }
    return row;
  }

 private:
  Point2 from_scratch(std::size_t x, int y) const {
    return to_plane(camera_, undistort(camera_, profile_, {double(x), double(y)}));
  }

  // One of Newton's method.  Past a fold nowhere.
  Point2 step(Point2 target, Point2 u) const {
    Jacobian j;
    const Point2 d = distort_radtan(camera_, u, &j);
    const double ex = target.x - d.x, ey = target.y - d.y;
    const double determinant = j.xx * j.yy - j.xy * j.yx;
    const double inverse = determinant > 0 ? 1 / determinant : std::numeric_limits<double>::quiet_NaN();
    return {u.x + (j.yy * ex - j.xy * ey) * inverse, u.y + (j.xx * ey - j.yx * ex) * inverse};
  }

  const Camera& camera_;
  const RadialProfile& profile_;
  std::vector<std::vector<Point2>> rows_;  // the last four, the latest first
  std::vector<double> target_x_;           // of every column
  std::vector<double> steps_;              // the squares of the last steps
};

}  // namespace

UndistortionTable make_undistortion_table(const Camera& camera) {
  check_camera(camera);
  const RadialProfile profile(camera);
  UndistortionTable table{camera.size, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(camera.size.width) * camera.size.height;
  table.x.resize(pixels);
  table.y.resize(pixels);
  std::size_t pixel = 0;
  const auto add = [&](Point2 undistorted) {
    table.x[pixel] = static_cast<float>(undistorted.x);
    table.y[pixel++] = static_cast<float>(undistorted.y);
  };
  if (camera.model == DistortionModel::radtan) {
    RadtanRows rows(camera, profile);
    for (int y = 0; y < camera.size.height; ++y) {
      for (const Point2 u : rows.next(y)) add(to_pixel(camera, u));
    }
    return table;
  }
  for (int y = 0; y < camera.size.height; ++y) {
    for (int x = 0; x < camera.size.width; ++x) add(undistort(camera, profile, {double(x), double(y)}));
  }
  return table;
}

}  // namespace emseg
