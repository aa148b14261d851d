#include "emseg/camera.hpp"

#include <algorithm>
#include <array>
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
      : camera_(camera), profile_(profile), steps_(static_cast<std::size_t>(camera.size.width)) {
    for (Row& row : rows_) row = {std::vector<double>(steps_.size()), std::vector<double>(steps_.size())};
    for (int x = 0; x < camera.size.width; ++x) target_x_.push_back(to_plane(camera, {double(x), 0}).x);
  }

  struct Row {
    std::vector<double> x, y;
  };

  // Row y, after row y - 1.  Valid until the next.
  const Row& next(int y) {
    std::rotate(rows_.begin(), rows_.end() - 1, rows_.end());
    Row& row = rows_[0];
    if (y >= 3) go_on(y);
    const double tolerance = 1e-10 / std::max(camera_.fx, camera_.fy);
    const double inside = 0.999 * profile_.limit();
    for (std::size_t x = 0; x < steps_.size(); ++x) {
      const bool found = y >= 3 && steps_[x] <= tolerance * tolerance &&  // not NaN
                         row.x[x] * row.x[x] + row.y[x] * row.y[x] < inside * inside;
      if (found) continue;
      const Point2 u = to_plane(camera_, undistort(camera_, profile_, {double(x), double(y)}));
      row.x[x] = u.x;
      row.y[x] = u.y;
    }
    return row;
  }

 private:
  // Where the last three rows lead, by a parabola, Newton's method is a step away; another, by the same
  // derivatives, shows that it is there.  All pixels alike, so that none waits for its neighbour.
  void go_on(int y) {
    const Camera camera = camera_;  // which nothing that is written here can change
    const double target_y = to_plane(camera, {0, double(y)}).y;
    // Arrays of the function's own, which the compiler knows to be apart.
    constexpr std::size_t chunk = 64;
    std::array<double, chunk> to_x, to_y, steps;
    for (std::size_t first = 0; first < steps_.size(); first += chunk) {
      const std::size_t n = std::min(chunk, steps_.size() - first);
      const double* const target_x = target_x_.data() + first;
      const auto at = [first](const std::vector<double>& row) { return row.data() + first; };
      const double *const ax = at(rows_[1].x), *const ay = at(rows_[1].y);
      const double *const bx = at(rows_[2].x), *const by = at(rows_[2].y);
      const double *const cx = at(rows_[3].x), *const cy = at(rows_[3].y);
      for (std::size_t i = 0; i < n; ++i) {
        const Point2 target{target_x[i], target_y};
        const Point2 guess{3 * (ax[i] - bx[i]) + cx[i], 3 * (ay[i] - by[i]) + cy[i]};
        Jacobian j;
        const Point2 here = distort_radtan(camera, guess, &j);
        const double determinant = j.xx * j.yy - j.xy * j.yx;
        const double inverse = determinant > 0 ? 1 / determinant : infinity;  // past a fold nowhere
        const auto step_from = [&](Point2 distorted) {
          const double ex = target.x - distorted.x, ey = target.y - distorted.y;
          return Point2{(j.yy * ex - j.xy * ey) * inverse, (j.xx * ey - j.yx * ex) * inverse};
        };
        const Point2 first_step = step_from(here);
        const Point2 once{guess.x + first_step.x, guess.y + first_step.y};
        const Point2 last_step = step_from(distort_radtan(camera, once));
        to_x[i] = once.x + last_step.x;
        to_y[i] = once.y + last_step.y;
        steps[i] = last_step.x * last_step.x + last_step.y * last_step.y;
      }
      std::copy_n(to_x.begin(), n, rows_[0].x.begin() + static_cast<std::ptrdiff_t>(first));
      std::copy_n(to_y.begin(), n, rows_[0].y.begin() + static_cast<std::ptrdiff_t>(first));
      std::copy_n(steps.begin(), n, steps_.begin() + static_cast<std::ptrdiff_t>(first));
    }
  }

  const Camera& camera_;
  const RadialProfile& profile_;
  std::array<Row, 4> rows_;       // the last four, the latest first
  std::vector<double> target_x_;  // of every column
  std::vector<double> steps_;     // the squares of the last steps
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
      const RadtanRows::Row& row = rows.next(y);
      for (std::size_t x = 0; x < row.x.size(); ++x) add(to_pixel(camera, {row.x[x], row.y[x]}));
    }
    return table;
  }
  for (int y = 0; y < camera.size.height; ++y) {
    for (int x = 0; x < camera.size.width; ++x) add(undistort(camera, profile, {double(x), double(y)}));
  }
  return table;
}

}  // namespace emseg
