// Windows of which a caller knows what moves in them.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "segmenter_windows.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

const WarpFrame frame = make_warp_frame(sensor);
const MotionModel faint_motion = Similarity{{-150, 120, 0, 0}};

// A scene, and something small before it that makes few events: 1 in `source`.
const RecordedEvents& faint_object() {
  static const RecordedEvents events = [] {
    RecordedEvents made = recorded(moving_dots({{scene_motion, {-10, -10, 180, 50}, 150, 12},
                                                {scene_motion, {-10, 70, 180, 60}, 150, 12},
                                                {scene_motion, {-10, 40, 80, 30}, 40, 12},
                                                {scene_motion, {94, 40, 70, 30}, 40, 12},
                                                {faint_motion, {74, 46, 16, 16}, 20, 12}},
                                               frame, 0.04, 3),
                                   sensor, t_middle);
    for (std::int32_t& source : made.source) source = source == 4;
    return made;
  }();
  return events;
}

// A label's cost is more than the object's events are worth, but its half is not.
SegmenterOptions dear_labels(int threads = 2) {
  SegmenterOptions options = quiet_options(threads);
  options.lambda_label = 32'000;
  return options;
}

WindowPrior known(const std::vector<MotionModel>& candidates, const std::vector<MotionModel>& tracked) {
  WindowPrior prior;
  prior.candidates = candidates;
  prior.tracked = tracked;
  return prior;
}

std::int64_t found_of_object(const Segmentation& result) {
  std::int64_t found = 0;
  for (std::size_t k = 0; k < result.labels.size(); ++k)
    found += faint_object().source[k] == 1 && result.labels[k] == 1;
  return found;
}

}  // namespace

TEST_CASE("what is faint is found while it is tracked, and the labels are the same for 1, 2 and 7 threads") {
  const RecordedEvents& events = faint_object();
  const auto object_events = std::ranges::count(events.source, 1);
  for (const WindowPrior& prior : {known({}, {}), known({scene_motion, faint_motion}, {})}) {
    const Segmentation alone = segmented(events, dear_labels(), prior);
    check_sound(alone, events.size());
    CHECK(alone.models.size() == 1);
  }
  const Segmentation result = segmented(events, dear_labels(), known({scene_motion}, {faint_motion}));
  check_sound(result, events.size());
  REQUIRE(result.models.size() == 2);
  CHECK(motion_distance(result.models[1], faint_motion, frame, make_points(events.view(), t_middle).view()) <
        0.5);
  CHECK(static_cast<double>(found_of_object(result)) > 0.8 * static_cast<double>(object_events));
  for (const int threads : {1, 7}) {
    const Segmentation again = segmented(events, dear_labels(threads), known({scene_motion}, {faint_motion}));
    CHECK(again.labels == result.labels);
    CHECK(again.energy_trace == result.energy_trace);
  }
}

TEST_CASE("a tracked object's label costs its share, and at full price it is no cheaper than any other") {
  const RecordedEvents& events = faint_object();
  SegmenterOptions options = dear_labels();
  options.tracked_share = 1;
  CHECK(segmented(events, options, known({scene_motion}, {faint_motion})).models.size() == 1);
  // Labels of the models given: what differs is what the object's label costs.
  options.num_iter_segmentation = 0;
  options.lambda_label = 800;
  const auto energy = [&](double share) {
    options.tracked_share = share;
    const Segmentation result = segmented(events, options, known({scene_motion}, {faint_motion}));
    REQUIRE(result.models.size() == 2);
    return result.energy;
  };
  CHECK(energy(1) > energy(0.5));
  CHECK(energy(0.5) > energy(0));
}

TEST_CASE("what is tracked but no longer there gets no label") {
  const RecordedEvents& events = two_motions();
  const std::vector<MotionModel> gone{Similarity{{700, -650, 0, 0}}};
  const Segmentation result =
      segmented(events, quiet_options(), known({scene_motion}, {object_motion, gone[0]}));
  check_sound(result, events.size());
  REQUIRE(result.models.size() == 2);
  for (const MotionModel& model : result.models)
    CHECK(motion_distance(model, gone[0], frame, make_points(events.view(), t_middle).view()) > 3);
}

TEST_CASE("shares, doubts and tracked motions out of range are refused") {
  SegmenterOptions options;
  for (const double share : {-0.1, 1.1, std::nan("")}) {
    options.tracked_share = share;
    CHECK_THROWS_AS(options.check(), std::invalid_argument);
  }
  options.tracked_share = 1;
  for (const double doubt : {-1.0, 255.5, std::nan("")}) {
    options.axis_doubt = doubt;
    CHECK_THROWS_AS(options.check(), std::invalid_argument);
  }
  options.axis_doubt = 255;
  options.check();
  options.axis_doubt = -1;
  CHECK_THROWS_WITH_AS(options.check(), "axis_doubt is -1.000000, expected 0..255", std::invalid_argument);
  CHECK_THROWS_AS(segmented(two_motions(), quiet_options(), known({}, {Translation{{NAN, 0}}})),
                  std::invalid_argument);
}
