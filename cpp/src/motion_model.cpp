#include "emseg/motion_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cassert>
#include <stdexcept>
#include <string>

#include "warp_field.hpp"

namespace emseg {

WarpFrame make_warp_frame(ImageSize size, const Camera* camera) {
  WarpFrame frame;
  frame.cx = 0.5 * (size.width - 1);
  frame.cy = 0.5 * (size.height - 1);
  frame.f0 = std::max(size.width, size.height);
  if (camera) {
    frame.fx = camera->fx;
    frame.fy = camera->fy;
    frame.px = camera->cx;
    frame.py = camera->cy;
  } else {
    frame.fx = frame.fy = frame.f0;
    frame.px = frame.cx;
    frame.py = frame.cy;
  }
  return frame;
}

Rotation::Warp::Warp(const Rotation& model, const WarpFrame& frame)
    : wx(static_cast<float>(model.params[0])),
      wy(static_cast<float>(model.params[1])),
      wz(static_cast<float>(model.params[2])),
      speed(std::sqrt(wx * wx + wy * wy + wz * wz)),
      ax(speed > 0 ? wx / speed : 0),
      ay(speed > 0 ? wy / speed : 0),
      az(speed > 0 ? wz / speed : 1),
      fx(static_cast<float>(frame.fx)),
      fy(static_cast<float>(frame.fy)),
      px(static_cast<float>(frame.px)),
      py(static_cast<float>(frame.py)) {}

std::array<float, 3> Rotation::Warp::turn(float x, float y, float dt) const {
  // Rodrigues about the unit axis a by -|w| dt; 1 - cos is taken from the half angle to keep its digits.
  const float angle = -speed * dt;
  const float sine = std::sin(angle);
  const float half = std::sin(0.5f * angle);
  const float versine = 2 * half * half;
  const float bx = (x - px) / fx;
  const float by = (y - py) / fy;
  const float cross_x = ay - az * by;
  const float cross_y = az * bx - ax;
  const float cross_z = ax * by - ay * bx;
  const float along = ax * bx + ay * by + az;
  // a x (a x b) = a (a.b) - b
  return {sine * cross_x + versine * (ax * along - bx), sine * cross_y + versine * (ay * along - by),
          sine * cross_z + versine * (az * along - 1)};
}

WarpJacobian<3> Rotation::Warp::jacobian(float x, float y, float dt) const {
  const auto d = turn(x, y, dt);
  const std::array<float, 3> f{(x - px) / fx + d[0], (y - py) / fy + d[1], 1 + d[2]};
  if (!(f[2] > 0)) return {};
  // d exp([phi]x) b = -[f']x J_l(phi) dphi with phi = -dt w, hence df'/dw = dt [f']x J_l(phi).
  const float angle = -speed * dt;
  float sinc = 1, rest = 0, cosc = 0;  // sin a / a, 1 - sin a / a, (1 - cos a) / a
  if (std::abs(angle) > 1e-4f) {
    sinc = std::sin(angle) / angle;
    rest = 1 - sinc;
    const float half = std::sin(0.5f * angle);
    cosc = 2 * half * half / angle;
  } else {
    cosc = 0.5f * angle;
  }
  const float left[3][3] = {
      {sinc + rest * ax * ax, rest * ax * ay - cosc * az, rest * ax * az + cosc * ay},
      {rest * ax * ay + cosc * az, sinc + rest * ay * ay, rest * ay * az - cosc * ax},
      {rest * ax * az - cosc * ay, rest * ay * az + cosc * ax, sinc + rest * az * az},
  };
  const float inverse_z = 1 / f[2];
  WarpJacobian<3> jacobian{};
  for (int i = 0; i < 3; ++i) {
    const float jx = left[0][i], jy = left[1][i], jz = left[2][i];
    const float dfx = dt * (f[1] * jz - f[2] * jy);
    const float dfy = dt * (f[2] * jx - f[0] * jz);
    const float dfz = dt * (f[0] * jy - f[1] * jx);
    jacobian.dx[static_cast<std::size_t>(i)] = fx * inverse_z * (dfx - f[0] * inverse_z * dfz);
    jacobian.dy[static_cast<std::size_t>(i)] = fy * inverse_z * (dfy - f[1] * inverse_z * dfz);
  }
  return jacobian;
}

Similarity::Warp::Warp(const Similarity& model, const WarpFrame& frame)
    : cos_theta(static_cast<float>(std::cos(model.params[3]))),
      sin_theta(static_cast<float>(std::sin(model.params[3]))),
      gain(static_cast<float>(1 + model.params[2])) {
  const double s = 1 + model.params[2];
  const double half = std::sin(0.5 * model.params[3]);
  vx = static_cast<float>(model.params[0]);
  vy = static_cast<float>(model.params[1]);
  // (1+s) cos - 1 = s cos - 2 sin^2(theta/2): small rates keep their digits
  b11 = b22 = static_cast<float>(model.params[2] * std::cos(model.params[3]) - 2 * half * half);
  b21 = static_cast<float>(s * std::sin(model.params[3]));
  b12 = -b21;
  cx = static_cast<float>(frame.cx);
  cy = static_cast<float>(frame.cy);
}

Affine::Warp::Warp(const Affine& model, const WarpFrame& frame)
    : LinearWarp{static_cast<float>(model.params[0]), static_cast<float>(model.params[1]),
                 static_cast<float>(model.params[2]), static_cast<float>(model.params[3]),
                 static_cast<float>(model.params[4]), static_cast<float>(model.params[5]),
                 static_cast<float>(frame.cx),        static_cast<float>(frame.cy)} {}

Homography::Warp::Warp(const Homography& model, const WarpFrame& frame)
    : LinearWarp{static_cast<float>(model.params[0]), static_cast<float>(model.params[1]),
                 static_cast<float>(model.params[2]), static_cast<float>(model.params[3]),
                 static_cast<float>(model.params[4]), static_cast<float>(model.params[5]),
                 static_cast<float>(frame.cx),        static_cast<float>(frame.cy)},
      g(static_cast<float>(model.params[6] / frame.f0)),
      h(static_cast<float>(model.params[7] / frame.f0)),
      inverse_f0(static_cast<float>(1 / frame.f0)) {}

namespace {

template <std::size_t... I>
MotionModel default_motion(std::size_t index, std::index_sequence<I...>) {
  MotionModel model;
  ((index == I ? (model.emplace<I>(), 0) : 0), ...);
  return model;
}

MotionModel still(MotionKind kind) {
  return default_motion(static_cast<std::size_t>(kind),
                        std::make_index_sequence<std::variant_size_v<MotionModel>>());
}

constexpr std::array all_kinds = {MotionKind::translation, MotionKind::rotation, MotionKind::similarity,
                                  MotionKind::affine, MotionKind::homography};
static_assert(all_kinds.size() == std::variant_size_v<MotionModel>);

}  // namespace

std::string_view name_of(MotionKind kind) {
  return std::visit([](const auto& model) { return model.name; }, still(kind));
}

int dof_of(MotionKind kind) {
  return std::visit([](const auto& model) { return model.dof; }, still(kind));
}

MotionKind richest(std::span<const MotionKind> kinds) {
  return *std::max_element(kinds.begin(), kinds.end(),
                           [](MotionKind a, MotionKind b) { return dof_of(a) < dof_of(b); });
}

MotionKind motion_kind(std::string_view name) {
  std::string known;
  for (const MotionKind kind : all_kinds) {
    if (name_of(kind) == name) return kind;
    known += (known.empty() ? "" : ", ") + std::string(name_of(kind));
  }
  throw std::invalid_argument("unknown motion model '" + std::string(name) + "', expected one of " + known);
}

MotionModel make_motion(MotionKind kind, std::span<const double> params) {
  MotionModel made = still(kind);
  if (params.empty()) return made;
  const auto expected = static_cast<std::size_t>(dof_of(kind));
  if (params.size() != expected) {
    throw std::invalid_argument("a " + std::string(name_of(kind)) + " has " + std::to_string(expected) +
                                " parameters, got " + std::to_string(params.size()));
  }
  for (std::size_t i = 0; i < params.size(); ++i) {
    if (!std::isfinite(params[i])) {
      throw std::invalid_argument("parameter " + std::to_string(i) + " of the " + std::string(name_of(kind)) +
                                  " is not finite");
    }
  }
  std::visit([&](auto& model) { std::copy(params.begin(), params.end(), model.params.begin()); }, made);
  return made;
}

std::span<const double> params_of(const MotionModel& model) {
  return std::visit([](const auto& m) { return std::span<const double>(m.params); }, model);
}

namespace {

// Sized at run time, up to the eight parameters of a model: solved once for all models rather than per size,
// which takes the compiler a minute.
using SmallMatrix = Eigen::MatrixXd;
using SmallVector = Eigen::VectorXd;

// The least-squares solution of least norm, in units in which every parameter has the same leverage.
SmallVector minimum_norm_solution(const SmallMatrix& normal, const SmallVector& right) {
  const SmallVector scale = normal.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SmallMatrix scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<SmallMatrix> eigen(scaled);
  const SmallVector inverse =
      eigen.eigenvalues().unaryExpr([](double value) { return value > 1e-9 ? 1 / value : 0.0; });
  const SmallVector projected = eigen.eigenvectors().transpose() * scale.cwiseProduct(right);
  return scale.cwiseProduct(eigen.eigenvectors() * inverse.cwiseProduct(projected));
}

}  // namespace

MotionModel fit_correspondences(MotionKind kind, std::span<const Correspondence> pairs,
                                const WarpFrame& frame) {
  MotionModel result = still(kind);
  // Similarity and rotation are linear in their parameters to first order only: a few more steps take up the
  // rest.
  constexpr double converged = 1e-4;  // px, root mean square; the next step would be far smaller still
  double moved = 2 * converged;
  for (int iteration = 0; iteration < 20 && moved > converged; ++iteration) {
    std::visit(
        [&](auto& m) {
          using Model = std::decay_t<decltype(m)>;
          const typename Model::Warp warp(m, frame);
          Eigen::Matrix<double, Model::dof, Model::dof> normal = decltype(normal)::Zero();
          Eigen::Matrix<double, Model::dof, 1> right = decltype(right)::Zero();
          double weight = 0;
          for (const Correspondence& pair : pairs) {
            const Vec2f now = warp(pair.x, pair.y, pair.dt);
            const auto jacobian = warp.jacobian(pair.x, pair.y, pair.dt);
            Eigen::Matrix<double, 2, Model::dof> rows;
            for (int d = 0; d < Model::dof; ++d) {
              rows(0, d) = jacobian.dx[static_cast<std::size_t>(d)];
              rows(1, d) = jacobian.dy[static_cast<std::size_t>(d)];
            }
            const Eigen::Vector2d error(pair.target_x - now.x, pair.target_y - now.y);
            if (!error.allFinite() || !rows.allFinite()) continue;
            weight += pair.weight;
            normal += pair.weight * rows.transpose() * rows;
            right += pair.weight * rows.transpose() * error;
          }
          const SmallVector step = minimum_norm_solution(normal, right);
          for (int d = 0; d < Model::dof; ++d) m.params[static_cast<std::size_t>(d)] += step[d];
          moved = weight > 0 ? std::sqrt(std::max(0.0, step.dot(normal * step)) / weight) : 0;
        },
        result);
  }
  return result;
}

MotionModel convert_motion(const MotionModel& model, MotionKind kind, const WarpFrame& frame, Region plane) {
  if (kind_of(model) == kind) return model;
  constexpr float dt =
      1e-2f;  // short, so that first and exact order agree; any value of the order of a window
  constexpr int steps = 5;
  std::vector<Correspondence> pairs;
  std::visit(
      [&](const auto& m) {
        const typename std::decay_t<decltype(m)>::Warp warp(m, frame);
        for (int i = 0; i < steps; ++i) {
          for (int j = 0; j < steps; ++j) {
            const auto x = static_cast<float>(plane.x0 + (plane.width - 1) * (j / double(steps - 1)));
            const auto y = static_cast<float>(plane.y0 + (plane.height - 1) * (i / double(steps - 1)));
            const Vec2f target = warp(x, y, dt);
            pairs.push_back({x, y, dt, target.x, target.y, 1});
          }
        }
      },
      model);
  return fit_correspondences(kind, pairs, frame);
}

void Points::reserve(std::size_t count) {
  x.reserve(count);
  y.reserve(count);
  dt.reserve(count);
}

Points make_points(const EventView& events, std::int64_t t_ref, const UndistortionTable* table) {
  Points points;
  const std::size_t n = events.size();
  points.x.resize(n);
  points.y.resize(n);
  points.dt.resize(n);
  for (std::size_t k = 0; k < n; ++k) {
    points.dt[k] = static_cast<float>(seconds_between(t_ref, events.t[k]));
    if (table) {
      const std::size_t pixel =
          static_cast<std::size_t>(events.y[k]) * static_cast<std::size_t>(table->size.width) + events.x[k];
      points.x[k] = table->x[pixel];
      points.y[k] = table->y[pixel];
    } else {
      points.x[k] = events.x[k];
      points.y[k] = events.y[k];
    }
  }
  return points;
}

void warp_points(const PointView& points, const MotionModel& model, const WarpFrame& frame,
                 std::span<float> x, std::span<float> y) {
  assert(x.size() == points.size() && y.size() == points.size());
  kernels().warp(warp_field(model, frame), points.x.data(), points.y.data(), points.dt.data(), points.size(),
                 x.data(), y.data());
}

double motion_distance(const MotionModel& a, const MotionModel& b, const WarpFrame& frame,
                       const PointView& points) {
  if (points.size() == 0) return 0;
  std::vector<float> ax(points.size()), ay(points.size()), bx(points.size()), by(points.size());
  warp_points(points, a, frame, ax, ay);
  warp_points(points, b, frame, bx, by);
  double sum = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    sum += double(ax[k] - bx[k]) * (ax[k] - bx[k]) + double(ay[k] - by[k]) * (ay[k] - by[k]);
  }
  return std::sqrt(sum / static_cast<double>(points.size()));
}

}  // namespace emseg
