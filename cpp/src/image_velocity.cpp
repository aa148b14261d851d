#include "emseg/image_velocity.hpp"

namespace emseg {
namespace {

// v + A r
Vec2d linear(double vx, double vy, double a11, double a12, double a21, double a22, Vec2d r) {
  return {vx + a11 * r.x + a12 * r.y, vy + a21 * r.x + a22 * r.y};
}

// r is the place from the image centre, px.
Vec2d velocity(const Translation& model, const WarpFrame&, Vec2d) {
  return {model.params[0], model.params[1]};
}

Vec2d velocity(const Similarity& model, const WarpFrame&, Vec2d r) {
  const auto& [vx, vy, s, theta] = model.params;
  const double along = (1 + s) * std::cos(theta) - 1;
  const double across = (1 + s) * std::sin(theta);
  return linear(vx, vy, along, -across, across, along, r);
}

Vec2d velocity(const Affine& model, const WarpFrame&, Vec2d r) {
  const auto& [vx, vy, a11, a12, a21, a22] = model.params;
  return linear(vx, vy, a11, a12, a21, a22, r);
}

Vec2d velocity(const Homography& model, const WarpFrame& frame, Vec2d r) {
  const auto& [vx, vy, a11, a12, a21, a22, g, h] = model.params;
  const Vec2d affine = linear(vx, vy, a11, a12, a21, a22, r);
  const double projective = (g * r.x + h * r.y) / frame.f0;
  return {affine.x + r.x * projective, affine.y + r.y * projective};
}

Vec2d velocity(const Rotation& model, const WarpFrame& frame, Vec2d r) {
  const auto& [wx, wy, wz] = model.params;
  const double bx = (r.x + frame.cx - frame.px) / frame.fx;
  const double by = (r.y + frame.cy - frame.py) / frame.fy;
  // w x b of the bearing b = (bx, by, 1), seen from the image plane.
  const double depth = wx * by - wy * bx;
  return {frame.fx * (wy - wz * by - bx * depth), frame.fy * (wz * bx - wx - by * depth)};
}

}  // namespace

Vec2d image_velocity(const MotionModel& model, const WarpFrame& frame, Vec2d place) {
  const Vec2d r{place.x - frame.cx, place.y - frame.cy};
  return std::visit([&](const auto& motion) { return velocity(motion, frame, r); }, model);
}

}  // namespace emseg
