// Fitting one motion model to events by contrast maximisation: search, then quasi-Newton refinement.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/contrast.hpp"
#include "emseg/parallel.hpp"

namespace emseg {

// Largest parameters that a fit may reach.  Rates beyond these squeeze events together (event collapse, Shiba
// et al. 2022) rather than explain them.
struct MotionBounds {
  double speed = 5000;      // |vx|, |vy|, px/s (Affine_trans2d_max)
  double scale_rate = 0.5;  // |s|, 1/s (Affine_scale_max)
  double angle_rate = 1.5;  // |theta|, rad/s (Affine_theta_max)

  // Of affine and homography coefficients; a matrix entry can hold a scale or a turn.
  double linear_rate() const { return std::max(scale_rate, angle_rate); }
};

MotionModel clamp_motion(const MotionModel& model, const MotionBounds& bounds, const WarpFrame& frame);

struct RefineOptions {
  ContrastOptions contrast;
  MotionBounds bounds;
  int max_iterations = 30;
  double tolerance = 0.01;  // stops when a step moves the points less than this, px root mean square
};

struct FitResult {
  MotionModel model;
  double contrast = 0;
  int evaluations = 0;
};

// Climbs from `start` by BFGS with a backtracking line search, in parameters in which a step's length is the
// root-mean-square displacement it makes, and returns the best model it met.
FitResult refine_motion(const PointView& points, const MotionModel& start, const WarpFrame& frame,
                        Region region, const RefineOptions& options, ContrastWorkspace& workspace);

struct FitOptions {
  RefineOptions refine;
};

// Memory of fit_motion, kept from one call to the next.  Not for two calls at a time.
struct FitWorkspace {
  std::vector<ContrastWorkspace> contrast;  // one for each worker of the pool
};

// Where to evaluate a fit that starts from `start`: around the warped events, with room to move.
Region fit_region(const PointView& points, const MotionModel& start, const WarpFrame& frame, Region plane);

// The model of this kind with the highest contrast over `plane`: starts from velocities at which events
// reappear and from the velocity field of the plane's parts, and refines the most promising.  `points` are
// sorted by dt.
FitResult fit_motion(const PointView& points, std::span<const std::uint8_t> positive, MotionKind kind,
                     const WarpFrame& frame, Region plane, const FitOptions& options, ThreadPool& pool,
                     FitWorkspace& workspace);

}  // namespace emseg
