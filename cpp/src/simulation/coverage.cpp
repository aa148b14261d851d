#include "coverage.hpp"

#include <array>
#include <cmath>

namespace emseg::simulation {
namespace {

float length(float x, float y) { return std::sqrt(x * x + y * y); }

// Share of a pixel covered by bars of a net that lie `pitch` apart; `u` and the pixel's `footprint` in
// metres.
float bars(float u, float pitch, float bar, float footprint) {
  if (!(pitch > 0)) return 0;
  const float turns = u / pitch;
  const auto nearest = static_cast<float>(static_cast<int>(turns + (turns < 0 ? -0.5f : 0.5f)));
  const float from_bar = std::abs(u - pitch * nearest);
  return strip((bar / 2 - from_bar) / footprint, (bar / 2 + from_bar) / footprint);
}

}  // namespace

float polygon_coverage(const ProjectedSurface& seen, float x, float y) {
  std::array<float, 8> inside{};
  const auto count = static_cast<std::size_t>(seen.edge_count);
  for (std::size_t k = 0; k < count; ++k) inside[k] = seen.edges[k].at(x, y);
  float share = 1;
  if (count == 4) {
    share = strip(inside[0], inside[2]) * strip(inside[1], inside[3]);
  } else {
    for (std::size_t k = 0; k < count; ++k) share *= clamp01(inside[k] + 0.5f);
  }
  // At a sharp corner the product would reach far beyond the tip, where the strip between the sides has no
  // width.
  for (std::size_t k = 0; k < count && share > 0; ++k) {
    for (std::size_t j = k + 1; j < count; ++j) {
      const float opposed = -(seen.edges[k].gx * seen.edges[j].gx + seen.edges[k].gy * seen.edges[j].gy);
      const float sharp = clamp01((opposed - 0.6f) / 0.35f);
      if (sharp > 0) share -= sharp * std::max(0.0f, share - strip(inside[k], inside[j]));
    }
  }
  return share;
}

float blob_coverage(const Outline& outline, const Footprint& f) {
  const float r = std::sqrt(f.u * f.u + f.v * f.v);
  const auto radius = static_cast<float>(outline.radius);
  float stray = 0;  // of the outline from its circle, at most
  for (const auto& [a, b] : outline.harmonics) stray += static_cast<float>(std::abs(a) + std::abs(b));
  const float pixel = std::abs(f.ux) + std::abs(f.uy) + std::abs(f.vx) + std::abs(f.vy);
  if (r < std::max(radius * (1 - stray) - pixel, 1e-3f * radius)) return 1;
  if (r > radius * (1 + stray) + pixel) return 0;
  const float cosine = f.u / r, sine = f.v / r;
  float re = cosine, im = sine;  // of exp(i k angle)
  float extent = 1, slope = 0;   // of the outline over the angle, in radii
  for (std::size_t k = 0; k < outline.harmonics.size(); ++k) {
    const float next = re * cosine - im * sine;
    im = re * sine + im * cosine;
    re = next;
    const auto a = static_cast<float>(outline.harmonics[k][0]),
               b = static_cast<float>(outline.harmonics[k][1]);
    extent += a * re + b * im;
    slope += static_cast<float>(k + 2) * (b * re - a * im);
  }
  // The gradient of r - R(angle), on the plane and then in the image.
  const float tangent = radius * slope / r;
  const float gu = cosine + tangent * sine, gv = sine - tangent * cosine;
  const float gx = gu * f.ux + gv * f.vx, gy = gu * f.uy + gv * f.vy;
  const float per_px = std::sqrt(gx * gx + gy * gy);
  return clamp01((radius * extent - r) / std::max(per_px, 1e-12f) + 0.5f);
}

float net_coverage(const Outline& outline, const Footprint& f) {
  const auto bar = static_cast<float>(outline.bar);
  const float along_u = bars(f.u, static_cast<float>(outline.pitch[0]), bar, length(f.ux, f.uy));
  const float along_v = bars(f.v, static_cast<float>(outline.pitch[1]), bar, length(f.vx, f.vy));
  return 1 - (1 - along_u) * (1 - along_v);
}

}  // namespace emseg::simulation
