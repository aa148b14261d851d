#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "emseg/data_term.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr std::array terms{DataTerm::published, DataTerm::logarithmic};

double defined_cost(DataTerm term, double sharpness, double reference) {
  const double g = std::min(1.0, sharpness / reference);
  constexpr double f = 0.05;
  return term == DataTerm::published ? 255 * (1 - g)
                                     : 255 * std::log((1 + f) / (g + f)) / std::log((1 + f) / f);
}

// numpy.quantile, linear: between the two order statistics around rank q (n - 1).
double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const double rank = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(std::floor(rank)),
             above = static_cast<std::size_t>(std::ceil(rank));
  return values[below] + (rank - std::floor(rank)) * (values[above] - values[below]);
}

}  // namespace

TEST_CASE("the cost of an event is that of its definition") {
  for (const DataTerm term : terms) {
    for (const float reference : {0.3f, 1.0f, 17.5f}) {
      CHECK(event_cost(term, 0, reference) == doctest::Approx(255));
      CHECK(event_cost(term, reference, reference) == doctest::Approx(0));
      CHECK(event_cost(term, 3 * reference, reference) == doctest::Approx(0));
      float last = 256;
      for (int i = 0; i <= 100; ++i) {
        const float sharpness = reference * static_cast<float>(i) / 100;
        const float cost = event_cost(term, sharpness, reference);
        REQUIRE(cost == doctest::Approx(defined_cost(term, sharpness, reference)).epsilon(1e-4));
        REQUIRE(cost < last);  // sharper is cheaper
        last = cost;
      }
    }
    CHECK(event_cost(term, 0, 0) == 0);  // nothing is sharp: all models are equal
  }
}

TEST_CASE("integer costs are rounded multiples of the cost") {
  std::mt19937 random(2);
  for (const DataTerm term : terms) {
    for (const double lambda : {0.0, 1.0, 2.5, 1e6}) {
      std::vector<float> sharpness;
      for (int k = 0; k < 500; ++k) sharpness.push_back(static_cast<float>(uniform(random, 0, 6)));
      std::vector<std::int32_t> costs(sharpness.size(), -1);
      integer_costs(term, sharpness, 5.0, lambda, costs);
      for (std::size_t k = 0; k < costs.size(); ++k) {
        // Half a unit of rounding, and the digits that a float has.
        const double exact = lambda * defined_cost(term, sharpness[k], 5.0);
        REQUIRE(std::abs(costs[k] - exact) <= 0.5 + lambda * 1e-4);
      }
    }
  }
}

TEST_CASE("costs of many events are those of each, but for roundings of their logarithms") {
  std::mt19937 random(4);
  for (const DataTerm term : terms) {
    for (const double reference : {0.3, 5.0, 800.0}) {
      for (const double lambda : {1.0, 2.5, 10.0}) {
        // Chunks end anywhere; nothing, little, the reference and more than it.
        std::vector<float> sharpness{0, 1e-30f, static_cast<float>(reference), 1e30f};
        for (int k = 0; k < 20'001; ++k)
          sharpness.push_back(static_cast<float>(uniform(random, 0, 1.2 * reference)));
        std::vector<std::int32_t> costs(sharpness.size(), -1);
        integer_costs(term, sharpness, reference, lambda, costs);
        std::size_t different = 0;
        for (std::size_t k = 0; k < costs.size(); ++k) {
          const std::int32_t own = integer_cost(term, sharpness[k], reference, lambda);
          const float cost = event_cost(term, sharpness[k], static_cast<float>(reference));
          REQUIRE(own == std::lround(static_cast<float>(lambda) * cost));
          REQUIRE(std::abs(costs[k] - own) <= 1);
          different += costs[k] != own;
        }
        CHECK(different <= costs.size() / 1000);
      }
    }
    // Nothing is sharp: all models are equal.
    std::vector<std::int32_t> costs(700, -1);
    integer_costs(term, std::vector<float>(700, 0.0f), 0, 1, costs);
    CHECK(std::count(costs.begin(), costs.end(), 0) == 700);
  }
}

TEST_CASE("the reference is the largest pixel, or numpy's 95 % quantile of every event's best") {
  std::mt19937 random(3);
  for (const std::size_t events : {1u, 2u, 20u, 21u, 40u, 333u}) {
    CAPTURE(events);
    std::vector<ModelSupport> supports(3);
    std::vector<const ModelSupport*> pointers;
    std::vector<double> best(events, 0.0);
    for (ModelSupport& support : supports) {
      support.peak = static_cast<float>(uniform(random, 1, 9));
      for (std::size_t k = 0; k < events; ++k) {
        support.sharpness.push_back(static_cast<float>(uniform(random, 0, 8)));
        best[k] = std::max(best[k], double(support.sharpness[k]));
      }
      pointers.push_back(&support);
    }
    CHECK(reference_sharpness(DataTerm::published, pointers) ==
          std::max({supports[0].peak, supports[1].peak, supports[2].peak}));
    CHECK(reference_sharpness(DataTerm::logarithmic, pointers) ==
          doctest::Approx(quantile(best, 0.95)).epsilon(1e-6));
  }
}

TEST_CASE("without models or events there is no reference") {
  const ModelSupport nothing;
  const ModelSupport* one = &nothing;
  for (const DataTerm term : terms) {
    CHECK(reference_sharpness(term, {}) == 0);
    CHECK(reference_sharpness(term, {&one, 1}) == 0);
  }
}

TEST_CASE("sharpness is the blurred image where each event falls, though the image covers the events alone") {
  const WarpFrame frame = make_warp_frame({60, 44});
  const Region canvas = canvas_of({0, 0, 60, 44});
  const auto taps = gaussian_taps(1.3);
  const Scene scene =
      moving_dots({{Similarity{{150, 80, 0.5, -0.6}}, {6, 10, 30, 20}, 40, 8}}, frame, 0.06, 5);
  IweWorkspace workspace;
  IweWorkspace iwe;
  // The true model, a wrong one, and one that throws most events off the canvas.
  for (const MotionModel& model :
       {MotionModel(Similarity{{150, 80, 0.5, -0.6}}), MotionModel(Translation{{-300, 90}}),
        MotionModel(Translation{{9000, 0}}), MotionModel(Translation{{1e30, 1e30}})}) {
    ModelSupport support;
    evaluate_support(scene.view(), model, frame, canvas, taps, workspace, support);
    Image image(canvas);
    make_iwe(image, scene.view(), model, frame, taps, iwe);
    CHECK(support.peak == doctest::Approx(*std::max_element(image.pixels.begin(), image.pixels.end())));
    REQUIRE(support.sharpness.size() == scene.size());
    std::vector<float> x(scene.size()), y(scene.size());
    warp_points(scene.view(), model, frame, x, y);
    for (std::size_t k = 0; k < scene.size(); ++k) {
      REQUIRE(std::abs(support.sharpness[k] - bilinear_value(image, x[k], y[k])) < 1e-4);
    }
  }
}

TEST_CASE("data terms have names") {
  CHECK(data_term("published") == DataTerm::published);
  CHECK(data_term("logarithmic") == DataTerm::logarithmic);
  CHECK_THROWS_AS(data_term("quadratic"), std::invalid_argument);
}
