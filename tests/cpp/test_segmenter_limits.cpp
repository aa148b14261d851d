// The segmenter at the edge of what it takes, and beyond.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "segmenter_windows.hpp"

using namespace emseg;
using namespace emseg::testing;

TEST_CASE("windows of next to nothing give sound results") {
  SegmenterOptions options;
  for (const bool noise : {false, true}) {
    options.mark_noise = noise;
    for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
      options.data_term = term;
      RecordedEvents events;
      const auto sound = [&] { check_sound(segmented(events, options), events.size()); };
      sound();  // empty
      events.add(5, 5, 100);
      sound();  // one
      events.add(159, 119, 100);
      sound();  // two, at one time
      events.add(0, 0, 101);
      sound();
      events = {};
      for (int k = 0; k < 500; ++k) events.add(77, 33, 10 * k, k % 2);
      sound();  // one pixel
      events = {};
      for (int k = 0; k < 500; ++k) events.add(k % 160, k % 120, 4242, k % 2);
      sound();  // one time
      events = {};
      for (int k = 0; k < 500; ++k) events.add(k % 160, 60, 20 * k);
      sound();  // one row
      events = {};
      for (int k = 0; k < 120; ++k) events.add(k, k, 50 * k);
      sound();  // a diagonal
    }
  }
}

TEST_CASE("a sensor of one pixel, one row, one column") {
  for (const ImageSize size : {ImageSize{1, 1}, {200, 1}, {1, 200}}) {
    RecordedEvents events;
    for (int k = 0; k < 300; ++k) events.add(k % size.width, k % size.height, 10 * k, k % 2);
    check_sound(segmented(events, {}, {}, size), events.size());
  }
}

TEST_CASE("times as far apart as 64 bits allow, and t_ref anywhere") {
  RecordedEvents events;
  events.add(3, 3, earliest);
  events.add(4, 3, -5);
  events.add(5, 3, 0);
  for (int k = 0; k < 50; ++k) events.add(6 + k, 3, latest);
  check_sound(segmented(events, {}), events.size());
  SegmenterOptions fast;
  fast.bounds.speed = 1e7;
  fast.kinds = {MotionKind::rotation, MotionKind::homography};
  check_sound(segmented(events, fast), events.size());
  for (const std::int64_t t_ref : {earliest, latest}) {
    WindowPrior prior;
    prior.t_ref = t_ref;
    check_sound(segmented(events, {}, prior), events.size());
    check_sound(segmented(two_motions(), {}, prior), two_motions().size());
  }
}

TEST_CASE("a pool that throws all events off the canvas is survived") {
  WindowPrior prior;
  prior.pool = {Translation{{1e30, 1e300}}, Rotation{{1e6, 1e20, 3}},
                Homography{{0, 0, 1e9, 0, 0, 1e9, 1e30, 1e30}}};
  for (const bool refits : {false, true}) {
    SegmenterOptions options;
    if (!refits) options.num_iter_segmentation = 0;
    check_sound(segmented(two_motions(), options, prior), two_motions().size());
  }
}

TEST_CASE("tracked objects at places and times without bounds are survived") {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  WindowPrior prior;
  prior.tracked = {{object_motion, {{nan, 0}, {1e30f, -1e30f}}, -1e300},
                   {Similarity{{1e30, 1e300, 0, 0}}, {{80, 60}}, 1},
                   {Rotation{{1e6, 1e20, 3}}, {{80, 60}}, 0},
                   {Translation{}, {}, 1e9}};
  SegmenterOptions dear;
  dear.lambda_place = 1e9;
  dear.lambda_data = 1e6;
  dear.lambda_speed = 255;
  dear.lambda_edge = 255;
  for (const SegmenterOptions& options : {SegmenterOptions{}, dear}) {
    for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
      SegmenterOptions of_term = options;
      of_term.data_term = term;
      check_sound(segmented(two_motions(), of_term, prior), two_motions().size());
      RecordedEvents few;
      check_sound(segmented(few, of_term, prior), 0);
      for (int k = 0; k < 30; ++k) few.add(k, 60, 1000 * k);
      check_sound(segmented(few, of_term, prior), few.size());
    }
  }
}

TEST_CASE("a camera's own table makes no difference, another one does") {
  const Camera camera{sensor, 200, 200, 80, 60, DistortionModel::radtan, {-0.2, 0.03, 0, 0, 0}};
  const RecordedEvents events = two_motions();
  const auto places = [&](std::optional<UndistortionTable> table) {
    Segmenter segmenter(sensor, camera, {}, std::move(table));
    const Segmentation found = segmenter.segment(events.view());
    return std::pair{found.labels, found.energy};
  };
  const UndistortionTable own = make_undistortion_table(camera);
  CHECK(places(own) == places(std::nullopt));
  UndistortionTable shrunk = own;
  for (float& x : shrunk.x) x *= 0.5f;
  CHECK(places(shrunk) != places(own));
}

TEST_CASE("what does not fit is refused by name") {
  const auto refusal = [](auto&& call) -> std::string {
    try {
      call();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  const auto refused = [&](auto&& change) {
    SegmenterOptions options;
    change(options);
    return refusal([&] { Segmenter(sensor, std::nullopt, options); });
  };
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused([](auto&) {}) == "");
  CHECK(refused([](auto& o) { o.lambda_data = -1; }).find("lambda_data is -1") == 0);
  CHECK(refused([](auto& o) { o.lambda_smooth = nan; }).find("lambda_smooth is nan") == 0);
  CHECK(refused([](auto& o) { o.lambda_label = 2e9; }).find("lambda_label is 2000000000") == 0);
  CHECK(refused([](auto& o) { o.lambda_label_per_event = nan; }).find("lambda_label_per_event") == 0);
  for (const double share : {-0.1, 1.1, nan})
    CHECK(refused([&](auto& o) { o.tracked_share = share; }).find("tracked_share is ") == 0);
  CHECK(refused([](auto& o) { o.lambda_place = 2e9; }).find("lambda_place is 2000000000") == 0);
  CHECK(refused([](auto& o) { o.lambda_place = -1; }).find("lambda_place is -1") == 0);
  for (const double doubt : {-1.0, 255.5, nan}) {
    CHECK(refused([&](auto& o) { o.lambda_speed = doubt; }).find("lambda_speed is ") == 0);
    CHECK(refused([&](auto& o) { o.lambda_edge = doubt; }).find("lambda_edge is ") == 0);
  }
  CHECK(refused([](auto& o) { o.lambda_edge = -1; }) == "lambda_edge is -1.000000, expected 0..255");
  CHECK(refused([](auto& o) { o.lambda_speed = 256; }) == "lambda_speed is 256.000000, expected 0..255");
  CHECK(refused([](auto& o) {
          o.tracked_share = 1;
          o.lambda_speed = o.lambda_edge = 255;
          o.lambda_place = 1e9;
        }) == "");
  CHECK(refused([](auto& o) { o.bracket_row = 0; }).find("bracket_row is 0") == 0);
  CHECK(refused([](auto& o) { o.bracket_col = 65; }).find("bracket_col is 65") == 0);
  CHECK(refused([](auto& o) { o.bounds.speed = 0; }).find("largest speed is 0") == 0);
  CHECK(refused([](auto& o) { o.bounds.scale_rate = nan; }).find("scale and angle rates") == 0);
  CHECK(refused([](auto& o) { o.kinds.clear(); }).find("no kind of motion model") == 0);
  CHECK(refused([](auto& o) { o.num_iter_segmentation = -1; }).find("num_iter_segmentation is -1") == 0);
  CHECK(refused([](auto& o) { o.num_iter_labeling = 0; }).find("num_iter_labeling is 0") == 0);
  CHECK(refused([](auto& o) { o.sigma = -2; }).find("blur sigma is -2") == 0);
  CHECK(refused([](auto& o) { o.max_events = 0; }).find("max_events is 0") == 0);
  CHECK(refused([](auto& o) { o.threads = -3; }).find("threads is -3") == 0);

  const auto size_refused = [&](ImageSize size) {
    return refusal([&] { Segmenter(size, std::nullopt, {}); });
  };
  CHECK(size_refused({0, 10}).find("sensor size is 0x10") == 0);
  CHECK(size_refused({9000, 10}).find("sensor size is 9000x10") == 0);
  Camera camera;
  camera.size = {100, 100};
  CHECK(refusal([&] { Segmenter(sensor, camera, {}); }).find("the camera is 100x100, the sensor 160x120") ==
        0);

  camera = {sensor, 200, 200, 80, 60, DistortionModel::radtan, {-0.2, 0.03, 0, 0, 0}};
  CHECK(refusal([&] {
          Segmenter(sensor, camera, {}, UndistortionTable{sensor, {1, 2}, {3}});
        }).find("the undistortion table has 2 and 1 places, expected 19200") == 0);

  RecordedEvents outside;
  outside.add(160, 0, 0);
  CHECK(refusal([&] { segmented(outside, {}); }).find("event 0 lies at (160, 0)") == 0);
  WindowPrior prior;
  prior.pool = {scene_motion, Translation{{nan, 0}}};
  CHECK(refusal([&] {
          segmented(two_motions(), {}, prior);
        }).find("parameter 0 of the translation is not finite") == 0);
  prior.pool.clear();
  prior.candidates = {Affine{{0, 0, 0, 0, 0, nan}}};
  CHECK(refusal([&] {
          segmented(two_motions(), {}, prior);
        }).find("parameter 5 of the affine is not finite") == 0);
  prior.candidates.clear();
  prior.tracked = {{scene_motion}, {Translation{{0, nan}}}};
  CHECK(refusal([&] {
          segmented(two_motions(), {}, prior);
        }).find("parameter 1 of the translation is not finite") == 0);
  prior.tracked = {{scene_motion, {{80, 60}}, nan}};
  CHECK(refusal([&] { segmented(two_motions(), {}, prior); }) ==
        "the time at which a tracked object was seen is not finite");
}
