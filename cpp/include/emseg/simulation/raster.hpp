// The renderer: what a tile of the sensor sees at a moment, by scan conversion of flat surfaces.
//
// Per pixel the nearest surface is found by its exact depth at the pixel's centre; surfaces whose outline
// runs through the pixel cover a part of it, in proportion to the outline's distance from the centre, so that
// intensity is a continuous function of time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "emseg/image.hpp"
#include "emseg/simulation/scene.hpp"

namespace emseg::simulation {

// c + x gx + y gy over pixel positions relative to the tile's centre.
struct Affine {
  float c = 0, gx = 0, gy = 0;

  float at(float x, float y) const { return c + (gx * x + gy * y); }
};

// A surface as seen in a tile at a moment.  W is the inverse of the depth; u W and v W give the place on the
// plane (Olano, Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997).
struct ProjectedSurface {
  int surface = 0;  // index in the scene
  int cluster = 0;  // the surfaces it moves with, as in TileImage::T_camera_bodies
  Affine u, v, w;
  std::array<Affine, 8> edges;  // distance in px inside each edge of the polygon
  int edge_count = 0;           // 0 where the tile lies well inside the polygon
  float brightness = 1;         // of a white surface
  // Whether the finest level of the texture serves all over the tile; known once it is asked for.
  enum class Detail : std::uint8_t { unknown, finest, varying } detail = Detail::unknown;
  // The pixels that show it, as columns and rows of the tile.
  int x_min = 0, x_max = -1, y_min = 0, y_max = -1;

  bool is_seen() const { return x_max >= x_min; }
  void show(int x, int y) {
    if (!is_seen()) y_min = y, y_max = y, x_min = x, x_max = x;
    x_min = x < x_min ? x : x_min;
    x_max = x > x_max ? x : x_max;
    y_min = y < y_min ? y : y_min;
    y_max = y > y_max ? y : y_max;
  }
};

// What a surface contributes to a pixel that it shares with others.
struct Layer {
  int projected = -1;  // index in TileImage::surfaces, or -1 for the sky
  float weight = 0;    // share of the pixel
  float intensity = 0;
  float inverse_depth = 0;
};

struct TileImage {
  double seconds = 0;
  std::vector<float> intensity;       // per pixel of the tile, row by row
  std::vector<float> inverse_depth;   // of the front surface, 1/m
  std::vector<std::int16_t> front;    // the surface that covers the pixel's centre: index in surfaces, or -1
  std::vector<std::int32_t> mixture;  // index in mixtures where several surfaces share the pixel, else -1
  std::vector<std::pair<int, int>> mixtures;  // begin and end in layers, front to back
  std::vector<Layer> layers;
  std::vector<ProjectedSurface> surfaces;
  // What the picture depends on: where the bodies are that reach into the tile or come near it, by cluster
  // (surfaces of one body that follow each other in the scene), and the brightness of the lights on them.
  std::vector<std::pair<int, Pose>> T_camera_bodies;
  std::vector<float> gains;  // 1 for lights that do not shine here
};

class TileRenderer {
 public:
  // The scene must be sound (check_scene) and outlive the renderer.
  TileRenderer(const Scene& scene, const UndistortionTable& undistortion, Region tile);

  // Renders a moment.  False where nothing has changed since `before`: then only `image.seconds` is set.
  bool render(double seconds, TileImage& image, const TileImage* before = nullptr);

  // The largest motion in the image, px, of what `from` shows on its way to the moment of `to`.
  double largest_motion(const TileImage& from, const TileImage& to) const;

  // The largest motion in the image, px, of the middle of anything in or near the tile: what moves far may
  // pass through a corner of the tile between two moments, seen at neither.
  double largest_passage(const TileImage& from, const TileImage& to) const;

  // Where a place of the tile, seen on a surface at one moment, is in the image at another.
  struct Landing {
    bool in_front = false;  // of the camera
    Point2 pixel;           // undistorted
    double depth = 0;
  };
  Landing land(const ProjectedSurface& seen, float x, float y, const Pose& T_camera_body) const;
  // Pose of the body that a surface belongs to.
  Pose camera_from_body(const ProjectedSurface& seen, double seconds) const;

  Region tile() const { return tile_; }
  float local_x(int column, int row) const { return local_x_[index(column, row)]; }
  float local_y(int column, int row) const { return local_y_[index(column, row)]; }
  Point2 centre() const { return {centre_x_, centre_y_}; }

 private:
  // Surfaces of one body that follow each other in the scene, and a sphere around them.
  struct Cluster {
    int body = 0;
    int begin = 0, end = 0;
    Vec3 centre;  // in the body's frame
    double radius = 0;
    std::vector<int> lights;
  };

  // What does not change of a surface: its edges as distances in metres, a u + b v + c.
  struct Prepared {
    std::array<std::array<double, 3>, 8> edges{};
    int edge_count = 0;
  };

  // A surface whose outline runs through a pixel.
  struct Partial {
    int projected = 0;
    float share = 0;
    float inverse_depth = 0;
    std::int32_t next = -1;  // of the same pixel, -1: none
  };

  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(tile_.width) +
           static_cast<std::size_t>(column);
  }
  bool may_see(const Cluster& cluster, const Pose& T_camera_body) const;
  void project(int surface, int cluster, const Pose& T_camera_body, Vec3 sun, float gain,
               TileImage& image) const;
  void rasterise(int projected, TileImage& image);
  void scan_row(int row, int projected, TileImage& image);
  std::pair<int, int> span(const ProjectedSurface& seen, int row, float inside) const;
  float coverage(const ProjectedSurface& seen, float x, float y) const;
  void shade(TileImage& image) const;
  void mix(TileImage& image);
  float level_at(const ProjectedSurface& seen, float x, float y) const;
  ProjectedSurface::Detail detail_of(const ProjectedSurface& seen) const;
  float shade_at(const ProjectedSurface& seen, float x, float y) const;

  const Scene& scene_;
  Region tile_;
  bool pinhole_ = true;
  double centre_x_ = 0, centre_y_ = 0;    // undistorted position that local coordinates count from
  std::vector<float> local_x_, local_y_;  // undistorted positions of the pixels, relative to the centre
  std::array<float, 4> bounds_{};         // of these: least x, greatest x, least y, greatest y
  std::vector<Cluster> clusters_;
  std::vector<Prepared> prepared_;
  std::vector<Partial> partials_;
  std::vector<std::int32_t> first_partial_;  // per pixel, -1: none
  std::vector<std::int32_t> shared_pixels_;
};

}  // namespace emseg::simulation
