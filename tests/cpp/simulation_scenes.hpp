// Small scenes for the simulation's tests.
#pragma once

#include <cmath>
#include <vector>

#include "emseg/simulation/simulator.hpp"

namespace emseg::test {

using namespace emseg::simulation;

inline Path still_at(Vec3 position) { return {{{position, {1, 0, 0, 0}}}, 1}; }

// Straight on with a constant velocity, for two seconds.
inline Path straight(Vec3 start, Vec3 velocity) {
  std::vector<Path::Sample> samples;
  for (int k = -1; k <= 200; ++k) samples.push_back({start + (0.01 * k) * velocity, {1, 0, 0, 0}});
  samples.erase(samples.begin());
  return {samples, 0.01};
}

inline std::vector<PlanePoint> rectangle(double width, double height) {
  return {
      {-width / 2, -height / 2}, {width / 2, -height / 2}, {width / 2, height / 2}, {-width / 2, height / 2}};
}

inline int add_plain_texture(Scene& scene, double reflectance) {
  TextureOptions options;
  options.kind = TextureKind::plain;
  options.low = options.high = reflectance;
  options.size = 8;
  options.grain = 1;
  scene.textures.emplace_back(options);
  return static_cast<int>(scene.textures.size()) - 1;
}

inline int add_leaves(Scene& scene, std::uint64_t seed) {
  TextureOptions options;
  options.seed = seed;
  scene.textures.emplace_back(options);
  return static_cast<int>(scene.textures.size()) - 1;
}

// A sheet that faces the camera, 100 texels per metre.
inline void add_sheet(Scene& scene, const Path& path, std::int32_t label, double width, double height,
                      int texture) {
  scene.bodies.push_back({path, label});
  Surface surface;
  surface.body = static_cast<int>(scene.bodies.size()) - 1;
  surface.outline.polygon = rectangle(width, height);
  surface.texture = texture;
  surface.two_sided = true;
  scene.surfaces.push_back(surface);
}

// Looks along z with 100 px per unit of x/z; no shading, so that intensity is reflectance.
inline Scene empty_scene(int width, int height) {
  Scene scene;
  scene.camera = {{width, height}, 100, 100, (width - 1) / 2., (height - 1) / 2., DistortionModel::none, {}};
  scene.ambient = 1;
  scene.lights.push_back({});
  return scene;
}

inline SensorOptions ideal_sensor(double threshold) {
  SensorOptions options;
  options.threshold_on = options.threshold_off = threshold;
  options.threshold_sigma = 0;
  options.refractory = 0;
  options.dark_intensity = 1e-6;
  return options;
}

}  // namespace emseg::test
