// The warps of all motion models once more, in double precision and straight from their definitions: the
// oracle.
#pragma once

#include <array>
#include <cmath>
#include <span>

#include "emseg/motion_model.hpp"

namespace emseg::testing {

struct Place {
  double x = 0;
  double y = 0;
};

// exp(-dt [w]x) f by its power series.
inline std::array<double, 3> rotated(std::span<const double> w, double dt, std::array<double, 3> f) {
  std::array<double, 3> sum = f, term = f;
  for (int n = 1; n < 60; ++n) {
    term = {-dt / n * (w[1] * term[2] - w[2] * term[1]), -dt / n * (w[2] * term[0] - w[0] * term[2]),
            -dt / n * (w[0] * term[1] - w[1] * term[0])};
    for (std::size_t i = 0; i < 3; ++i) sum[i] += term[i];
  }
  return sum;
}

inline Place reference_warp(MotionKind kind, std::span<const double> q, const WarpFrame& frame, Place at,
                            double dt) {
  const double rx = at.x - frame.cx, ry = at.y - frame.cy;
  const auto moved = [&](double vx, double vy) { return Place{at.x - dt * vx, at.y - dt * vy}; };
  switch (kind) {
    case MotionKind::translation:
      return moved(q[0], q[1]);
    case MotionKind::rotation: {
      const auto f = rotated(q, dt, {(at.x - frame.px) / frame.fx, (at.y - frame.py) / frame.fy, 1});
      return {frame.fx * f[0] / f[2] + frame.px, frame.fy * f[1] / f[2] + frame.py};
    }
    case MotionKind::similarity: {
      const double a = (1 + q[2]) * std::cos(q[3]) - 1, b = (1 + q[2]) * std::sin(q[3]);
      return moved(q[0] + a * rx - b * ry, q[1] + b * rx + a * ry);
    }
    case MotionKind::affine:
      return moved(q[0] + q[2] * rx + q[3] * ry, q[1] + q[4] * rx + q[5] * ry);
    case MotionKind::homography: {
      const double bend = (q[6] * rx + q[7] * ry) / frame.f0;
      return moved(q[0] + q[2] * rx + q[3] * ry + rx * bend, q[1] + q[4] * rx + q[5] * ry + ry * bend);
    }
  }
  return at;
}

inline Place reference_warp(const MotionModel& model, const WarpFrame& frame, Place at, double dt) {
  return reference_warp(kind_of(model), params_of(model), frame, at, dt);
}

// Where something that lies at `home` at t_ref is seen dt later: the warp's inverse, by fixed-point
// iteration, which converges as long as the motion bends the image little within dt.
inline Place reference_unwarp(const MotionModel& model, const WarpFrame& frame, Place home, double dt) {
  Place at = home;
  for (int iteration = 0; iteration < 50; ++iteration) {
    const Place back = reference_warp(model, frame, at, dt);
    at.x += home.x - back.x;
    at.y += home.y - back.y;
  }
  return at;
}

}  // namespace emseg::testing
