// A window of two motions, and what every segmentation must be.
#pragma once

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "emseg/segmenter.hpp"
#include "synthetic_events.hpp"

namespace emseg::testing {

constexpr ImageSize sensor{160, 120};
constexpr Region plane{0, 0, 160, 120};
constexpr std::int64_t t_middle = 7'000'000;
constexpr std::int64_t earliest = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t latest = std::numeric_limits<std::int64_t>::max();
inline const MotionModel scene_motion = Translation{{110, 45}};
inline const MotionModel object_motion = Translation{{-180, 90}};

// A moving camera's scene and an object before it; 0 and 1 in `source`.
inline const RecordedEvents& two_motions() {
  static const RecordedEvents events = [] {
    const WarpFrame frame = make_warp_frame(sensor);
    RecordedEvents recorded_events = recorded(moving_dots({{scene_motion, {-10, -10, 180, 45}, 150, 12},
                                                           {scene_motion, {-10, 85, 180, 45}, 150, 12},
                                                           {scene_motion, {-10, 30, 66, 60}, 80, 12},
                                                           {scene_motion, {104, 30, 66, 60}, 80, 12},
                                                           {object_motion, {60, 40, 40, 40}, 110, 12}},
                                                          frame, 0.04, 1),
                                              sensor, t_middle);
    for (std::int32_t& source : recorded_events.source) source = source == 4;
    return recorded_events;
  }();
  return events;
}

inline SegmenterOptions quiet_options(int threads = 2) {
  SegmenterOptions options;
  options.mark_noise = false;
  options.threads = threads;
  return options;
}

inline Segmentation segmented(const RecordedEvents& events, const SegmenterOptions& options,
                              const WindowPrior& prior = {}, ImageSize size = sensor) {
  Segmenter segmenter(size, std::nullopt, options);
  return segmenter.segment(events.view(), prior);
}

inline void check_sound(const Segmentation& result, std::size_t events) {
  REQUIRE(result.labels.size() == events);
  REQUIRE(!result.models.empty());
  for (const std::int32_t label : result.labels) {
    REQUIRE(label >= noise_label);
    REQUIRE(label < static_cast<std::int32_t>(result.models.size()));
  }
  for (const MotionModel& model : result.models) {
    for (const double param : params_of(model)) REQUIRE(std::isfinite(param));
  }
  CHECK(std::is_sorted(result.energy_trace.rbegin(), result.energy_trace.rend()));
  if (events > 0) {
    REQUIRE(!result.energy_trace.empty());
    CHECK(result.energy_trace.back() == result.energy);
    CHECK(result.energy >= 0);
  }
}

}  // namespace emseg::testing
