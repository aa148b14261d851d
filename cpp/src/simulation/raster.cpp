#include "emseg/simulation/raster.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "coverage.hpp"
#include "emseg/simulation/numeric.hpp"

namespace emseg::simulation {
namespace {

constexpr float least_inverse_depth = 1e-4f;  // 10 km: what is farther is sky
constexpr float greatest_inverse_depth = 100.0f;
constexpr float covered = 1 - 1e-4f;  // shares above it are the whole pixel, shares below 1e-4 nothing
constexpr double neighbourhood = 16;  // px around a tile in which bodies are watched
constexpr int level_block = 8;        // px over which the level of a texture is interpolated
constexpr float infinity = std::numeric_limits<float>::infinity();

struct Form {
  double c, gx, gy;

  friend Form operator+(Form a, Form b) { return {a.c + b.c, a.gx + b.gx, a.gy + b.gy}; }
  friend Form operator-(Form a, Form b) { return {a.c - b.c, a.gx - b.gx, a.gy - b.gy}; }
  friend Form operator*(double s, Form a) { return {s * a.c, s * a.gx, s * a.gy}; }
  explicit operator Affine() const {
    return {static_cast<float>(c), static_cast<float>(gx), static_cast<float>(gy)};
  }
};

}  // namespace

TileRenderer::TileRenderer(const Scene& scene, const UndistortionTable& undistortion, Region tile)
    : scene_(scene), tile_(tile), pinhole_(scene.camera.model == DistortionModel::none) {
  assert(tile.width > 0 && tile.height > 0);
  std::vector<std::pair<double, double>> places;
  for (int y = tile.y0; y < tile.y0 + tile.height; ++y) {
    for (int x = tile.x0; x < tile.x0 + tile.width; ++x) {
      const auto k = static_cast<std::size_t>(y) * static_cast<std::size_t>(scene.camera.size.width) +
                     static_cast<std::size_t>(x);
      places.emplace_back(undistortion.x[k], undistortion.y[k]);
    }
  }
  centre_x_ = places[places.size() / 2].first;
  centre_y_ = places[places.size() / 2].second;
  bounds_ = {infinity, -infinity, infinity, -infinity};
  for (const auto& [x, y] : places) {
    local_x_.push_back(static_cast<float>(x - centre_x_));
    local_y_.push_back(static_cast<float>(y - centre_y_));
    bounds_ = {std::min(bounds_[0], local_x_.back()), std::max(bounds_[1], local_x_.back()),
               std::min(bounds_[2], local_y_.back()), std::max(bounds_[3], local_y_.back())};
  }
  for (std::size_t k = 0; k < scene.surfaces.size(); ++k) {
    const Surface& surface = scene.surfaces[k];
    const auto& corners = surface.outline.polygon;
    Prepared prepared;
    prepared.edge_count = static_cast<int>(corners.size());
    for (std::size_t e = 0; e < corners.size(); ++e) {
      const PlanePoint p = corners[e], q = corners[(e + 1) % corners.size()];
      const double length = std::hypot(q.u - p.u, q.v - p.v);
      const double a = -(q.v - p.v) / length, b = (q.u - p.u) / length;
      prepared.edges[e] = {a, b, -(a * p.u + b * p.v)};
    }
    prepared_.push_back(prepared);
    if (clusters_.empty() || clusters_.back().body != surface.body) {
      clusters_.push_back({surface.body, static_cast<int>(k), static_cast<int>(k), {}, 0, {}});
    }
    clusters_.back().end = static_cast<int>(k) + 1;
    auto& lights = clusters_.back().lights;
    if (std::find(lights.begin(), lights.end(), surface.light) == lights.end())
      lights.push_back(surface.light);
  }
  for (Cluster& cluster : clusters_) {
    std::vector<Vec3> corners;
    for (int k = cluster.begin; k < cluster.end; ++k) {
      const Surface& surface = scene.surfaces[static_cast<std::size_t>(k)];
      for (const PlanePoint p : surface.outline.polygon) {
        corners.push_back(surface.origin + p.u * surface.axis_u + p.v * surface.axis_v);
      }
    }
    for (const Vec3 corner : corners) {
      cluster.centre = cluster.centre + (1.0 / static_cast<double>(corners.size())) * corner;
    }
    for (const Vec3 corner : corners)
      cluster.radius = std::max(cluster.radius, norm(corner - cluster.centre));
  }
}

Pose TileRenderer::camera_from_body(const ProjectedSurface& seen, double seconds) const {
  const Surface& surface = scene_.surfaces[static_cast<std::size_t>(seen.surface)];
  return inverse(scene_.T_world_camera.at(seconds)) *
         scene_.bodies[static_cast<std::size_t>(surface.body)].T_world_body.at(seconds);
}

// Whether a sphere around the cluster reaches into the pyramid of rays through the tile and its
// neighbourhood.
bool TileRenderer::may_see(const Cluster& cluster, const Pose& T_camera_body) const {
  const Camera& camera = scene_.camera;
  const Vec3 p = T_camera_body * cluster.centre;
  if (p.z < -cluster.radius) return false;
  const double left = (bounds_[0] - neighbourhood + centre_x_ - camera.cx) / camera.fx;
  const double right = (bounds_[1] + neighbourhood + centre_x_ - camera.cx) / camera.fx;
  const double top = (bounds_[2] - neighbourhood + centre_y_ - camera.cy) / camera.fy;
  const double bottom = (bounds_[3] + neighbourhood + centre_y_ - camera.cy) / camera.fy;
  const auto beyond = [&](double distance, double slope) {
    return distance < -cluster.radius * std::sqrt(1 + slope * slope);
  };
  return !(beyond(p.x - left * p.z, left) || beyond(right * p.z - p.x, right) ||
           beyond(p.y - top * p.z, top) || beyond(bottom * p.z - p.y, bottom));
}

bool TileRenderer::render(double seconds, TileImage& image, const TileImage* before) {
  image.seconds = seconds;
  image.gains.assign(scene_.lights.size(), 1.0f);
  image.T_camera_bodies.clear();
  const Pose T_world_camera = scene_.T_world_camera.at(seconds);
  const Pose T_camera_world = inverse(T_world_camera);
  const Vec3 sun = T_camera_world.rotate(scene_.sun);
  for (std::size_t k = 0; k < clusters_.size(); ++k) {
    const Body& body = scene_.bodies[static_cast<std::size_t>(clusters_[k].body)];
    const Pose T_camera_body = T_camera_world * body.T_world_body.at(seconds);
    if (may_see(clusters_[k], T_camera_body)) {
      image.T_camera_bodies.emplace_back(static_cast<int>(k), T_camera_body);
      for (const int light : clusters_[k].lights) {
        const auto index = static_cast<std::size_t>(light);
        image.gains[index] = scene_.lights[index].at(seconds);
      }
    }
  }
  if (before != nullptr && before->T_camera_bodies == image.T_camera_bodies && before->gains == image.gains) {
    return false;
  }
  const std::size_t pixels = local_x_.size();
  image.intensity.assign(pixels, 0.0f);
  image.inverse_depth.assign(pixels, least_inverse_depth);
  image.front.assign(pixels, -1);
  image.mixture.assign(pixels, -1);
  image.mixtures.clear();
  image.layers.clear();
  image.surfaces.clear();
  partials_.clear();
  shared_pixels_.clear();
  first_partial_.assign(pixels, -1);
  for (const auto& [k, T_camera_body] : image.T_camera_bodies) {
    const Cluster& cluster = clusters_[static_cast<std::size_t>(k)];
    for (int surface = cluster.begin; surface < cluster.end; ++surface) {
      const int light = scene_.surfaces[static_cast<std::size_t>(surface)].light;
      project(surface, k, T_camera_body, sun, image.gains[static_cast<std::size_t>(light)], image);
    }
  }
  for (std::size_t k = 0; k < image.surfaces.size(); ++k) rasterise(static_cast<int>(k), image);
  shade(image);
  mix(image);
  return true;
}

void TileRenderer::project(int surface_index, int cluster, const Pose& T_camera_body, Vec3 sun, float gain,
                           TileImage& image) const {
  const auto index = static_cast<std::size_t>(surface_index);
  const Surface& surface = scene_.surfaces[index];
  const Camera& camera = scene_.camera;
  const Vec3 o = T_camera_body * surface.origin;
  const Vec3 a = T_camera_body.rotate(surface.axis_u), b = T_camera_body.rotate(surface.axis_v);
  const Vec3 n = cross(a, b);
  const double facing = dot(n, o);  // negative where the normal points to the camera
  if ((!surface.two_sided && facing > 0) || std::abs(facing) < 1e-9) return;
  // Along the ray (x, y, 1) the plane's inverse depth is n . ray / n . o, and so on.
  const auto over_pixels = [&](Vec3 r) {
    const double gx = r.x / camera.fx, gy = r.y / camera.fy;
    return Form{r.z + gx * (centre_x_ - camera.cx) + gy * (centre_y_ - camera.cy), gx, gy};
  };
  const Form w = (1 / facing) * over_pixels(n);
  const Form u = over_pixels(a) - dot(o, a) * w, v = over_pixels(b) - dot(o, b) * w;

  ProjectedSurface seen;
  seen.surface = surface_index;
  seen.cluster = cluster;
  seen.u = Affine(u);
  seen.v = Affine(v);
  seen.w = Affine(w);
  const auto range = [&](const Affine& form) {
    float low = infinity, high = -infinity;
    for (const float x : {bounds_[0], bounds_[1]}) {
      for (const float y : {bounds_[2], bounds_[3]}) {
        low = std::min(low, form.at(x, y));
        high = std::max(high, form.at(x, y));
      }
    }
    return std::pair(low, high);
  };
  if (range(seen.w).second < least_inverse_depth) return;
  const Prepared& prepared = prepared_[index];
  for (int k = 0; k < prepared.edge_count; ++k) {
    const auto& edge = prepared.edges[static_cast<std::size_t>(k)];
    const Form e = edge[0] * u + edge[1] * v + edge[2] * w;
    const double slope = std::sqrt(e.gx * e.gx + e.gy * e.gy);
    const auto distance = Affine((1 / std::max(slope, 1e-12)) * e);
    const auto [low, high] = range(distance);
    if (high < -0.75f) return;
    if (low < 0.75f) seen.edges[static_cast<std::size_t>(seen.edge_count++)] = distance;
  }
  // Corners of quadrilaterals count opposite sides in pairs: keep all four, or none.
  if (seen.edge_count > 0 && prepared.edge_count == 4) {
    seen.edge_count = 4;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto& edge = prepared.edges[k];
      const Form e = edge[0] * u + edge[1] * v + edge[2] * w;
      seen.edges[k] = Affine((1 / std::max(std::sqrt(e.gx * e.gx + e.gy * e.gy), 1e-12)) * e);
    }
  }
  const double length = norm(n), side = facing > 0 ? -1.0 : 1.0;
  const double lit = std::max(0.0, -side * dot(n, sun) / length);
  seen.brightness = gain * static_cast<float>(scene_.ambient + (1 - scene_.ambient) * lit);
  image.surfaces.push_back(seen);
}

// Columns of a row at which all edges are at least `inside` px inside; for a pinhole camera.
std::pair<int, int> TileRenderer::span(const ProjectedSurface& seen, int row, float inside) const {
  const std::size_t start = index(0, row);
  const float x0 = local_x_[start], y = local_y_[start];
  float begin = 0, end = static_cast<float>(tile_.width);
  for (int k = 0; k < seen.edge_count; ++k) {
    const Affine& edge = seen.edges[static_cast<std::size_t>(k)];
    const float here = edge.at(x0, y) - inside;
    if (edge.gx > 1e-9f) {
      begin = std::max(begin, std::ceil(-here / edge.gx));
    } else if (edge.gx < -1e-9f) {
      end = std::min(end, std::floor(here / -edge.gx) + 1);
    } else if (here < 0) {
      return {0, 0};
    }
  }
  if (!(begin < end)) return {0, 0};
  return {static_cast<int>(begin), static_cast<int>(end)};
}

void TileRenderer::rasterise(int projected, TileImage& image) {
  for (int row = 0; row < tile_.height; ++row) scan_row(row, projected, image);
}

void TileRenderer::scan_row(int row, int projected, TileImage& image) {
  const ProjectedSurface& seen = image.surfaces[static_cast<std::size_t>(projected)];
  const Outline& outline = scene_.surfaces[static_cast<std::size_t>(seen.surface)].outline;
  std::pair<int, int> touched{0, tile_.width}, inside = touched;
  if (seen.edge_count > 0) {
    if (pinhole_) touched = span(seen, row, -0.5f);
    inside = pinhole_ ? span(seen, row, 0.5f) : std::pair(0, 0);
    if (touched.first >= touched.second) return;
  }
  if (outline.kind != OutlineKind::polygon || inside.first >= inside.second) {
    inside = {touched.second, touched.second};
  }
  const std::size_t start = index(0, row);
  const float* local_x = local_x_.data() + start;
  const float* local_y = local_y_.data() + start;
  float* depth = image.inverse_depth.data() + start;
  std::int16_t* front = image.front.data() + start;
  const auto name = static_cast<std::int16_t>(projected);

  const auto partly = [&](int x) {
    const float w = seen.w.at(local_x[x], local_y[x]);
    // Half a pixel off the centre the surface may be nearer: where things touch, it wins.
    const float nearer = w + 0.75f * (std::abs(seen.w.gx) + std::abs(seen.w.gy));
    if (w < least_inverse_depth || w > greatest_inverse_depth || nearer <= depth[x]) return;
    const float share = coverage(seen, local_x[x], local_y[x]);
    if (share > covered) {
      if (w > depth[x]) depth[x] = w, front[x] = name;
    } else if (share > 1 - covered) {
      const std::size_t pixel = start + static_cast<std::size_t>(x);
      if (first_partial_[pixel] < 0) shared_pixels_.push_back(static_cast<std::int32_t>(pixel));
      partials_.push_back({projected, share, nearer, first_partial_[pixel]});
      first_partial_[pixel] = static_cast<std::int32_t>(partials_.size()) - 1;
    }
  };
  for (int x = touched.first; x < inside.first; ++x) partly(x);
  for (int x = inside.first; x < inside.second; ++x) {
    const float w = seen.w.at(local_x[x], local_y[x]);
    const bool wins = w > depth[x] && w < greatest_inverse_depth;
    depth[x] = wins ? w : depth[x];
    front[x] = wins ? name : front[x];
  }
  for (int x = inside.second; x < touched.second; ++x) partly(x);
}

// Share of a pixel that the surface covers, were nothing in front.
float TileRenderer::coverage(const ProjectedSurface& seen, float x, float y) const {
  const float share = polygon_coverage(seen, x, y);
  const Outline& outline = scene_.surfaces[static_cast<std::size_t>(seen.surface)].outline;
  if (share <= 0 || outline.kind == OutlineKind::polygon) return share;
  const Footprint footprint = footprint_at(seen, x, y);
  return share * (outline.kind == OutlineKind::blob ? blob_coverage(outline, footprint)
                                                    : net_coverage(outline, footprint));
}

// Level of the texture's pyramid whose texels are as large as the pixel in the direction in which it is
// larger.
float TileRenderer::level_at(const ProjectedSurface& seen, float x, float y) const {
  const Footprint f = footprint_at(seen, x, y);
  const float across = f.ux * f.ux + f.vx * f.vx, down = f.uy * f.uy + f.vy * f.vy;
  const auto scale =
      static_cast<float>(scene_.surfaces[static_cast<std::size_t>(seen.surface)].texels_per_metre);
  const float texels = std::max(across, down) * (scale * scale);
  if (!(texels > 2)) return 0;
  return 0.5f * (1.44269504f * fast_log(std::min(texels, 1e30f)) - 1);
}

// Over a tile the size of texels in the image has its extremes at the corners.
ProjectedSurface::Detail TileRenderer::detail_of(const ProjectedSurface& seen) const {
  for (const float x : {bounds_[0], bounds_[1]}) {
    for (const float y : {bounds_[2], bounds_[3]}) {
      if (seen.w.at(x, y) < least_inverse_depth || level_at(seen, x, y) > 0) {
        return ProjectedSurface::Detail::varying;
      }
    }
  }
  return ProjectedSurface::Detail::finest;
}

float TileRenderer::shade_at(const ProjectedSurface& seen, float x, float y) const {
  const Surface& surface = scene_.surfaces[static_cast<std::size_t>(seen.surface)];
  const Texture& texture = scene_.textures[static_cast<std::size_t>(surface.texture)];
  const auto scale = static_cast<float>(surface.texels_per_metre);
  const float depth = 1 / std::max(seen.w.at(x, y), least_inverse_depth);
  const float tu = seen.u.at(x, y) * depth * scale + static_cast<float>(surface.texture_offset[0]);
  const float tv = seen.v.at(x, y) * depth * scale + static_cast<float>(surface.texture_offset[1]);
  return seen.brightness * texture.sample(tu, tv, level_at(seen, x, y));
}

// Intensity of every pixel from the surface in front, run by run of pixels with the same one.
void TileRenderer::shade(TileImage& image) const {
  for (int row = 0; row < tile_.height; ++row) {
    const std::size_t start = index(0, row);
    const float* local_x = local_x_.data() + start;
    const float* local_y = local_y_.data() + start;
    const std::int16_t* front = image.front.data() + start;
    float* intensity = image.intensity.data() + start;
    for (int begin = 0, end = 0; begin < tile_.width; begin = end) {
      while (end < tile_.width && front[end] == front[begin]) ++end;
      if (front[begin] < 0) {
        std::fill(intensity + begin, intensity + end, static_cast<float>(scene_.sky));
        continue;
      }
      ProjectedSurface& seen = image.surfaces[static_cast<std::size_t>(front[begin])];
      seen.show(begin, row);
      seen.show(end - 1, row);
      const float brightness = seen.brightness;
      const Surface& surface = scene_.surfaces[static_cast<std::size_t>(seen.surface)];
      const Texture& texture = scene_.textures[static_cast<std::size_t>(surface.texture)];
      const auto scale = static_cast<float>(surface.texels_per_metre);
      const auto offset_u = static_cast<float>(surface.texture_offset[0]);
      const auto offset_v = static_cast<float>(surface.texture_offset[1]);
      const auto texel = [&](int x, auto sample) {
        const float depth = scale / seen.w.at(local_x[x], local_y[x]);
        const float tu = seen.u.at(local_x[x], local_y[x]) * depth + offset_u;
        const float tv = seen.v.at(local_x[x], local_y[x]) * depth + offset_v;
        return brightness * sample(tu, tv);
      };
      if (seen.detail == ProjectedSurface::Detail::unknown) seen.detail = detail_of(seen);
      if (seen.detail == ProjectedSurface::Detail::finest) {
        const Texture::Level finest = texture.level(0);
        for (int x = begin; x < end; ++x) {
          intensity[x] = texel(x, [&](float tu, float tv) { return finest.sample(tu, tv); });
        }
        continue;
      }
      // Along a few columns the level is as good as linear.  Which ones they are does not depend on the run:
      // what a surface shows must not change as something else passes by.
      const int coarsest = texture.level_count() - 1;
      int column = begin - begin % level_block;
      float level = level_at(seen, local_x[column], local_y[column]);
      for (int next; column < end; column = next) {
        next = column + level_block;
        const int knot = std::min(next, tile_.width - 1);
        const float next_level = level_at(seen, local_x[knot], local_y[knot]);
        const float step = knot > column ? (next_level - level) / static_cast<float>(knot - column) : 0;
        const auto fine = static_cast<int>(level);
        const bool between_two = static_cast<int>(next_level) == fine && fine + 1 < texture.level_count();
        const Texture::Level finer = texture.level(std::min(fine, coarsest)),
                             coarser = texture.level(std::min(fine + 1, coarsest));
        for (int x = std::max(begin, column); x < std::min(end, next); ++x) {
          const float here = level + static_cast<float>(x - column) * step;
          intensity[x] = texel(x, [&](float tu, float tv) {
            if (!between_two) return texture.sample(tu, tv, here);
            const float near = finer.sample(tu, tv);
            return near + (here - static_cast<float>(fine)) * (coarser.sample(tu, tv) - near);
          });
        }
        level = next_level;
      }
    }
  }
}

// Pixels that outlines run through: their surfaces take shares from front to back until the pixel is full.
void TileRenderer::mix(TileImage& image) {
  std::array<Partial, 16> stack{};
  for (const std::int32_t pixel : shared_pixels_) {
    const auto p = static_cast<std::size_t>(pixel);
    std::size_t count = 0;
    for (std::int32_t k = first_partial_[p]; k >= 0; k = partials_[static_cast<std::size_t>(k)].next) {
      const Partial partial = partials_[static_cast<std::size_t>(k)];
      if (partial.inverse_depth <= image.inverse_depth[p]) continue;
      if (count == stack.size()) --count;  // the farthest of too many
      std::size_t place = count++;
      for (; place > 0 && stack[place - 1].inverse_depth < partial.inverse_depth; --place) {
        stack[place] = stack[place - 1];
      }
      stack[place] = partial;
    }
    if (count == 0) continue;
    const float x = local_x_[p], y = local_y_[p];
    const auto column = static_cast<int>(p % static_cast<std::size_t>(tile_.width));
    const auto row = static_cast<int>(p / static_cast<std::size_t>(tile_.width));
    const auto begin = static_cast<int>(image.layers.size());
    float left = 1, sum = 0;
    for (std::size_t k = 0; k < count && left > 1 - covered; ++k) {
      ProjectedSurface& seen = image.surfaces[static_cast<std::size_t>(stack[k].projected)];
      seen.show(column, row);
      const float weight = std::min(stack[k].share, left);
      const float intensity = shade_at(seen, x, y);
      image.layers.push_back({stack[k].projected, weight, intensity, stack[k].inverse_depth});
      left -= weight;
      sum += weight * intensity;
    }
    if (left > 1 - covered) {
      image.layers.push_back({image.front[p], left, image.intensity[p], image.inverse_depth[p]});
      sum += left * image.intensity[p];
    }
    image.intensity[p] = sum;
    image.mixture[p] = static_cast<std::int32_t>(image.mixtures.size());
    image.mixtures.emplace_back(begin, static_cast<int>(image.layers.size()));
  }
}

TileRenderer::Landing TileRenderer::land(const ProjectedSurface& seen, float x, float y,
                                         const Pose& T_camera_body) const {
  const Surface& surface = scene_.surfaces[static_cast<std::size_t>(seen.surface)];
  const double w = seen.w.at(x, y);
  if (!(w >= least_inverse_depth)) return {};
  const double u = seen.u.at(x, y) / w, v = seen.v.at(x, y) / w;
  const Vec3 p = T_camera_body * (surface.origin + u * surface.axis_u + v * surface.axis_v);
  if (!(p.z > 1 / double{greatest_inverse_depth})) return {};
  const Camera& camera = scene_.camera;
  return {true, {camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy}, p.z};
}

double TileRenderer::largest_passage(const TileImage& from, const TileImage& to) const {
  const Camera& camera = scene_.camera;
  double largest = 0;
  auto there = to.T_camera_bodies.begin();
  for (const auto& [k, T_camera_body] : from.T_camera_bodies) {  // both lists are in the clusters' order
    while (there != to.T_camera_bodies.end() && there->first < k) ++there;
    if (there == to.T_camera_bodies.end()) break;
    if (there->first != k || there->second == T_camera_body) continue;
    const Cluster& cluster = clusters_[static_cast<std::size_t>(k)];
    const Vec3 p = T_camera_body * cluster.centre, q = there->second * cluster.centre;
    // Around the camera a middle says nothing; what is seen of such a body bounds its motion.
    if (p.z < 2 * cluster.radius || q.z < 2 * cluster.radius) continue;
    const double dx = camera.fx * (q.x / q.z - p.x / p.z), dy = camera.fy * (q.y / q.z - p.y / p.z);
    largest = std::max(largest, std::sqrt(dx * dx + dy * dy));
  }
  return largest;
}

double TileRenderer::largest_motion(const TileImage& from, const TileImage& to) const {
  double largest = 0;
  for (const ProjectedSurface& seen : from.surfaces) {
    if (!seen.is_seen()) continue;
    const auto known = std::find_if(to.T_camera_bodies.begin(), to.T_camera_bodies.end(),
                                    [&](const auto& entry) { return entry.first == seen.cluster; });
    const Pose T_camera_body =
        known != to.T_camera_bodies.end() ? known->second : camera_from_body(seen, to.seconds);
    for (const int column : {seen.x_min, seen.x_max}) {
      for (const int row : {seen.y_min, seen.y_max}) {
        const float x = local_x(column, row), y = local_y(column, row);
        const Landing landing = land(seen, x, y, T_camera_body);
        if (!landing.in_front) continue;
        const double dx = landing.pixel.x - (centre_x_ + x), dy = landing.pixel.y - (centre_y_ + y);
        largest = std::max(largest, std::sqrt(dx * dx + dy * dy));
      }
    }
  }
  return largest;
}

}  // namespace emseg::simulation
