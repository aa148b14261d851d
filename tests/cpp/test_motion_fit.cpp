#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "emseg/motion_fit.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{160, 120};
constexpr Region plane{0, 0, 160, 120};
constexpr Region middle{24, 20, 112, 80};
constexpr double duration = 0.05;

const std::vector<MotionModel>& truths() {
  static const std::vector<MotionModel> all{
      Translation{{180, -120}}, Rotation{{0.5, -0.8, 0.9}}, Similarity{{90, 60, 0.4, -0.7}},
      Affine{{-70, 100, 0.4, -0.6, 0.5, -0.3}}, Homography{{60, -80, 0.5, -0.4, 0.6, -0.3, 0.5, -0.4}}};
  return all;
}

Scene dots(const MotionModel& model, const WarpFrame& frame, std::uint32_t seed) {
  return moving_dots({{model, middle, 150, 14}}, frame, duration, seed);
}

// A model near this one: every parameter off by as much as moves the points `distance` px, then all of it
// scaled to that.
MotionModel perturbed(const MotionModel& model, const WarpFrame& frame, const PointView& points,
                      double distance, std::mt19937& random) {
  const std::vector<double> params(params_of(model).begin(), params_of(model).end());
  std::vector<double> offset;
  for (std::size_t d = 0; d < params.size(); ++d) {
    std::vector<double> unit(params);
    unit[d] += 1e-2;
    const double leverage = motion_distance(model, make_motion(kind_of(model), unit), frame, points) / 1e-2;
    offset.push_back(uniform(random, -1, 1) * distance / leverage);
  }
  const auto moved = [&](double scale) {
    std::vector<double> at(params);
    for (std::size_t d = 0; d < at.size(); ++d) at[d] += scale * offset[d];
    return make_motion(kind_of(model), at);
  };
  return moved(distance / motion_distance(model, moved(1), frame, points));
}

double contrast_of(const Scene& scene, const MotionModel& model, const WarpFrame& frame,
                   const RefineOptions& options) {
  ContrastWorkspace workspace;
  return contrast(scene.view(), model, frame, plane, options.contrast, workspace);
}

}  // namespace

TEST_CASE("refinement climbs back from one and from two pixels off") {
  std::mt19937 random(1);
  const WarpFrame frame = make_warp_frame(sensor);
  RefineOptions options;
  options.contrast.measure = ContrastMeasure::mean_square;
  ContrastWorkspace workspace;
  for (const MotionModel& truth : truths()) {
    CAPTURE(name_of(kind_of(truth)));
    const Scene scene = dots(truth, frame, 2);
    for (const double distance : {1.0, 2.0}) {
      CAPTURE(distance);
      for (int trial = 0; trial < 3; ++trial) {
        const MotionModel start = perturbed(truth, frame, scene.view(), distance, random);
        const FitResult fit = refine_motion(scene.view(), start, frame, plane, options, workspace);
        CHECK(kind_of(fit.model) == kind_of(truth));
        CHECK(motion_distance(fit.model, truth, frame, scene.view()) < 0.1);
        CHECK(fit.contrast == doctest::Approx(contrast_of(scene, fit.model, frame, options)));
        CHECK(fit.evaluations < 150);
      }
    }
  }
}

TEST_CASE("refinement never ends below its start, and never beyond its bounds") {
  std::mt19937 random(3);
  const WarpFrame frame = make_warp_frame(sensor);
  ContrastWorkspace workspace;
  for (const MotionModel& truth : truths()) {
    CAPTURE(name_of(kind_of(truth)));
    const Scene scene = dots(truth, frame, 4);
    for (const ContrastMeasure measure :
         {ContrastMeasure::variance, ContrastMeasure::mean_square, ContrastMeasure::gradient_magnitude}) {
      for (int trial = 0; trial < 4; ++trial) {
        RefineOptions options;
        options.contrast.measure = measure;
        // Bounds that the truth lies well within, at, or beyond.
        const double tightness = uniform(random, 0.2, 1.5);
        options.bounds = {180 * tightness, 0.5 * tightness, 0.9 * tightness};
        options.max_iterations = trial == 0 ? 0 : 15;
        const MotionModel start = perturbed(truth, frame, scene.view(), uniform(random, 0, 6), random);
        const MotionModel allowed = clamp_motion(start, options.bounds, frame);
        const FitResult fit = refine_motion(scene.view(), start, frame, plane, options, workspace);
        REQUIRE(fit.contrast >= contrast_of(scene, allowed, frame, options));
        const MotionModel clamped = clamp_motion(fit.model, options.bounds, frame);
        REQUIRE(motion_distance(fit.model, clamped, frame, scene.view()) == 0);
      }
    }
  }
}

TEST_CASE("bounds are those of the parameters") {
  const WarpFrame frame = make_warp_frame({100, 80});  // focal length 100 px
  const MotionBounds bounds{50, 0.2, 0.4};
  const auto clamped = [&](const MotionModel& model) {
    const MotionModel result = clamp_motion(model, bounds, frame);
    return std::vector<double>(params_of(result).begin(), params_of(result).end());
  };
  using Params = std::vector<double>;
  CHECK(clamped(Translation{{-70, 20}}) == Params{-50, 20});
  CHECK(clamped(Rotation{{0.6, -0.6, 0.1}}) == Params{0.5, -0.5, 0.1});  // 50 px/s over 100 px
  CHECK(clamped(Similarity{{70, 0, -0.3, 0.5}}) == Params{50, 0, -0.2, 0.4});
  CHECK(clamped(Affine{{0, -80, 0.5, -0.5, 0.3, 0}}) == Params{0, -50, 0.4, -0.4, 0.3, 0});
  CHECK(clamped(Homography{{0, 0, 0.5, 0, 0, 0, -9, 9}}) == Params{0, 0, 0.4, 0, 0, 0, -0.4, 0.4});
}

TEST_CASE("nothing to refine: no points, no region, one time") {
  const WarpFrame frame = make_warp_frame(sensor);
  ContrastWorkspace workspace;
  const Points one{{20}, {30}, {0}};
  for (const MotionModel& start : truths()) {
    for (const auto& [points, region] :
         {std::pair{PointView{}, plane}, {one.view(), Region{0, 0, 0, 120}}, {one.view(), plane}}) {
      const FitResult fit = refine_motion(points, start, frame, region, {}, workspace);
      CHECK(motion_distance(fit.model, start, frame, dots(start, frame, 5).view()) < 1e-6);
      CHECK(fit.contrast >= 0);
    }
  }
}

TEST_CASE("a rotation that turns points through the camera's plane harms nothing") {
  const WarpFrame frame = make_warp_frame(sensor);
  // Half a turn about the image's axes: bearings pass through the plane of the camera, and places through
  // infinity.
  const Scene scene = dots(Translation{{100, 0}}, frame, 6);
  Scene slow = scene;
  for (float& dt : slow.points.dt) dt *= 100;
  RefineOptions options;
  options.bounds = {1e7, 100, 100};
  ContrastWorkspace workspace;
  const FitResult fit = refine_motion(slow.view(), Rotation{{3, 0, 0}}, frame, plane, options, workspace);
  for (const double rate : params_of(fit.model)) CHECK(std::isfinite(rate));
}

TEST_CASE("the region of a fit holds the warped events and room to move") {
  const WarpFrame frame = make_warp_frame(sensor);
  const Points points{{50, 60}, {40, 70}, {0.1f, 0.1f}};
  CHECK(fit_region(points.view(), Translation{{100, 0}}, frame, plane) == Region{32, 32, 28, 48});
  CHECK(fit_region(points.view(), Translation{{-1e6, 0}}, frame, plane).area() > 0);
  CHECK(fit_region({}, Translation{}, frame, plane).area() == 0);
}

TEST_CASE("a fit finds the motion from nothing, of every kind") {
  const WarpFrame frame = make_warp_frame(sensor);
  FitOptions options;
  options.refine.contrast.measure = ContrastMeasure::variance;
  ThreadPool pool(2);
  FitWorkspace workspace;  // what an earlier fit leaves in it must not matter
  for (const MotionModel& truth : truths()) {
    CAPTURE(name_of(kind_of(truth)));
    const Scene scene = dots(truth, frame, 7);
    const FitResult fit =
        fit_motion(scene.view(), scene.positive, kind_of(truth), frame, plane, options, pool, workspace);
    CHECK(kind_of(fit.model) == kind_of(truth));
    CHECK(motion_distance(fit.model, truth, frame, scene.view()) < 0.15);
    CHECK(fit.contrast >= contrast_of(scene, make_motion(kind_of(truth)), frame, options.refine));
    for (const int threads : {1, 7}) {
      ThreadPool other(threads);
      FitWorkspace other_workspace;
      const FitResult again = fit_motion(scene.view(), scene.positive, kind_of(truth), frame, plane, options,
                                         other, other_workspace);
      CHECK(motion_distance(again.model, fit.model, frame, scene.view()) == 0);
      CHECK(again.evaluations == fit.evaluations);
    }
  }
}

TEST_CASE("a fit to no event, one event or one time is no motion") {
  const WarpFrame frame = make_warp_frame(sensor);
  ThreadPool pool(1);
  FitWorkspace workspace;
  for (const MotionModel& kind : truths()) {
    Points points;
    std::vector<std::uint8_t> positive;
    for (int events = 0; events < 3; ++events) {
      const FitResult fit =
          fit_motion(points.view(), positive, kind_of(kind), frame, plane, {}, pool, workspace);
      for (const double rate : params_of(fit.model)) CHECK(rate == 0);
      points.x.push_back(20 + static_cast<float>(events));
      points.y.push_back(30);
      points.dt.push_back(0);
      positive.push_back(1);
    }
  }
}
