#include "warp_field.hpp"

#include <cmath>

namespace emseg {
namespace {

WarpField linear_field(const LinearWarp& warp, WarpField::Form form) {
  WarpField field;
  field.form = form;
  field.vx = warp.vx, field.vy = warp.vy;
  field.b11 = warp.b11, field.b12 = warp.b12, field.b21 = warp.b21, field.b22 = warp.b22;
  field.cx = warp.cx, field.cy = warp.cy;
  return field;
}

WarpField field_of(const Translation::Warp& warp) {
  WarpField field;
  field.vx = warp.vx, field.vy = warp.vy;
  return field;
}

WarpField field_of(const Rotation::Warp& warp) {
  WarpField field;
  field.form = WarpField::Form::rotation;
  field.speed = warp.speed;
  field.ax = warp.ax, field.ay = warp.ay, field.az = warp.az;
  field.fx = warp.fx, field.fy = warp.fy, field.px = warp.px, field.py = warp.py;
  return field;
}

WarpField field_of(const Similarity::Warp& warp) { return linear_field(warp, WarpField::Form::linear); }
WarpField field_of(const Affine::Warp& warp) { return linear_field(warp, WarpField::Form::linear); }

WarpField field_of(const Homography::Warp& warp) {
  WarpField field = linear_field(warp, WarpField::Form::projective);
  field.g = warp.g, field.h = warp.h;
  return field;
}

}  // namespace

WarpField warp_field(const MotionModel& model, const WarpFrame& frame) {
  return std::visit(
      [&](const auto& m) { return field_of(typename std::decay_t<decltype(m)>::Warp(m, frame)); }, model);
}

std::array<double, 8> parameter_gradient(const MotionModel& model, const WarpFrame& frame,
                                         std::span<const double, 8> by_coefficient) {
  std::array<double, 8> gradient{};
  for (std::size_t d = 0; d < 8; ++d) gradient[d] = by_coefficient[d];
  if (const auto* similarity = std::get_if<Similarity>(&model)) {
    // B = (1 + s) R(theta) - I
    const double c = std::cos(similarity->params[3]), s = std::sin(similarity->params[3]);
    const double trace = by_coefficient[2] + by_coefficient[5];
    const double turn = by_coefficient[4] - by_coefficient[3];
    gradient[2] = c * trace + s * turn;
    gradient[3] = (1 + similarity->params[2]) * (c * turn - s * trace);
    gradient[4] = gradient[5] = 0;
  } else if (std::holds_alternative<Homography>(model)) {
    gradient[6] /= frame.f0;
    gradient[7] /= frame.f0;
  }
  return gradient;
}

}  // namespace emseg
