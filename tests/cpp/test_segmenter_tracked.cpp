// Windows of which a caller knows what moves in them.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "segmenter_windows.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

const WarpFrame frame = make_warp_frame(sensor);
const MotionModel faint_motion = Similarity{{-150, 120, 0, 0}};

// A scene, and something small before it that makes few events.
const RecordedEvents& faint_object() {
  static const RecordedEvents events = object_before_scene({{scene_motion, {-10, -10, 180, 50}, 150, 12},
                                                            {scene_motion, {-10, 70, 180, 60}, 150, 12},
                                                            {scene_motion, {-10, 40, 80, 30}, 40, 12},
                                                            {scene_motion, {94, 40, 70, 30}, 40, 12},
                                                            {faint_motion, {74, 46, 16, 16}, 20, 12}},
                                                           3);
  return events;
}

// A label's cost is more than the object's events are worth, but its half is not.
SegmenterOptions dear_labels(int threads = 2) {
  SegmenterOptions options = quiet_options(threads);
  options.lambda_label = 32'000;
  return options;
}

WindowPrior known(const std::vector<MotionModel>& candidates, const std::vector<TrackedObject>& tracked) {
  WindowPrior prior;
  prior.t_ref = t_middle;
  prior.candidates = candidates;
  prior.tracked = tracked;
  return prior;
}

// The faint object as a motion brings it `seen` s after t_middle, when it was known to move by it.
TrackedObject known_object(const MotionModel& motion, double seen) {
  TrackedObject object{motion, {}, seen};
  for (int y = 46; y < 62; y += 2) {
    for (int x = 74; x < 90; x += 2) {
      const Place then =
          reference_unwarp(motion, frame, {static_cast<double>(x), static_cast<double>(y)}, seen);
      object.places.push_back({static_cast<float>(then.x), static_cast<float>(then.y)});
    }
  }
  return object;
}

double share_found(const Segmentation& result) {
  double found = 0;
  for (std::size_t k = 0; k < result.labels.size(); ++k)
    found += faint_object().source[k] == 1 && result.labels[k] == 1;
  return found / static_cast<double>(std::ranges::count(faint_object().source, 1));
}

double off(const MotionModel& model, const MotionModel& truth, const RecordedEvents& events) {
  return motion_distance(model, truth, frame, make_points(events.view(), t_middle).view());
}

void check_alike_for_any_threads(const Segmentation& result, SegmenterOptions options,
                                 const WindowPrior& prior) {
  for (const int threads : {1, 7}) {
    options.threads = threads;
    const Segmentation again = segmented(faint_object(), options, prior);
    CHECK(again.labels == result.labels);
    CHECK(again.energy_trace == result.energy_trace);
  }
}

}  // namespace

TEST_CASE("what is faint is found while it is tracked, and the labels are the same for 1, 2 and 7 threads") {
  const RecordedEvents& events = faint_object();
  for (const WindowPrior& prior : {known({}, {}), known({scene_motion, faint_motion}, {})}) {
    const Segmentation alone = segmented(events, dear_labels(), prior);
    check_sound(alone, events.size());
    CHECK(alone.models.size() == 1);
  }
  const WindowPrior prior = known({scene_motion}, {{faint_motion}});
  const Segmentation result = segmented(events, dear_labels(), prior);
  check_sound(result, events.size());
  REQUIRE(result.models.size() == 2);
  CHECK(off(result.models[1], faint_motion, events) < 0.5);
  CHECK(share_found(result) > 0.8);
  check_alike_for_any_threads(result, dear_labels(), prior);
}

TEST_CASE("a tracked object's label costs its share, and at full price it is no cheaper than any other") {
  const RecordedEvents& events = faint_object();
  SegmenterOptions options = dear_labels();
  const WindowPrior prior = known({scene_motion}, {{faint_motion}});
  options.tracked_share = 1;
  CHECK(segmented(events, options, prior).models.size() == 1);
  // Labels of the models given: what differs is what the object's label costs.
  options.num_iter_segmentation = 0;
  options.lambda_label = 800;
  const auto energy = [&](double share) {
    options.tracked_share = share;
    const Segmentation result = segmented(events, options, prior);
    REQUIRE(result.models.size() == 2);
    return result.energy;
  };
  CHECK(energy(1) > energy(0.5));
  CHECK(energy(0.5) > energy(0));
}

TEST_CASE("the energy is that of its definition where objects are expected") {
  const RecordedEvents& events = faint_object();
  std::vector<TrackedObject> tracked{known_object(faint_motion, -0.04),
                                     {Similarity{{700, -650, 0, 0}}, {{30, 30}, {34, 30}}, 0}};
  tracked[0].places.resize(16);  // of 64: some of its events are astray
  const TrackedObject few_places = tracked[0];
  for (const Labelling labelling : {Labelling::bands, Labelling::exact}) {
    for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
      CAPTURE(name_of(labelling));
      CAPTURE(name_of(term));
      SegmenterOptions options = quiet_options();
      options.labelling = labelling;
      options.data_term = term;
      options.lambda_label = 800;
      options.lambda_place = 17.6;
      REQUIRE(options.lambda_speed > 0);
      REQUIRE(options.lambda_edge > 0);
      const Segmentation result = segmented(events, options, known({scene_motion}, tracked));
      check_sound(result, events.size());
      REQUIRE(result.models.size() == 2);
      CHECK(share_found(result) > 0.8);
      CHECK(result.energy == written_out_energy(result, events, options, tracked, {no_object, 0}));
      // Places are part of it: of the object's label, and of the scene's where one of the two is expected.
      CHECK(result.energy > written_out_energy(result, events, options, {tracked[0]}, {no_object, 0}));
      tracked[0].places.clear();
      CHECK(result.energy > written_out_energy(result, events, options, tracked, {no_object, 0}));
      tracked[0] = few_places;
    }
  }
}

// The faint object, nearly whole and as it moves, whatever the number of threads.
void check_found(const RecordedEvents& events, const SegmenterOptions& options, const WindowPrior& prior) {
  const Segmentation result = segmented(events, options, prior);
  check_sound(result, events.size());
  REQUIRE(result.models.size() == 2);
  CHECK(off(result.models[1], faint_motion, events) < 0.5);
  CHECK(share_found(result) > 0.8);
  check_alike_for_any_threads(result, options, prior);
}

TEST_CASE("an object is held by its place where its label would not pay otherwise") {
  const RecordedEvents& events = faint_object();
  SegmenterOptions options = dear_labels();
  options.tracked_share = 1;
  const WindowPrior prior = known({scene_motion}, {known_object(faint_motion, -0.05)});
  options.lambda_place = 0;
  CHECK(segmented(events, options, prior).models.size() == 1);
  options.lambda_place = 60;
  check_found(events, options, prior);
}

TEST_CASE("an object that turned since it was seen is found by its place") {
  const RecordedEvents& events = faint_object();
  const MotionModel before = Similarity{{-30, 60, 0, 0}};  // 5 px off over the window
  const SegmenterOptions options = dear_labels();
  CHECK(segmented(events, options, known({scene_motion}, {{before}})).models.size() == 1);
  for (const double seen : {0.0, -0.04}) {
    CAPTURE(seen);
    const WindowPrior prior = known({scene_motion}, {known_object(before, seen)});
    check_found(events, options, prior);
  }
}

TEST_CASE("what is tracked but no longer there gets no label, wherever it is expected") {
  const RecordedEvents& events = two_motions();
  const MotionModel gone = Similarity{{700, -650, 0, 0}};
  std::vector<TrackedObject> tracked{{object_motion}, {gone}};
  for (const Vec2f corner : {Vec2f{-50, -50}, {20, 20}, {70, 50}}) {
    // At first it may be anywhere; then it is expected before the scene, or before the other.
    if (corner.x > 0) {
      for (int i = 0; i < 64; ++i)
        tracked[1].places.push_back(
            {corner.x + static_cast<float>(i % 8), corner.y + static_cast<float>(i / 8)});
    }
    const Segmentation result = segmented(events, quiet_options(), known({scene_motion}, tracked));
    check_sound(result, events.size());
    REQUIRE(result.models.size() == 2);
    for (const MotionModel& model : result.models) CHECK(off(model, gone, events) > 3);
  }
}
