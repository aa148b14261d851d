#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "emseg/iwe.hpp"
#include "emseg/label_extension.hpp"
#include "emseg/sampling.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr Region plane{0, 0, 96, 72};
const WarpFrame frame = make_warp_frame({96, 72});
const auto taps = gaussian_taps(1.0);

// Two motions that cross: their dots lie in the same part of the image.
Scene crossing(std::uint32_t seed) {
  return moving_dots({{Translation{{300, 60}}, {15, 12, 60, 45}, 60, 20},
                      {Similarity{{-250, 120, 0.3, -0.2}}, {20, 12, 60, 45}, 60, 20}},
                     frame, 0.05, seed);
}

const std::vector<MotionModel> true_models{Translation{{300, 60}}, Similarity{{-250, 120, 0.3, -0.2}}};

std::vector<std::int32_t> labels_of(const Scene& scene, const std::vector<std::size_t>& sample) {
  std::vector<std::int32_t> labels;
  for (const std::size_t k : sample) labels.push_back(scene.source[k]);
  return labels;
}

std::vector<std::int32_t> extended(const Scene& scene, const std::vector<std::size_t>& sample,
                                   const std::vector<std::int32_t>& labels,
                                   const std::vector<MotionModel>& models = true_models) {
  return extend_labels(scene.view(), sample, labels, models, frame, plane, taps);
}

// The definition in double precision, vote by vote: the blurred image of a label's sample where a point
// falls, of its own sign or of either.
double brightness(const Scene& scene, std::size_t k, bool own_sign, const std::vector<std::size_t>& sample,
                  const std::vector<std::int32_t>& labels, std::int32_t label, const MotionModel& model) {
  const auto place = [&](std::size_t event) {
    return reference_warp(model, frame, {scene.points.x[event], scene.points.y[event]},
                          static_cast<double>(scene.points.dt[event]));
  };
  // Shares of the four pixels about a place.
  const auto share = [](double at, int pixel) { return std::max(0.0, 1 - std::abs(at - pixel)); };
  const auto along = [&](double from, double to, int first, int last) {
    double sum = 0;
    for (int voted = static_cast<int>(std::floor(from)); voted <= std::floor(from) + 1; ++voted) {
      if (voted < first || voted > last) continue;
      for (int seen = static_cast<int>(std::floor(to)); seen <= std::floor(to) + 1; ++seen) {
        if (seen < first || seen > last) continue;
        const auto apart = static_cast<std::size_t>(std::abs(seen - voted));
        if (apart < taps.size()) sum += share(from, voted) * share(to, seen) * double(taps[apart]);
      }
    }
    return sum;
  };
  const Region canvas = canvas_of(plane);
  const Place to = place(k);
  double sum = 0;
  for (std::size_t i = 0; i < sample.size(); ++i) {
    if (labels[i] != label) continue;
    const Place from = place(sample[i]);
    const auto& sign = scene.points.sign;
    const double vote = own_sign && !sign.empty() ? sign[k] * sign[sample[i]] : 1;
    sum += vote * along(from.x, to.x, canvas.x0, canvas.x0 + canvas.width - 1) *
           along(from.y, to.y, canvas.y0, canvas.y0 + canvas.height - 1);
  }
  return sum;
}

}  // namespace

TEST_CASE(
    "a point takes the label whose image is brightest where it falls: of its sign, of either, or none") {
  for (const bool is_signed : {false, true}) {
    CAPTURE(is_signed);
    Scene scene = crossing(1);
    std::mt19937 random(1);
    // Points that nobody is near, and a model that throws everything far off.
    for (int k = 0; k < 60; ++k) {
      scene.points.x.push_back(static_cast<float>(uniform(random, 0, 95)));
      scene.points.y.push_back(static_cast<float>(uniform(random, 0, 71)));
      scene.points.dt.push_back(static_cast<float>(uniform(random, -0.025, 0.025)));
      scene.positive.push_back(1);
      scene.source.push_back(-1);
    }
    // Dots keep their sign, mostly.
    if (is_signed) {
      for (const std::uint8_t positive : scene.positive)
        scene.points.sign.push_back((positive != 0) == (random() % 8 != 0) ? 1.0f : -1.0f);
    }
    std::vector<MotionModel> models = true_models;
    models.push_back(Translation{{1e7, 0}});
    models.push_back(Translation{{0, 0}});
    std::vector<std::size_t> sample;
    std::vector<std::int32_t> labels;
    for (std::size_t k = 0; k < scene.size(); k += 9) {
      sample.push_back(k);
      labels.push_back(k % 7 == 0 ? static_cast<std::int32_t>(random() % 5) - 1 : scene.source[k]);
    }
    const auto found = extended(scene, sample, labels, models);
    REQUIRE(found.size() == scene.size());
    std::size_t dark = 0, clear = 0, other_sign = 0, next = 0;
    for (std::size_t k = 0; k < scene.size(); ++k) {
      if (next < sample.size() && sample[next] == k) {
        REQUIRE(found[k] == labels[next++]);
        continue;
      }
      const auto brightness_by_label = [&](bool own_sign) {
        std::vector<double> of_label;
        for (std::int32_t l = 0; l < static_cast<std::int32_t>(models.size()); ++l)
          of_label.push_back(
              brightness(scene, k, own_sign, sample, labels, l, models[static_cast<std::size_t>(l)]));
        return of_label;
      };
      // Brightness that the rounding of places could make or unmake says nothing.
      const auto is_dark = [](double best) { return best == 0 || best < -1e-4; };
      std::vector<double> of_label = brightness_by_label(true);
      double best = *std::ranges::max_element(of_label);
      const bool dark_by_sign = is_dark(best);
      if (dark_by_sign) {
        of_label = brightness_by_label(false);
        best = *std::ranges::max_element(of_label);
      }
      if (is_dark(best)) {
        REQUIRE(found[k] == -1);
        ++dark;
      } else if (best > 1e-4) {
        REQUIRE(found[k] >= 0);
        REQUIRE(of_label[static_cast<std::size_t>(found[k])] > best - 1e-5);
        ++(dark_by_sign ? other_sign : clear);
      }
    }
    CHECK(dark > 5);
    CHECK((is_signed ? other_sign > 5 : other_sign == 0));
    CHECK(clear > (is_signed ? 1000 : 1500));
  }
}

TEST_CASE("two motions that cross are told apart for all events by a tenth of them") {
  const Scene scene = crossing(2);
  const auto sample = even_sample(scene.size(), scene.size() / 10);
  const auto found = extended(scene, sample, labels_of(scene, sample));
  std::size_t right = 0;
  for (std::size_t k = 0; k < scene.size(); ++k) right += found[k] == scene.source[k];
  CHECK(static_cast<double>(right) > 0.85 * static_cast<double>(scene.size()));
}

TEST_CASE("a sample of all keeps its labels, right or wrong") {
  const Scene scene = crossing(3);
  const auto all = even_sample(scene.size(), scene.size());
  std::mt19937 random(3);
  std::vector<std::int32_t> labels;
  for (std::size_t k = 0; k < scene.size(); ++k)
    labels.push_back(static_cast<std::int32_t>(random() % 3) - 1);
  CHECK(extended(scene, all, labels) == labels);
}

TEST_CASE("without a sample, models or points there are no labels") {
  const Scene scene = crossing(4);
  const std::vector<std::int32_t> none(scene.size(), -1);
  CHECK(extended(scene, {}, {}) == none);
  CHECK(extended(scene, {}, {}, {}) == none);
  CHECK(extended(scene, {3, 8}, {-1, -1}) == none);
  CHECK(extended({}, {}, {}).empty());
}
