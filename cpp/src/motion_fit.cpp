#include "emseg/motion_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace emseg {

MotionModel clamp_motion(const MotionModel& model, const MotionBounds& bounds, const WarpFrame& frame) {
  MotionModel clamped = model;
  const auto limit = [](double& value, double bound) { value = std::clamp(value, -bound, bound); };
  std::visit(
      [&](auto& m) {
        using Model = std::decay_t<decltype(m)>;
        if constexpr (std::is_same_v<Model, Rotation>) {
          // An image speed about the centre of focal length times angular rate.
          for (double& rate : m.params)
            limit(rate, std::max(bounds.speed / std::min(frame.fx, frame.fy), bounds.angle_rate));
        } else {
          limit(m.params[0], bounds.speed);
          limit(m.params[1], bounds.speed);
          if constexpr (std::is_same_v<Model, Similarity>) {
            limit(m.params[2], bounds.scale_rate);
            limit(m.params[3], bounds.angle_rate);
          } else {
            for (std::size_t d = 2; d < m.params.size(); ++d) limit(m.params[d], bounds.linear_rate());
          }
        }
      },
      clamped);
  return clamped;
}

namespace {

// Reciprocal of the root-mean-square displacement, in px, that a unit of each parameter makes.
Eigen::VectorXd parameter_units(const PointView& points, const MotionModel& model, const WarpFrame& frame) {
  return std::visit(
      [&](const auto& m) -> Eigen::VectorXd {
        using Model = std::decay_t<decltype(m)>;
        const typename Model::Warp warp(m, frame);
        Eigen::VectorXd sum = Eigen::VectorXd::Zero(Model::dof);
        const std::size_t stride = std::max<std::size_t>(1, points.size() / 256);
        std::size_t used = 0;
        for (std::size_t k = 0; k < points.size(); k += stride, ++used) {
          const auto jacobian = warp.jacobian(points.x[k], points.y[k], points.dt[k]);
          for (std::size_t d = 0; d < jacobian.dx.size(); ++d) {
            const double square =
                double(jacobian.dx[d]) * jacobian.dx[d] + double(jacobian.dy[d]) * jacobian.dy[d];
            if (std::isfinite(square))
              sum[static_cast<Eigen::Index>(d)] += square;  // a rotation may pass infinity
          }
        }
        return (sum / static_cast<double>(std::max<std::size_t>(1, used)))
            .cwiseSqrt()
            .cwiseMax(1e-9)
            .cwiseInverse();
      },
      model);
}

}  // namespace

FitResult refine_motion(const PointView& points, const MotionModel& start, const WarpFrame& frame,
                        Region region, const RefineOptions& options, ContrastWorkspace& workspace) {
  FitResult best;
  best.model = clamp_motion(start, options.bounds, frame);
  if (points.size() == 0 || region.area() == 0) return best;
  const MotionKind kind = kind_of(start);
  const Eigen::Index dof = dof_of(kind);
  const Eigen::VectorXd units = parameter_units(points, start, frame);

  // In scaled parameters u = params / units, maximising log contrast: steps are in px, gains are relative.
  const auto model_at = [&](const Eigen::VectorXd& u) {
    const Eigen::VectorXd params = u.cwiseProduct(units);
    return make_motion(kind, {params.data(), static_cast<std::size_t>(dof)});
  };
  const auto scaled_params = [&](const MotionModel& model) {
    const auto params = params_of(model);
    return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(params.data(), dof).cwiseQuotient(units));
  };
  struct Evaluation {
    double value;
    Eigen::VectorXd gradient;
  };
  const auto evaluate = [&](const MotionModel& model) {
    const ContrastResult result =
        contrast_and_gradient(points, model, frame, region, options.contrast, workspace);
    ++best.evaluations;
    Evaluation evaluation{result.value, Eigen::VectorXd::Zero(dof)};
    if (result.value > 0) {
      evaluation.gradient =
          Eigen::Map<const Eigen::VectorXd>(result.gradient.data(), dof).cwiseProduct(units) / result.value;
    }
    return evaluation;
  };

  Eigen::VectorXd u = scaled_params(best.model);
  Evaluation now = evaluate(best.model);
  best.contrast = now.value;
  Eigen::MatrixXd inverse_hessian = Eigen::MatrixXd::Identity(dof, dof);
  bool scaled_once = false;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    Eigen::VectorXd direction = inverse_hessian * now.gradient;  // ascent
    if (direction.dot(now.gradient) <= 0) {
      inverse_hessian.setIdentity();
      direction = now.gradient;
    }
    const double length = direction.norm();
    if (!(length > 0)) break;
    // A contrast peak is as wide as an edge is sharp: no step beyond 1 px, and the first one is half a px.
    const double limit = scaled_once ? 1.0 : 0.5;
    if (length > limit || !scaled_once) direction *= limit / length;

    double step = 1;
    Eigen::VectorXd next_u;
    Evaluation next{};
    bool risen = false;
    for (int halving = 0; halving < 7; ++halving, step *= 0.5) {
      if (step * direction.norm() < 0.2 * options.tolerance) break;
      const MotionModel trial = clamp_motion(model_at(u + step * direction), options.bounds, frame);
      next_u = scaled_params(trial);
      next = evaluate(trial);
      // Bounds may have bent the step away from the gradient; it must rise all the same.
      if (next.value > now.value + 1e-4 * now.value * std::max(0.0, now.gradient.dot(next_u - u))) {
        risen = true;
        best.model = trial;
        best.contrast = next.value;
        break;
      }
    }
    if (!risen) {
      if (inverse_hessian.isIdentity()) break;
      inverse_hessian.setIdentity();  // one more try along the gradient
      scaled_once = false;
      continue;
    }
    const Eigen::VectorXd moved = next_u - u;
    const Eigen::VectorXd change = now.gradient - next.gradient;  // of the gradient of -log contrast
    const double curvature = moved.dot(change);
    if (curvature > 1e-12) {
      if (!scaled_once) inverse_hessian *= curvature / change.squaredNorm();
      const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(dof, dof);
      const Eigen::MatrixXd left = identity - moved * change.transpose() / curvature;
      inverse_hessian = left * inverse_hessian * left.transpose() + moved * moved.transpose() / curvature;
      scaled_once = true;
    }
    u = next_u;
    now = next;
    if (moved.norm() < options.tolerance) break;
  }
  return best;
}

Region fit_region(const PointView& points, const MotionModel& start, const WarpFrame& frame, Region plane) {
  std::vector<float> x(points.size()), y(points.size());
  warp_points(points, start, frame, x, y);
  return bounding_region(x, y, 8, canvas_of(plane));
}

FitResult fit_motion(const PointView& points, std::span<const std::uint8_t> positive, MotionKind kind,
                     const WarpFrame& frame, Region plane, const FitOptions& options, ThreadPool& pool) {
  // The whole sensor, and parts of it for the change of velocity across it.
  constexpr int parts = 4;
  std::vector<Region> regions{plane};
  for (int j = 0; j < parts; ++j) {
    for (int i = 0; i < parts; ++i) {
      const int left = plane.width * i / parts;
      const int top = plane.height * j / parts;
      regions.push_back({plane.x0 + left, plane.y0 + top, plane.width * (i + 1) / parts - left,
                         plane.height * (j + 1) / parts - top});
    }
  }
  SweepOptions sweep = options.sweep;
  sweep.max_speed = options.refine.bounds.speed;
  const auto velocities = sweep_velocities(points, positive, regions, plane, sweep, pool);

  const auto moving = [&](const VelocityScore& v) {
    const double params[] = {v.vx, v.vy};
    return convert_motion(make_motion(MotionKind::translation, params), kind, frame, plane);
  };
  std::vector<MotionModel> starts{make_motion(kind)};
  for (const VelocityScore& v : velocities[0]) starts.push_back(moving(v));

  // The velocity field of the parts, least squares with the parts that disagree weighted down.
  const float dt = points.size() ? std::max(1e-3f, 0.5f * (points.dt.back() - points.dt.front())) : 1e-3f;
  std::vector<Correspondence> field;
  for (std::size_t r = 1; r < regions.size(); ++r) {
    if (velocities[r].empty()) continue;
    const VelocityScore& v = velocities[r].front();
    const auto x = static_cast<float>(regions[r].x0 + 0.5 * (regions[r].width - 1));
    const auto y = static_cast<float>(regions[r].y0 + 0.5 * (regions[r].height - 1));
    field.push_back({x, y, dt, x - dt * static_cast<float>(v.vx), y - dt * static_cast<float>(v.vy), 1});
  }
  if (field.size() >= 3 && dof_of(kind) > 2) {
    MotionModel fitted = fit_correspondences(kind, field, frame);
    for (int round = 0; round < 5; ++round) {
      std::visit(
          [&](const auto& m) {
            const typename std::decay_t<decltype(m)>::Warp warp(m, frame);
            for (Correspondence& pair : field) {
              const Vec2f at = warp(pair.x, pair.y, pair.dt);
              const float error = std::hypot(at.x - pair.target_x, at.y - pair.target_y);
              pair.weight = 1 / (1 + error * error / 4);  // Cauchy weights, 2 px
            }
          },
          fitted);
      fitted = fit_correspondences(kind, field, frame);
    }
    starts.push_back(fitted);
  }

  std::vector<FitResult> results(starts.size());
  std::vector<ContrastWorkspace> workspaces(static_cast<std::size_t>(pool.worker_count()));
  pool.for_each(starts.size(), [&](std::size_t i, int worker) {
    results[i] = refine_motion(points, starts[i], frame, plane, options.refine,
                               workspaces[static_cast<std::size_t>(worker)]);
  });
  FitResult best = results.front();
  int evaluations = 0;
  for (const FitResult& result : results) {
    evaluations += result.evaluations;
    if (result.contrast > best.contrast) best = result;
  }
  best.evaluations = evaluations;
  return best;
}

}  // namespace emseg
