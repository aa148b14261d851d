// A scene as the renderer takes it: textured flat surfaces on bodies that move rigidly, lights and a camera.
//
// Frames: a camera looks along its z axis, x to the right, y down.  World and body frames are the scene's own
// affair.  Lengths in metres, times in seconds, reflectances and intensities between 0 and 1.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "emseg/camera.hpp"
#include "emseg/simulation/rigid.hpp"
#include "emseg/simulation/texture.hpp"

namespace emseg::simulation {

struct PlanePoint {
  double u = 0, v = 0;
};

enum class OutlineKind {
  polygon,  // the polygon itself
  blob,     // r < radius (1 + sum of harmonics cos(k angle)) within the polygon
  net,      // bars of a grid within the polygon
};

// What a surface covers of its plane.  The polygon is convex, 3 to 8 corners, anticlockwise from u to v.
struct Outline {
  OutlineKind kind = OutlineKind::polygon;
  std::vector<PlanePoint> polygon;
  double radius = 0;                                 // blob
  std::array<std::array<double, 2>, 4> harmonics{};  // blob: cosine and sine parts of orders 2 .. 5
  std::array<double, 2> pitch{};                     // net: distance of its bars along u and v; 0: none
  double bar = 0;                                    // net: width of a bar
};

// A flat surface of a body.  Its normal is cross(axis_u, axis_v); it is seen from where the normal points,
// or from both sides.
struct Surface {
  int body = 0;
  Vec3 origin;           // in the body's frame
  Vec3 axis_u{1, 0, 0};  // unit vectors in the body's frame
  Vec3 axis_v{0, 1, 0};
  Outline outline;
  int texture = 0;
  double texels_per_metre = 100;
  std::array<double, 2> texture_offset{};  // texels
  int light = 0;
  bool two_sided = false;
};

struct Body {
  Path T_world_body;
  std::int32_t label = 0;  // the owner of its events: 0 background, 1.. objects
};

// Brightness of a light through time: linear between equidistant samples, held outside.
struct Light {
  std::vector<float> gain{1.0f};
  double interval = 1;

  float at(double seconds) const;
};

struct Scene {
  Camera camera;
  Path T_world_camera;
  std::vector<Body> bodies;
  std::vector<Surface> surfaces;
  std::vector<Texture> textures;
  std::vector<Light> lights;
  Vec3 sun{0, 0, 1};     // unit vector along which light falls, world frame
  double ambient = 0.6;  // share of the light that comes from everywhere
  double sky = 0.5;      // intensity where there is no surface
};

// Throws std::invalid_argument that names the surface and what was expected.
void check_scene(const Scene& scene);

}  // namespace emseg::simulation
