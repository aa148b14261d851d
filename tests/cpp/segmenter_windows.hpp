// A window of two motions, and what every segmentation must be.
#pragma once

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "emseg/edge_directions.hpp"
#include "emseg/model_selection.hpp"
#include "emseg/motion_doubt.hpp"
#include "emseg/pixel_footprint.hpp"
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

// What a sensor sees of dots within 40 ms: 1 in `source` for the last of them, an object's, else 0.
inline RecordedEvents object_before_scene(const std::vector<Dots>& dots, std::uint32_t seed) {
  RecordedEvents events = recorded(moving_dots(dots, make_warp_frame(sensor), 0.04, seed), sensor, t_middle);
  for (std::int32_t& source : events.source) source = source + 1 == static_cast<std::int32_t>(dots.size());
  return events;
}

// A moving camera's scene and an object before it.
inline const RecordedEvents& two_motions() {
  static const RecordedEvents events = object_before_scene({{scene_motion, {-10, -10, 180, 45}, 150, 12},
                                                            {scene_motion, {-10, 85, 180, 45}, 150, 12},
                                                            {scene_motion, {-10, 30, 66, 60}, 80, 12},
                                                            {scene_motion, {104, 30, 66, 60}, 80, 12},
                                                            {object_motion, {60, 40, 40, 40}, 110, 12}},
                                                           1);
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

// The energy of a result, written out: data, doubt, places of what is tracked, graph edges between labels,
// labels used.  `objects`: which of the tracked move by the result's models, or no_object; none where it is
// short.
inline std::int64_t written_out_energy(const Segmentation& result, const RecordedEvents& events,
                                       const SegmenterOptions& options,
                                       const std::vector<TrackedObject>& tracked = {},
                                       const std::vector<std::int32_t>& objects = {}) {
  const WarpFrame frame = make_warp_frame(sensor);
  Points points = make_points(events.view(), result.t_ref);
  if (options.footprint == Footprint::scattered) scatter_over_pixels(events.view(), result.t_ref, points);
  if (options.polarity == Polarity::opposed) {
    for (const std::uint8_t p : events.p) points.sign.push_back(p ? 1.0f : -1.0f);
  }
  const BlockGrid grid = make_block_grid(points.view(), plane, 8);
  // Labels go by edges that are plain, at half their weight.
  const auto edges = edge_directions(structure_tensors(points.view(), grid, edge_slices), grid, 2);
  const MotionDoubt doubt(grid, points.view().seconds(), {options.lambda_speed, options.lambda_edge / 2},
                          edges);
  std::vector<std::vector<std::uint8_t>> expected;
  for (const TrackedObject& object : tracked)
    expected.push_back(where_expected(points.view(), object, frame, plane));
  const auto astray = [&](std::int32_t object, std::size_t k) {
    if (object == no_object)
      return std::ranges::any_of(expected, [&](const auto& flags) { return !flags.empty() && flags[k]; });
    const auto& flags = expected[static_cast<std::size_t>(object)];
    return !flags.empty() && !flags[k];
  };
  const auto taps = gaussian_taps(options.sigma);
  IweWorkspace workspace;
  std::int64_t energy = 0;
  std::vector<std::int32_t> costs(events.size());
  for (std::size_t l = 0; l < result.models.size(); ++l) {
    ModelSupport support;
    evaluate_support(points.view(), result.models[l], frame, canvas_of(plane), taps, workspace, support);
    integer_costs(options.data_term, support.sharpness, result.reference_sharpness, options.lambda_data,
                  costs);
    const std::int32_t object = l < objects.size() ? objects[l] : no_object;
    const std::vector<std::int32_t> doubts = doubt.of(result.models[l], frame);
    bool used = false;
    for (std::size_t k = 0; k < events.size(); ++k) {
      if (result.labels[k] != static_cast<std::int32_t>(l)) continue;
      energy += costs[k] + doubts[static_cast<std::size_t>(grid.of_event[k])];
      if (astray(object, k)) energy += std::llround(options.lambda_place);
      used = true;
    }
    const double label_cost = options.lambda_label
                                  ? *options.lambda_label
                                  : options.lambda_label_per_event * static_cast<double>(events.size());
    if (used) energy += std::llround(object == no_object ? label_cost : options.tracked_share * label_cost);
  }
  const EventGraph graph = build_event_graph(events.view(), sensor);
  for (std::size_t i = 0; i < events.size(); ++i) {
    for (std::int64_t e = graph.indptr[i]; e < graph.indptr[i + 1]; ++e) {
      const auto j = static_cast<std::size_t>(graph.indices[static_cast<std::size_t>(e)]);
      if (result.labels[i] != result.labels[j]) energy += std::llround(options.lambda_smooth);
    }
  }
  return energy;
}

}  // namespace emseg::testing
