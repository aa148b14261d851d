// Parametric motion models: where an event at (x, y), dt seconds after t_ref, lies at t_ref.
//
// A new model is one struct: `dof`, `name`, `params`, and a `Warp` that is bound to a frame once and then
// called per event, with and without derivatives.  MotionModel is the variant of them all; std::visit
// dispatches once, outside the loop over events.  With c the image centre and v in px/s:
//
//   translation   x' = x - dt v                                                       2 parameters
//   rotation      f' = exp(-dt [w]x) f,  f = K^-1 (x, y, 1),  x' = K f' / f'_z         3
//   similarity    x' = x - dt (v + ((1+s) R(theta) - I)(x - c))                       4
//   affine        x' = x - dt (v + A (x - c))                                         6
//   homography    x' = x - dt (v + A (x - c) + (x - c) (g, h)·(x - c)/f0)              8, first order
#pragma once

#include <array>
#include <cmath>
#include <concepts>
#include <limits>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "emseg/camera.hpp"
#include "emseg/event.hpp"
#include "emseg/image.hpp"

namespace emseg {

// What warps are relative to; one per sensor.
struct WarpFrame {
  double cx = 0, cy = 0;  // image centre, px: fixed point of scale, rotation and shear
  double f0 = 1;          // length that normalises the projective terms, px
  double fx = 1, fy = 1;  // intrinsics of the rotation's bearing vectors, px
  double px = 0, py = 0;
};

// Without a camera: focal length max(width, height), principal point at the image centre.
WarpFrame make_warp_frame(ImageSize size, const Camera* camera = nullptr);

struct Vec2f {
  float x = 0;
  float y = 0;
};

// Derivatives of the warped position by each parameter.
template <int Dof>
struct WarpJacobian {
  std::array<float, Dof> dx;
  std::array<float, Dof> dy;
};

// x' = x - dt (v + B (x - c)): the form that translation, similarity and affine share.
struct LinearWarp {
  float vx = 0, vy = 0, b11 = 0, b12 = 0, b21 = 0, b22 = 0, cx = 0, cy = 0;

  Vec2f operator()(float x, float y, float dt) const {
    const float rx = x - cx;
    const float ry = y - cy;
    return {x - dt * (vx + b11 * rx + b12 * ry), y - dt * (vy + b21 * rx + b22 * ry)};
  }
};

struct Translation {
  static constexpr int dof = 2;
  static constexpr std::string_view name = "translation";
  std::array<double, dof> params{};  // vx vy, px/s

  struct Warp {
    static constexpr int dof = Translation::dof;
    float vx, vy;
    Warp(const Translation& model, const WarpFrame&)
        : vx(static_cast<float>(model.params[0])), vy(static_cast<float>(model.params[1])) {}
    Vec2f operator()(float x, float y, float dt) const { return {x - dt * vx, y - dt * vy}; }
    WarpJacobian<dof> jacobian(float, float, float dt) const { return {{-dt, 0}, {0, -dt}}; }
  };
};

struct Rotation {
  static constexpr int dof = 3;
  static constexpr std::string_view name = "rotation";
  std::array<double, dof> params{};  // wx wy wz, rad/s

  struct Warp {
    static constexpr int dof = Rotation::dof;
    float wx, wy, wz, speed;  // angular velocity and its length
    float ax, ay, az;         // unit axis
    float fx, fy, px, py;
    Warp(const Rotation& model, const WarpFrame& frame);
    // Infinitely far where the point turns behind the camera.
    Vec2f operator()(float x, float y, float dt) const {
      // x' - x, not x': small numbers keep their digits.
      const auto d = turn(x, y, dt);
      const float depth = 1 + d[2];
      if (!(depth > 0))
        return {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::infinity()};
      return {x + (fx * d[0] - (x - px) * d[2]) / depth, y + (fy * d[1] - (y - py) * d[2]) / depth};
    }
    WarpJacobian<dof> jacobian(float x, float y, float dt) const;

   private:
    std::array<float, 3> turn(float x, float y, float dt) const;  // f' - f
  };
};

struct Similarity {
  static constexpr int dof = 4;
  static constexpr std::string_view name = "similarity";
  std::array<double, dof> params{};  // vx vy (px/s), s (1/s), theta (rad/s)

  struct Warp : LinearWarp {
    static constexpr int dof = Similarity::dof;
    float cos_theta, sin_theta, gain;  // gain = 1 + s
    Warp(const Similarity& model, const WarpFrame& frame);
    WarpJacobian<dof> jacobian(float x, float y, float dt) const {
      const float rx = x - cx;
      const float ry = y - cy;
      const float turned_x = cos_theta * rx - sin_theta * ry;
      const float turned_y = sin_theta * rx + cos_theta * ry;
      return {{-dt, 0, -dt * turned_x, dt * gain * turned_y},
              {0, -dt, -dt * turned_y, -dt * gain * turned_x}};
    }
  };
};

struct Affine {
  static constexpr int dof = 6;
  static constexpr std::string_view name = "affine";
  std::array<double, dof> params{};  // vx vy (px/s), a11 a12 a21 a22 (1/s)

  struct Warp : LinearWarp {
    static constexpr int dof = Affine::dof;
    Warp(const Affine& model, const WarpFrame& frame);
    WarpJacobian<dof> jacobian(float x, float y, float dt) const {
      const float rx = dt * (x - cx);
      const float ry = dt * (y - cy);
      return {{-dt, 0, -rx, -ry, 0, 0}, {0, -dt, 0, 0, -rx, -ry}};
    }
  };
};

struct Homography {
  static constexpr int dof = 8;
  static constexpr std::string_view name = "homography";
  std::array<double, dof> params{};  // vx vy (px/s), a11 a12 a21 a22 g h (1/s)

  struct Warp : LinearWarp {
    static constexpr int dof = Homography::dof;
    float g, h;  // per pixel: divided by f0
    float inverse_f0;
    Warp(const Homography& model, const WarpFrame& frame);
    Vec2f operator()(float x, float y, float dt) const {
      const float rx = x - cx;
      const float ry = y - cy;
      const float projective = g * rx + h * ry;
      return {x - dt * (vx + b11 * rx + b12 * ry + rx * projective),
              y - dt * (vy + b21 * rx + b22 * ry + ry * projective)};
    }
    WarpJacobian<dof> jacobian(float x, float y, float dt) const {
      const float rx = x - cx;
      const float ry = y - cy;
      const float dx = dt * rx;
      const float dy = dt * ry;
      const float nx = rx * inverse_f0;
      const float ny = ry * inverse_f0;
      return {{-dt, 0, -dx, -dy, 0, 0, -dx * nx, -dx * ny}, {0, -dt, 0, 0, -dx, -dy, -dy * nx, -dy * ny}};
    }
  };
};

template <typename M>
concept ParametricMotion = requires(M model, const WarpFrame& frame, const typename M::Warp& warp) {
  { M::dof } -> std::convertible_to<int>;
  { M::name } -> std::convertible_to<std::string_view>;
  { model.params[0] } -> std::convertible_to<double>;
  { typename M::Warp(model, frame) };
  { warp(0.0f, 0.0f, 0.0f) } -> std::same_as<Vec2f>;
  { warp.jacobian(0.0f, 0.0f, 0.0f) } -> std::same_as<WarpJacobian<M::dof>>;
};

static_assert(ParametricMotion<Translation> && ParametricMotion<Rotation> && ParametricMotion<Similarity> &&
              ParametricMotion<Affine> && ParametricMotion<Homography>);

using MotionModel = std::variant<Translation, Rotation, Similarity, Affine, Homography>;

// The order of the variant's alternatives.
enum class MotionKind { translation, rotation, similarity, affine, homography };

inline MotionKind kind_of(const MotionModel& model) { return static_cast<MotionKind>(model.index()); }
std::string_view name_of(MotionKind kind);
int dof_of(MotionKind kind);

// The kind with most parameters; of the others, translation and similarity are special cases of it.
MotionKind richest(std::span<const MotionKind> kinds);
// Throws std::invalid_argument that lists the known names.
MotionKind motion_kind(std::string_view name);

// A model of this kind with these parameters (none: no motion).
// Throws std::invalid_argument where their number does not fit or one is not finite.
MotionModel make_motion(MotionKind kind, std::span<const double> params = {});
std::span<const double> params_of(const MotionModel& model);
std::span<const double> params_of(MotionModel&&) = delete;  // the span would outlive its model

// An event at (x, y), dt seconds after t_ref, that is to be warped to (target_x, target_y).
struct Correspondence {
  float x = 0, y = 0, dt = 0;
  float target_x = 0, target_y = 0;
  float weight = 1;
};

// The model of this kind that brings the events nearest to their targets: weighted least squares,
// Gauss-Newton. Directions that the correspondences do not determine stay at no motion.
MotionModel fit_correspondences(MotionKind kind, std::span<const Correspondence> pairs,
                                const WarpFrame& frame);

// The same image motion as a model of another kind: exact from a kind that the other contains, otherwise the
// least-squares fit of the velocity field over `plane`.
MotionModel convert_motion(const MotionModel& model, MotionKind kind, const WarpFrame& frame, Region plane);

// Events as points to be warped: undistorted position (px) and time from t_ref (s).
struct PointView {
  std::span<const float> x;
  std::span<const float> y;
  std::span<const float> dt;
  std::span<const float> sign = {};  // 1 or -1, of the polarity; empty: all count alike

  std::size_t size() const { return dt.size(); }
  // From the first point to the last; there is one.
  double seconds() const { return static_cast<double>(dt.back()) - dt.front(); }
};

struct Points {
  std::vector<float> x;
  std::vector<float> y;
  std::vector<float> dt;
  std::vector<float> sign = {};

  std::size_t size() const { return dt.size(); }
  PointView view() const { return {x, y, dt, sign}; }
  void reserve(std::size_t count);
  void push_back(const PointView& from, std::size_t k) {
    x.push_back(from.x[k]);
    y.push_back(from.y[k]);
    dt.push_back(from.dt[k]);
    if (!from.sign.empty()) sign.push_back(from.sign[k]);
  }
};

// Points of a window; pixels are looked up in `table` when it is given.
Points make_points(const EventView& events, std::int64_t t_ref, const UndistortionTable* table = nullptr);

// Warped positions of all points.
void warp_points(const PointView& points, const MotionModel& model, const WarpFrame& frame,
                 std::span<float> x, std::span<float> y);

// Root-mean-square distance, in px, between two models' warps of the points.
double motion_distance(const MotionModel& a, const MotionModel& b, const WarpFrame& frame,
                       const PointView& points);

}  // namespace emseg
