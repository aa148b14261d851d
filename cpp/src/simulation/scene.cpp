#include "emseg/simulation/scene.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace emseg::simulation {
namespace {

[[noreturn]] void refuse(std::size_t surface, const std::string& problem) {
  throw std::invalid_argument("surface " + std::to_string(surface) + ": " + problem);
}

void check_outline(std::size_t index, const Outline& outline) {
  const auto& corners = outline.polygon;
  if (corners.size() < 3 || corners.size() > 8) {
    refuse(index, std::to_string(corners.size()) + " corners, expected 3..8");
  }
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const PlanePoint a = corners[k], b = corners[(k + 1) % corners.size()],
                     c = corners[(k + 2) % corners.size()];
    const double turn = (b.u - a.u) * (c.v - b.v) - (b.v - a.v) * (c.u - b.u);
    if (!(turn > 0)) refuse(index, "its corners make no convex polygon, anticlockwise from u to v");
  }
  if (outline.kind == OutlineKind::blob && !(outline.radius > 0)) {
    refuse(index, "radius is " + std::to_string(outline.radius) + ", expected a positive length");
  }
  if (outline.kind == OutlineKind::net && !(outline.bar > 0)) {
    refuse(index, "bar is " + std::to_string(outline.bar) + ", expected a positive width");
  }
}

}  // namespace

float Light::at(double seconds) const {
  const auto last = static_cast<double>(gain.size() - 1);
  const double place = std::clamp(seconds / interval, 0.0, last);
  const auto k = static_cast<std::size_t>(place);
  if (k + 1 >= gain.size()) return gain.back();
  const auto share = static_cast<float>(place - static_cast<double>(k));
  return gain[k] + share * (gain[k + 1] - gain[k]);
}

void check_scene(const Scene& scene) {
  check_camera(scene.camera);
  if (scene.lights.empty()) throw std::invalid_argument("scene: no lights, expected at least one");
  for (const Light& light : scene.lights) {
    if (light.gain.empty() || !(light.interval > 0)) {
      throw std::invalid_argument("light: expected at least one gain and a positive interval");
    }
  }
  if (scene.surfaces.size() > 32000) {
    throw std::invalid_argument("scene: " + std::to_string(scene.surfaces.size()) +
                                " surfaces, expected at most 32000");
  }
  const auto within = [](int index, std::size_t count) {
    return index >= 0 && static_cast<std::size_t>(index) < count;
  };
  for (std::size_t k = 0; k < scene.surfaces.size(); ++k) {
    const Surface& surface = scene.surfaces[k];
    if (!within(surface.body, scene.bodies.size()))
      refuse(k, "there is no body " + std::to_string(surface.body));
    if (!within(surface.texture, scene.textures.size())) {
      refuse(k, "there is no texture " + std::to_string(surface.texture));
    }
    if (!within(surface.light, scene.lights.size())) {
      refuse(k, "there is no light " + std::to_string(surface.light));
    }
    const double skew = std::abs(dot(surface.axis_u, surface.axis_v));
    const double lengths = std::abs(norm(surface.axis_u) - 1) + std::abs(norm(surface.axis_v) - 1);
    if (!(skew < 1e-9) || !(lengths < 1e-9)) refuse(k, "its axes are no perpendicular unit vectors");
    if (!(surface.texels_per_metre > 0)) refuse(k, "expected a positive number of texels per metre");
    check_outline(k, surface.outline);
  }
}

}  // namespace emseg::simulation
