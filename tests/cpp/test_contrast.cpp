#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <stdexcept>

#include "central_differences.hpp"
#include "emseg/contrast.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr std::array measures{ContrastMeasure::variance, ContrastMeasure::mean_square,
                              ContrastMeasure::gradient_magnitude};
constexpr Region region{-3, 2, 34, 27};

// The whole chain again in double precision: votes, blur, measure.
class DirectContrast {
 public:
  DirectContrast(const Points& points, MotionKind kind, const WarpFrame& frame,
                 const ContrastOptions& options)
      : points_(points),
        kind_(kind),
        frame_(frame),
        measure_(options.measure),
        taps_(gaussian_taps(options.sigma)) {}

  double operator()(const std::vector<double>& params) const {
    std::vector<double> image(region.area(), 0.0);
    const auto add = [&](int column, int row, double weight) {
      if (inside(column, row)) image[index(column, row)] += weight;
    };
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const Place at = reference_warp(kind_, params, frame_, {points_.x[k], points_.y[k]}, points_.dt[k]);
      const double u = at.x - region.x0, v = at.y - region.y0;
      const int i = static_cast<int>(std::floor(u)), j = static_cast<int>(std::floor(v));
      const double right = u - i, low = v - j;
      const double vote = points_.sign.empty() ? 1 : points_.sign[k];
      add(i, j, vote * (1 - right) * (1 - low));
      add(i + 1, j, vote * right * (1 - low));
      add(i, j + 1, vote * (1 - right) * low);
      add(i + 1, j + 1, vote * right * low);
    }
    return measured(blurred(blurred(image, 1, 0), 0, 1));
  }

 private:
  static bool inside(int column, int row) {
    return column >= 0 && row >= 0 && column < region.width && row < region.height;
  }
  static std::size_t index(int column, int row) {
    return static_cast<std::size_t>(row * region.width + column);
  }

  std::vector<double> blurred(const std::vector<double>& image, int dx, int dy) const {
    const int radius = static_cast<int>(taps_.size()) - 1;
    std::vector<double> result(image.size(), 0.0);
    for (int row = 0; row < region.height; ++row) {
      for (int column = 0; column < region.width; ++column) {
        for (int d = -radius; d <= radius; ++d) {
          if (!inside(column + d * dx, row + d * dy)) continue;
          result[index(column, row)] +=
              taps_[static_cast<std::size_t>(std::abs(d))] * image[index(column + d * dx, row + d * dy)];
        }
      }
    }
    return result;
  }

  double measured(const std::vector<double>& image) const {
    const auto at = [&](int column, int row) {
      return inside(column, row) ? image[index(column, row)] : 0.0;
    };
    double mean = 0;
    for (const double pixel : image) mean += pixel / static_cast<double>(image.size());
    double sum = 0;
    for (int row = 0; row < region.height; ++row) {
      for (int column = 0; column < region.width; ++column) {
        if (measure_ == ContrastMeasure::gradient_magnitude) {
          const double dx = (at(column + 1, row) - at(column - 1, row)) / 2;
          const double dy = (at(column, row + 1) - at(column, row - 1)) / 2;
          sum += dx * dx + dy * dy;
        } else {
          const double centre = measure_ == ContrastMeasure::variance ? mean : 0;
          sum += (at(column, row) - centre) * (at(column, row) - centre);
        }
      }
    }
    return sum / static_cast<double>(image.size());
  }

  const Points& points_;
  MotionKind kind_;
  const WarpFrame& frame_;
  ContrastMeasure measure_;
  std::vector<float> taps_;
};

const std::vector<MotionModel>& motions() {
  static const std::vector<MotionModel> all{
      Translation{{130, -70}}, Rotation{{0.8, -1.1, 0.5}}, Similarity{{60, 90, 0.4, -0.9}},
      Affine{{-50, 80, 0.5, -0.7, 0.3, 0.9}}, Homography{{40, -90, 0.6, -0.3, 0.8, -0.5, 0.9, -0.7}}};
  return all;
}

// Points in and around the region whose warped places keep clear of whole pixels, where the bilinear vote has
// its kinks: there the contrast is smooth, and a small step crosses no kink.
Points smooth_points(std::mt19937& random, const MotionModel& model, const WarpFrame& frame,
                     std::size_t count) {
  Points points;
  while (points.size() < count) {
    const auto x = static_cast<float>(uniform(random, -8, 36)),
               y = static_cast<float>(uniform(random, -3, 34));
    const auto dt = static_cast<float>(uniform(random, -0.05, 0.05));
    const Place at = reference_warp(model, frame, {x, y}, dt);
    const auto clear = [](double place) { return std::abs(place - std::round(place)) > 0.02; };
    if (!clear(at.x) || !clear(at.y)) continue;
    points.x.push_back(x);
    points.y.push_back(y);
    points.dt.push_back(dt);
  }
  return points;
}

}  // namespace

TEST_CASE(
    "contrast is that of a direct evaluation, its gradient that of central differences, signed or not") {
  std::mt19937 random(1);
  const WarpFrame frame = make_warp_frame({32, 28});
  ContrastWorkspace workspace;
  for (const MotionModel& model : motions()) {
    const MotionKind kind = kind_of(model);
    CAPTURE(name_of(kind));
    for (const bool is_signed : {false, true}) {
      CAPTURE(is_signed);
      Points points = smooth_points(random, model, frame, 700);
      if (is_signed) points.sign = random_signs(random, points.size());
      const std::vector<double> params(params_of(model).begin(), params_of(model).end());
      std::vector<double> steps;  // that move no point by more than 1e-3 px
      for (std::size_t d = 0; d < params.size(); ++d)
        steps.push_back(kind != MotionKind::rotation && d < 2 ? 1e-2 : 2e-4);
      for (const ContrastMeasure measure : measures) {
        for (const double sigma : {0.0, 1.0}) {
          CAPTURE(static_cast<int>(measure));
          CAPTURE(sigma);
          const ContrastOptions options{measure, sigma};
          const DirectContrast direct(points, kind, frame, options);
          const ContrastResult result =
              contrast_and_gradient(points.view(), model, frame, region, options, workspace);
          CHECK(result.value == doctest::Approx(direct(params)).epsilon(1e-5));
          CHECK(contrast(points.view(), model, frame, region, options, workspace) == result.value);
          const auto slopes = central_differences(direct, params, steps);
          for (std::size_t d = 0; d < params.size(); ++d) {
            CAPTURE(d);
            // Sums of 700 floats of either sign: digits are those of the terms, not of what is left of them.
            double terms = 0;
            for (std::size_t e = 0; e < params.size(); ++e) terms += std::abs(slopes[e] * steps[e]);
            CHECK(std::abs(result.gradient[d] - slopes[d]) * steps[d] < 1e-4 * terms);
          }
          for (std::size_t d = params.size(); d < 8; ++d) CHECK(result.gradient[d] == 0);
        }
      }
    }
  }
}

TEST_CASE("events in focus have more contrast than blurred ones, by every measure") {
  const WarpFrame frame = make_warp_frame({64, 48});
  const MotionModel truth = Translation{{200, -120}};
  const Scene scene = moving_dots({{truth, {8, 8, 48, 32}, 60, 10}}, frame, 0.05, 3);
  ContrastWorkspace workspace;
  for (const ContrastMeasure measure : measures) {
    const auto value = [&](const MotionModel& model) {
      return contrast(scene.view(), model, frame, {0, 0, 64, 48}, {measure, 1}, workspace);
    };
    CHECK(value(truth) > value(Translation{{120, -60}}));
    CHECK(value(truth) > value(Translation{}));
  }
}

TEST_CASE("no points, or none that the region sees, have no contrast and no slope") {
  const WarpFrame frame = make_warp_frame({32, 28});
  const Points away{{500, -500}, {3, 3}, {0.01f, 0.02f}};
  ContrastWorkspace workspace;
  for (const ContrastMeasure measure : measures) {
    for (const PointView& points : {PointView{}, away.view()}) {
      const auto result = contrast_and_gradient(points, Similarity{{10, 10, 0.1, 0.1}}, frame, region,
                                                {measure, 1}, workspace);
      CHECK(result.value == 0);
      for (const double slope : result.gradient) CHECK(slope == 0);
    }
  }
}

TEST_CASE("measures have names") {
  CHECK(contrast_measure("variance") == ContrastMeasure::variance);
  CHECK(contrast_measure("mean_square") == ContrastMeasure::mean_square);
  CHECK(contrast_measure("gradient_magnitude") == ContrastMeasure::gradient_magnitude);
  CHECK_THROWS_AS(contrast_measure("entropy"), std::invalid_argument);
}
