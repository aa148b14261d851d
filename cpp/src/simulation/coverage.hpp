// Shares of a pixel that outlines cover, from distances in px: continuous, and exact where an outline is
// straight and along the pixel's sides.
#pragma once

#include <algorithm>

#include "emseg/simulation/raster.hpp"

namespace emseg::simulation {

inline float clamp01(float x) { return std::min(std::max(x, 0.0f), 1.0f); }

// Share of a unit box around a point that lies in a strip, given the distances inside its two sides.
inline float strip(float inside_one, float inside_other) {
  return std::max(0.0f, clamp01(inside_one + 0.5f) + clamp01(inside_other + 0.5f) - 1);
}

// How place on the plane changes from pixel to pixel.
struct Footprint {
  float u, v;            // the place
  float ux, uy, vx, vy;  // metres per px
};

inline Footprint footprint_at(const ProjectedSurface& seen, float x, float y) {
  // Beyond the horizon there is no place; what is asked for there is of no weight.
  const float depth = 1 / std::max(seen.w.at(x, y), 1e-4f);
  const float u = seen.u.at(x, y) * depth, v = seen.v.at(x, y) * depth;
  return {u,
          v,
          (seen.u.gx - u * seen.w.gx) * depth,
          (seen.u.gy - u * seen.w.gy) * depth,
          (seen.v.gx - v * seen.w.gx) * depth,
          (seen.v.gy - v * seen.w.gy) * depth};
}

// Share within the polygon, whose edges lie at these places; without any edge, all of the pixel.
float polygon_coverage(const ProjectedSurface& seen, float x, float y);

// Share within the outline, were the polygon without end.
float blob_coverage(const Outline& outline, const Footprint& footprint);
float net_coverage(const Outline& outline, const Footprint& footprint);

}  // namespace emseg::simulation
