#include "emseg/contrast.hpp"

#include <stdexcept>
#include <string>

namespace emseg {

ContrastMeasure contrast_measure(std::string_view name) {
  if (name == "variance") return ContrastMeasure::variance;
  if (name == "mean_square") return ContrastMeasure::mean_square;
  if (name == "gradient_magnitude") return ContrastMeasure::gradient_magnitude;
  throw std::invalid_argument("unknown contrast measure '" + std::string(name) +
                              "', expected one of variance, mean_square, gradient_magnitude");
}

namespace {

double mean(const Image& image) {
  double sum = 0;
  for (int y = 0; y < image.region.height; ++y) {
    float row_sum = 0;  // rows are short: a float holds them, and the loop runs in vectors
    const float* row = image.row(y);
    for (int x = 0; x < image.region.width; ++x) row_sum += row[x];
    sum += row_sum;
  }
  return sum / static_cast<double>(std::max<std::size_t>(1, image.region.area()));
}

double mean_square_about(const Image& image, double centre) {
  const auto c = static_cast<float>(centre);
  double sum = 0;
  for (int y = 0; y < image.region.height; ++y) {
    float row_sum = 0;
    const float* row = image.row(y);
    for (int x = 0; x < image.region.width; ++x) row_sum += (row[x] - c) * (row[x] - c);
    sum += row_sum;
  }
  return sum / static_cast<double>(std::max<std::size_t>(1, image.region.area()));
}

// Central differences with zeros outside the image.
struct Differences {
  const Image& image;

  float at(int x, int y) const {
    return x < 0 || y < 0 || x >= image.region.width || y >= image.region.height ? 0.0f : image.row(y)[x];
  }
  float dx(int x, int y) const { return 0.5f * (at(x + 1, y) - at(x - 1, y)); }
  float dy(int x, int y) const { return 0.5f * (at(x, y + 1) - at(x, y - 1)); }
};

double mean_gradient_square(const Image& image) {
  const Differences d{image};
  double sum = 0;
  for (int y = 0; y < image.region.height; ++y) {
    for (int x = 0; x < image.region.width; ++x) {
      const double gx = d.dx(x, y);
      const double gy = d.dy(x, y);
      sum += gx * gx + gy * gy;
    }
  }
  return sum / static_cast<double>(std::max<std::size_t>(1, image.region.area()));
}

// Value of the measure; where `adjoint` is given, also the derivative of the value by each pixel of the
// image.
double measure_image(const Image& image, ContrastMeasure measure, Image* adjoint) {
  const float scale = 2.0f / static_cast<float>(std::max<std::size_t>(1, image.region.area()));
  if (measure == ContrastMeasure::gradient_magnitude) {
    if (adjoint) {
      // The central difference's adjoint is its negative: dE/dH = -scale (Dx Dx H + Dy Dy H) inside; at the
      // border the differences reach one pixel outside, where Dx H is defined but H is not.
      adjoint->reset(image.region);
      const Differences d{image};
      for (int y = 0; y < image.region.height; ++y) {
        float* row = adjoint->row(y);
        for (int x = 0; x < image.region.width; ++x) {
          // Pixel (x, y) enters dx at (x-1, y) with +1/2 and at (x+1, y) with -1/2, where those lie inside.
          float sum = 0;
          if (x > 0) sum += 0.5f * d.dx(x - 1, y);
          if (x + 1 < image.region.width) sum -= 0.5f * d.dx(x + 1, y);
          if (y > 0) sum += 0.5f * d.dy(x, y - 1);
          if (y + 1 < image.region.height) sum -= 0.5f * d.dy(x, y + 1);
          row[x] = scale * sum;
        }
      }
    }
    return mean_gradient_square(image);
  }
  const double centre = measure == ContrastMeasure::variance ? mean(image) : 0.0;
  if (adjoint) {
    adjoint->region = image.region;
    adjoint->pixels.resize(image.pixels.size());
    const auto c = static_cast<float>(centre);
    for (std::size_t i = 0; i < image.pixels.size(); ++i) adjoint->pixels[i] = scale * (image.pixels[i] - c);
  }
  return mean_square_about(image, centre);
}

}  // namespace

double contrast(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region region,
                const ContrastOptions& options, ContrastWorkspace& workspace) {
  const auto taps = gaussian_taps(options.sigma);
  workspace.image.region = region;
  make_iwe(workspace.image, points, model, frame, taps, workspace.blur);
  return measure_image(workspace.image, options.measure, nullptr);
}

ContrastResult contrast_and_gradient(const PointView& points, const MotionModel& model,
                                     const WarpFrame& frame, Region region, const ContrastOptions& options,
                                     ContrastWorkspace& workspace) {
  const auto taps = gaussian_taps(options.sigma);
  workspace.image.region = region;
  make_iwe(workspace.image, points, model, frame, taps, workspace.blur);
  ContrastResult result;
  result.value = measure_image(workspace.image, options.measure, &workspace.adjoint);
  gaussian_blur(workspace.adjoint, taps, workspace.blur);
  std::visit(
      [&](const auto& m) {
        using Model = std::decay_t<decltype(m)>;
        const typename Model::Warp warp(m, frame);
        std::array<double, 8> sum{};
        constexpr std::size_t chunk = 512;  // float sums of a chunk, double sums of chunks
        for (std::size_t first = 0; first < points.size(); first += chunk) {
          std::array<float, Model::dof> part{};
          const std::size_t last = std::min(points.size(), first + chunk);
          for (std::size_t k = first; k < last; ++k) {
            const float x = points.x[k], y = points.y[k], dt = points.dt[k];
            const Vec2f at = warp(x, y, dt);
            const BilinearSample slope = bilinear_sample(workspace.adjoint, at.x, at.y);
            const auto jacobian = warp.jacobian(x, y, dt);
            for (std::size_t d = 0; d < part.size(); ++d) {
              part[d] += slope.dx * jacobian.dx[d] + slope.dy * jacobian.dy[d];
            }
          }
          for (std::size_t d = 0; d < part.size(); ++d) sum[d] += part[d];
        }
        result.gradient = sum;
      },
      model);
  return result;
}

}  // namespace emseg
