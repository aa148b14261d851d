#include "emseg/motion_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "velocity_search.hpp"

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

// Coefficients that the warp is linear in, where it has such: a similarity's (1+s) cos(theta) - 1 and (1+s)
// sin(theta) in place of s and theta, whose effects change with each other.
Eigen::VectorXd coefficients_of(const MotionModel& model) {
  const auto params = params_of(model);
  Eigen::VectorXd coefficients =
      Eigen::Map<const Eigen::VectorXd>(params.data(), static_cast<Eigen::Index>(params.size()));
  if (kind_of(model) == MotionKind::similarity) {
    coefficients[2] = (1 + params[2]) * std::cos(params[3]) - 1;
    coefficients[3] = (1 + params[2]) * std::sin(params[3]);
  }
  return coefficients;
}

// The model with these coefficients; of the two similarities that have them the one that turns as `like`
// does.
MotionModel model_with(const Eigen::VectorXd& coefficients, const MotionModel& like) {
  Eigen::VectorXd params = coefficients;
  if (kind_of(like) == MotionKind::similarity) {
    const double sign = 1 + params_of(like)[2] < 0 ? -1 : 1;
    params[2] = sign * std::hypot(1 + coefficients[2], coefficients[3]) - 1;
    params[3] = std::atan2(sign * coefficients[3], sign * (1 + coefficients[2]));
  }
  return make_motion(kind_of(like), {params.data(), static_cast<std::size_t>(params.size())});
}

// Derivatives of the parameters by the coefficients.
Eigen::MatrixXd params_by_coefficients(const MotionModel& model) {
  const auto params = params_of(model);
  const auto dof = static_cast<Eigen::Index>(params.size());
  Eigen::MatrixXd derivatives = Eigen::MatrixXd::Identity(dof, dof);
  if (kind_of(model) == MotionKind::similarity) {
    const double c = std::cos(params[3]), s = std::sin(params[3]);
    // A similarity that shrinks all to a point within a second has no angle; near it, angles count little.
    const double gain = std::copysign(std::max(1e-3, std::abs(1 + params[2])), 1 + params[2]);
    derivatives.bottomRightCorner<2, 2>() << c, s, -s / gain, c / gain;
  }
  return derivatives;
}

// Coordinates in which a step's length is the root-mean-square displacement, in px, that it makes between
// early and late events: coefficients = origin + to_coefficients u.  A displacement that all times share
// moves the image, not its contrast.
struct PixelUnits {
  Eigen::VectorXd origin;
  Eigen::MatrixXd to_coefficients, to_pixels;

  PixelUnits(const PointView& points, const MotionModel& model, const WarpFrame& frame)
      : origin(coefficients_of(model)) {
    const Eigen::MatrixXd by_coefficients = params_by_coefficients(model);
    Eigen::MatrixXd gram =
        by_coefficients.transpose() * displacement_gram(points, model, frame) * by_coefficients;
    // What no event depends on must not make the matrix singular.
    gram.diagonal() += (1e-6 * gram.diagonal()).cwiseMax(1e-18);
    const Eigen::LLT<Eigen::MatrixXd> cholesky(gram);
    to_pixels = cholesky.matrixU();
    to_coefficients =
        to_pixels.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(gram.rows(), gram.cols()));
  }

  MotionModel model_at(const Eigen::VectorXd& u, const MotionModel& like) const {
    return model_with(origin + to_coefficients * u, like);
  }
  Eigen::VectorXd pixels_of(const MotionModel& model) const {
    return to_pixels * (coefficients_of(model) - origin);
  }
  Eigen::VectorXd gradient_by_pixels(const MotionModel& model, const Eigen::VectorXd& by_params) const {
    return to_coefficients.transpose() * (params_by_coefficients(model).transpose() * by_params);
  }

 private:
  // Mean of J^T J over some of the points, with times from their mean.
  static Eigen::MatrixXd displacement_gram(const PointView& points, const MotionModel& model,
                                           const WarpFrame& frame) {
    constexpr std::size_t sample = 256;
    const std::size_t stride = std::max<std::size_t>(1, points.size() / sample);
    double mean_dt = 0;
    std::size_t used = 0;
    for (std::size_t k = 0; k < points.size(); k += stride, ++used) mean_dt += points.dt[k];
    mean_dt /= static_cast<double>(used);
    return std::visit(
        [&](const auto& m) -> Eigen::MatrixXd {
          using Model = std::decay_t<decltype(m)>;
          const typename Model::Warp warp(m, frame);
          Eigen::Matrix<double, Model::dof, Model::dof> sum = decltype(sum)::Zero();
          for (std::size_t k = 0; k < points.size(); k += stride) {
            const auto jacobian =
                warp.jacobian(points.x[k], points.y[k], points.dt[k] - static_cast<float>(mean_dt));
            Eigen::Matrix<double, 2, Model::dof> rows;
            for (int d = 0; d < Model::dof; ++d) {
              rows(0, d) = jacobian.dx[static_cast<std::size_t>(d)];
              rows(1, d) = jacobian.dy[static_cast<std::size_t>(d)];
            }
            if (rows.allFinite()) sum += rows.transpose() * rows;  // a rotation may pass infinity
          }
          return sum / static_cast<double>(used);
        },
        model);
  }
};

}  // namespace

FitResult refine_motion(const PointView& points, const MotionModel& start, const WarpFrame& frame,
                        Region region, const RefineOptions& options, ContrastWorkspace& workspace) {
  FitResult best;
  best.model = clamp_motion(start, options.bounds, frame);
  if (points.size() == 0 || region.area() == 0) return best;
  const Eigen::Index dof = dof_of(kind_of(start));
  const PixelUnits units(points, best.model, frame);

  // The logarithm of the contrast is maximised: steps are in px, gains are relative.
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
      evaluation.gradient = units.gradient_by_pixels(
          model, Eigen::Map<const Eigen::VectorXd>(result.gradient.data(), dof) / result.value);
    }
    return evaluation;
  };

  // Of a contrast peak that a blur of a pixel has rounded: a first guess, put right after the first step.
  constexpr double usual_curvature = 0.5;  // per px^2
  const Eigen::MatrixXd first_guess = Eigen::MatrixXd::Identity(dof, dof) / usual_curvature;
  Eigen::VectorXd u = Eigen::VectorXd::Zero(dof);
  Evaluation now = evaluate(best.model);
  best.contrast = now.value;
  Eigen::MatrixXd inverse_hessian = first_guess;
  bool guessed = true;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    Eigen::VectorXd direction = inverse_hessian * now.gradient;  // ascent
    if (direction.dot(now.gradient) <= 0) {
      inverse_hessian = first_guess;
      guessed = true;
      direction = inverse_hessian * now.gradient;
    }
    // A contrast peak is as wide as an edge is sharp: no step beyond 1 px.
    const double length = direction.norm();
    if (length < options.tolerance) break;
    if (length > 1) direction /= length;

    const double slope = now.gradient.dot(direction);
    double step = 1;
    Eigen::VectorXd next_u;
    Evaluation next{};
    bool risen = false;
    while (step * direction.norm() >= options.tolerance) {
      const MotionModel trial =
          clamp_motion(units.model_at(u + step * direction, best.model), options.bounds, frame);
      next_u = units.pixels_of(trial);
      next = evaluate(trial);
      // Bounds may have bent the step away from the gradient; it must rise all the same.
      if (next.value > now.value + 1e-4 * now.value * std::max(0.0, now.gradient.dot(next_u - u))) {
        risen = true;
        best.model = trial;
        best.contrast = next.value;
        break;
      }
      // The top of the parabola through what is known.
      const double fall = slope * step - (next.value / now.value - 1);
      step *= std::clamp(fall > 0 ? 0.5 * slope * step / fall : 0.5, 0.1, 0.5);
    }
    if (!risen) {
      if (guessed) break;
      inverse_hessian = first_guess;  // one more try along the gradient
      guessed = true;
      continue;
    }
    const Eigen::VectorXd moved = next_u - u;
    const Eigen::VectorXd change = now.gradient - next.gradient;  // of the gradient of -log contrast
    const double curvature = moved.dot(change);
    if (curvature > 1e-12) {
      if (guessed) inverse_hessian = Eigen::MatrixXd::Identity(dof, dof) * (curvature / change.squaredNorm());
      const Eigen::MatrixXd left =
          Eigen::MatrixXd::Identity(dof, dof) - moved * change.transpose() / curvature;
      inverse_hessian = left * inverse_hessian * left.transpose() + moved * moved.transpose() / curvature;
      guessed = false;
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

namespace {

MotionModel moving(const FoundVelocity& velocity, MotionKind kind, const WarpFrame& frame, Region plane) {
  const double params[] = {velocity.vx, velocity.vy};
  return convert_motion(make_motion(MotionKind::translation, params), kind, frame, plane);
}

// The velocity field of the plane's parts: least squares, with the parts that disagree weighted down.
std::optional<MotionModel> field_of_parts(const PointView& points, std::span<const std::uint8_t> positive,
                                          MotionKind kind, const WarpFrame& frame, Region plane,
                                          double max_speed) {
  constexpr int parts = 4;
  constexpr std::size_t events_per_part = 300;  // that look for partners
  struct Part {
    Points points;
    std::vector<std::uint8_t> positive;
  };
  std::vector<Part> members(parts * parts);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const float i = (points.x[k] - static_cast<float>(plane.x0)) * parts / static_cast<float>(plane.width);
    const float j = (points.y[k] - static_cast<float>(plane.y0)) * parts / static_cast<float>(plane.height);
    if (!(i >= 0 && j >= 0 && i < parts && j < parts)) continue;
    Part& part = members[static_cast<std::size_t>(static_cast<int>(j) * parts + static_cast<int>(i))];
    part.points.push_back(points, k);
    part.positive.push_back(positive[k]);
  }

  const float dt = std::max(1e-3f, 0.5f * (points.dt.back() - points.dt.front()));
  std::vector<Correspondence> field;
  for (int j = 0; j < parts; ++j) {
    for (int i = 0; i < parts; ++i) {
      const Part& part = members[static_cast<std::size_t>(j * parts + i)];
      const Region area{plane.x0 + plane.width * i / parts, plane.y0 + plane.height * j / parts,
                        plane.width / parts + 1, plane.height / parts + 1};
      const auto found = find_velocities(part.points.view(), part.positive, area, max_speed, events_per_part);
      if (found.empty()) continue;
      const auto x = static_cast<float>(area.x0 + 0.5 * (area.width - 1));
      const auto y = static_cast<float>(area.y0 + 0.5 * (area.height - 1));
      const auto vx = static_cast<float>(found.front().vx), vy = static_cast<float>(found.front().vy);
      field.push_back({x, y, dt, x - dt * vx, y - dt * vy, 1});
    }
  }
  if (field.size() < 3) return std::nullopt;
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
  return fitted;
}

// Starts that bring about as many events together as the best does; best first.
std::vector<MotionModel> promising(std::vector<MotionModel> starts, const PointView& points,
                                   std::span<const std::uint8_t> positive, const WarpFrame& frame,
                                   Region plane) {
  constexpr std::size_t events = 2000;  // that tell starts apart
  constexpr double share = 0.8;         // of the best's pairs
  constexpr std::size_t most = 3;
  constexpr double apart = 0.5;  // px; nearer starts lead to one end
  std::vector<std::pair<double, std::size_t>> ranked;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    ranked.push_back({count_coincidences(points, positive, starts[i], frame, plane, events), i});
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<MotionModel> kept;
  for (const auto& [pairs, i] : ranked) {
    if (kept.size() == most || pairs < share * ranked.front().first) break;
    const bool new_one = std::all_of(kept.begin(), kept.end(), [&, start = i](const MotionModel& other) {
      return motion_distance(starts[start], other, frame, points) > apart;
    });
    if (new_one) kept.push_back(starts[i]);
  }
  return kept;
}

}  // namespace

FitResult fit_motion(const PointView& points, std::span<const std::uint8_t> positive, MotionKind kind,
                     const WarpFrame& frame, Region plane, const FitOptions& options, ThreadPool& pool,
                     FitWorkspace& workspace) {
  const double max_speed = options.refine.bounds.speed;
  std::vector<MotionModel> starts{make_motion(kind)};
  for (const FoundVelocity& velocity : find_velocities(points, positive, plane, max_speed)) {
    starts.push_back(moving(velocity, kind, frame, plane));
  }
  if (dof_of(kind) > 2 && points.size() > 0) {
    if (const auto field = field_of_parts(points, positive, kind, frame, plane, max_speed))
      starts.push_back(*field);
  }
  starts = promising(std::move(starts), points, positive, frame, plane);

  std::vector<FitResult> results(starts.size());
  workspace.contrast.resize(static_cast<std::size_t>(pool.worker_count()));
  pool.for_each(starts.size(), [&](std::size_t i, int worker) {
    results[i] = refine_motion(points, starts[i], frame, plane, options.refine,
                               workspace.contrast[static_cast<std::size_t>(worker)]);
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
