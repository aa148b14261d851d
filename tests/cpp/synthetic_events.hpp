// Made events of known motion: dots that shine now and then while they move.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

#include "emseg/event.hpp"
#include "reference_warp.hpp"

namespace emseg::testing {

// The same on every platform, unlike the distributions of the standard library.
inline double uniform(std::mt19937& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
}

// 1 or -1 for each of `count` points.
inline std::vector<float> random_signs(std::mt19937& random, std::size_t count) {
  std::vector<float> signs(count);
  for (float& sign : signs) sign = random() % 2 ? 1.0f : -1.0f;
  return signs;
}

// Points with polarities and the motion that made each of them, sorted by time.
struct Scene {
  Points points;
  std::vector<std::uint8_t> positive;
  std::vector<std::int32_t> source;

  std::size_t size() const { return points.size(); }
  PointView view() const { return points.view(); }
};

struct Dots {
  MotionModel model;
  Region region;  // that holds the dots at t_ref
  int count = 200;
  int flashes = 12;  // events of each dot
};

// Places are exact, not rounded to pixels; times are uniform in -duration/2 .. duration/2 (s).
inline Scene moving_dots(const std::vector<Dots>& sources, const WarpFrame& frame, double duration,
                         std::uint32_t seed) {
  std::mt19937 random(seed);
  struct Flash {
    Place at;
    double dt;
    std::uint8_t positive;
    std::int32_t source;
  };
  std::vector<Flash> flashes;
  for (std::size_t s = 0; s < sources.size(); ++s) {
    const auto& [model, region, count, flashes_each] = sources[s];
    for (int dot = 0; dot < count; ++dot) {
      const Place home{uniform(random, region.x0, region.x0 + region.width - 1),
                       uniform(random, region.y0, region.y0 + region.height - 1)};
      const auto positive = static_cast<std::uint8_t>(random() % 2);
      for (int i = 0; i < flashes_each; ++i) {
        const double dt = uniform(random, -0.5 * duration, 0.5 * duration);
        flashes.push_back(
            {reference_unwarp(model, frame, home, dt), dt, positive, static_cast<std::int32_t>(s)});
      }
    }
  }
  std::stable_sort(flashes.begin(), flashes.end(),
                   [](const Flash& a, const Flash& b) { return a.dt < b.dt; });
  Scene scene;
  for (const Flash& flash : flashes) {
    scene.points.x.push_back(static_cast<float>(flash.at.x));
    scene.points.y.push_back(static_cast<float>(flash.at.y));
    scene.points.dt.push_back(static_cast<float>(flash.dt));
    scene.positive.push_back(flash.positive);
    scene.source.push_back(flash.source);
  }
  return scene;
}

// A recording: whole pixels and microseconds, with the motion that made each event.
struct RecordedEvents {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;
  std::vector<std::uint8_t> p;
  std::vector<std::int32_t> source;

  void add(int px, int py, std::int64_t time, int polarity = 1, std::int32_t motion = 0) {
    x.push_back(static_cast<std::uint16_t>(px));
    y.push_back(static_cast<std::uint16_t>(py));
    t.push_back(time);
    p.push_back(static_cast<std::uint8_t>(polarity));
    source.push_back(motion);
  }
  std::size_t size() const { return t.size(); }
  EventView view() const { return {x, y, t, p}; }
};

// What a sensor sees of a scene whose dt = 0 is at `t_ref` (us); dots outside are not seen.
inline RecordedEvents recorded(const Scene& scene, ImageSize size, std::int64_t t_ref) {
  RecordedEvents events;
  for (std::size_t k = 0; k < scene.size(); ++k) {
    const long x = std::lround(scene.points.x[k]), y = std::lround(scene.points.y[k]);
    if (x < 0 || y < 0 || x >= size.width || y >= size.height) continue;
    events.add(static_cast<int>(x), static_cast<int>(y),
               t_ref + std::llround(1e6 * double(scene.points.dt[k])), scene.positive[k], scene.source[k]);
  }
  return events;
}

}  // namespace emseg::testing
