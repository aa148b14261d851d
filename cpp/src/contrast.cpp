#include "emseg/contrast.hpp"

#include <stdexcept>
#include <string>

#include "iwe_rows.hpp"
#include "warp_field.hpp"

namespace emseg {

ContrastMeasure contrast_measure(std::string_view name) {
  if (name == "variance") return ContrastMeasure::variance;
  if (name == "mean_square") return ContrastMeasure::mean_square;
  if (name == "gradient_magnitude") return ContrastMeasure::gradient_magnitude;
  throw std::invalid_argument("unknown contrast measure '" + std::string(name) +
                              "', expected one of variance, mean_square, gradient_magnitude");
}

namespace {

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

// Derivative of mean_gradient_square by each pixel, times half the number of pixels.
void gradient_square_adjoint(const Image& image, Image& adjoint) {
  // The central difference's adjoint is its negative: dE/dH = -scale (Dx Dx H + Dy Dy H) inside; at the
  // border the differences reach one pixel outside, where Dx H is defined but H is not.
  adjoint.reset(image.region);
  const Differences d{image};
  for (int y = 0; y < image.region.height; ++y) {
    float* row = adjoint.row(y);
    for (int x = 0; x < image.region.width; ++x) {
      // Pixel (x, y) enters dx at (x-1, y) with +1/2 and at (x+1, y) with -1/2, where those lie inside.
      float sum = 0;
      if (x > 0) sum += 0.5f * d.dx(x - 1, y);
      if (x + 1 < image.region.width) sum -= 0.5f * d.dx(x + 1, y);
      if (y > 0) sum += 0.5f * d.dy(x, y - 1);
      if (y + 1 < image.region.height) sum -= 0.5f * d.dy(x, y + 1);
      row[x] = sum;
    }
  }
}

// One evaluation. `cells` of the workspace become the derivative of the value by each vote, times half the
// number of pixels: J = G*(H - c), with c the mean for the variance, in the grid's layout.
class Evaluation {
 public:
  Evaluation(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region region,
             const ContrastOptions& options, ContrastWorkspace& workspace)
      : points_(points),
        model_(model),
        frame_(frame),
        region_(region),
        measure_(options.measure),
        taps_(gaussian_taps(options.sigma)),
        field_(warp_field(model, frame)),
        workspace_(workspace) {}

  double value() {
    if (region_.area() == 0) return 0;
    grid_.reset(region_);
    vote_warped(grid_, points_, field_, iwe_.places, Places::kept);
    voted_ = grid_.voted();
    area_ = blurred_area(voted_, region_, taps_);
    return measure_ == ContrastMeasure::gradient_magnitude ? gradient_magnitude() : moments();
  }

  std::array<double, 8> gradient() {
    if (voted_.area() == 0) return {};
    if (measure_ == ContrastMeasure::gradient_magnitude) {
      spread_gradient_adjoint();
    } else {
      spread_image();
    }
    return slopes_by_parameters();
  }

 private:
  std::size_t width() const { return static_cast<std::size_t>(area_.width); }
  std::size_t stride() const { return rounded_up(width(), line_floats); }
  int radius() const { return static_cast<int>(taps_.size()) - 1; }
  double pixels() const { return static_cast<double>(region_.area()); }

  // Mean square of the blurred image, about its mean for the variance.  Its rows are blurred along themselves
  // once more for the gradient while they are at hand.
  double moments() {
    double sum = 0, square = 0;
    const std::size_t margin = rounded_up(taps_.size() - 1, line_floats);
    workspace_.padded.assign(2 * margin + stride(), 0.0f);
    float* const row = workspace_.padded.data() + margin;
    workspace_.rows.resize(stride() * static_cast<std::size_t>(area_.height));
    take_blurred(
        grid_, area_, taps_, iwe_.blur, [&](int) { return row; },
        [&](int y, const float*) {
          kernels().add_sums(row, stride(), &sum, &square);  // zeros after the row included
          kernels().filter_row(row, width(), taps_.data(), radius(), once_more(y));
        });
    mean_ = measure_ == ContrastMeasure::variance ? sum / pixels() : 0;
    return std::max(0.0, square / pixels() - mean_ * mean_);
  }

  // Row y of the image blurred once more along its rows; y in area_.
  float* once_more(int y) {
    return workspace_.rows.data() + static_cast<std::size_t>(y - area_.y0) * stride();
  }

  // The second pass of the second blur, where there are votes, less what a constant image of `mean_` gives
  // there.
  void spread_image() {
    cells_ = grid_.cells_without_border(iwe_.cells);
    const auto across = blurred_ones(region_.width), down = blurred_ones(region_.height);
    workspace_.padded.assign(stride(), 0.0f);
    std::vector<const float*> window(2 * taps_.size() - 1);
    for (int y = voted_.y0; y < voted_.y0 + voted_.height; ++y) {
      for (int d = -radius(); d <= radius(); ++d) {
        const bool inside = y + d >= area_.y0 && y + d < area_.y0 + area_.height;
        window[static_cast<std::size_t>(d + radius())] = inside ? once_more(y + d) : workspace_.padded.data();
      }
      float* const to = cells_ + grid_.cell_of(area_.x0, y);
      kernels().filter_rows(window.data(), width(), taps_.data(), radius(), to);
      const auto level = static_cast<float>(mean_ * down[static_cast<std::size_t>(y)]);
      if (level != 0) kernels().subtract_scaled(to, across.data() + area_.x0, level, width());
    }
  }

  // An image row of ones, blurred: less than one near its ends.
  std::vector<float> blurred_ones(int length) const {
    const auto n = static_cast<std::size_t>(length);
    std::vector<float> ones(n + 2 * taps_.size(), 0.0f), blurred(n);
    std::fill_n(ones.begin() + static_cast<std::ptrdiff_t>(taps_.size()), n, 1.0f);
    kernels().filter_row(ones.data() + taps_.size(), n, taps_.data(), static_cast<int>(taps_.size()) - 1,
                         blurred.data());
    return blurred;
  }

  double gradient_magnitude() {
    Image& image = workspace_.image;
    image.reset(region_);
    take_blurred(
        grid_, area_, taps_, iwe_.blur, [&](int y) { return image.row(y) + area_.x0; }, [](int, float*) {});
    return mean_gradient_square(image);
  }

  void spread_gradient_adjoint() {
    Image& adjoint = workspace_.adjoint;
    gradient_square_adjoint(workspace_.image, adjoint);
    gaussian_blur(adjoint, taps_, iwe_.blur);
    cells_ = grid_.cells_without_border(iwe_.cells);
    for (int y = 0; y < region_.height; ++y) {
      std::copy_n(adjoint.row(y), region_.width, cells_ + grid_.cell_of(0, y));
    }
  }

  // sum_k grad J(x'_k) · dx'_k/dtheta
  std::array<double, 8> slopes_by_parameters() const {
    constexpr std::size_t chunk = 512;  // float sums of a chunk, double sums of chunks
    std::array<float, chunk> dx, dy;
    std::array<double, 8> by_coefficient{};
    const VotePlaces& at = iwe_.places;
    for (std::size_t first = 0; first < points_.size(); first += chunk) {
      const std::size_t count = std::min(chunk, points_.size() - first);
      kernels().sample_slopes(cells_, grid_.stride(), at.cell.data() + first, at.right.data() + first,
                              at.low.data() + first, count, dx.data(), dy.data());
      if (!points_.sign.empty()) {
        for (std::size_t k = 0; k < count; ++k) {
          dx[k] *= points_.sign[first + k];
          dy[k] *= points_.sign[first + k];
        }
      }
      kernels().add_gradient(field_, points_.x.data() + first, points_.y.data() + first,
                             points_.dt.data() + first, dx.data(), dy.data(), count, by_coefficient.data());
    }
    for (double& slope : by_coefficient) slope *= 2 / pixels();
    return parameter_gradient(model_, frame_, by_coefficient);
  }

  const PointView& points_;
  const MotionModel& model_;
  const WarpFrame& frame_;
  Region region_;
  ContrastMeasure measure_;
  std::vector<float> taps_;
  WarpField field_;
  ContrastWorkspace& workspace_;
  IweWorkspace& iwe_ = workspace_.iwe;
  VoteGrid& grid_ = workspace_.iwe.grid;
  float* cells_ = nullptr;
  Region voted_, area_;  // of the region, where votes are, and where the blurred image is not zero
  double mean_ = 0;
};

}  // namespace

double contrast(const PointView& points, const MotionModel& model, const WarpFrame& frame, Region region,
                const ContrastOptions& options, ContrastWorkspace& workspace) {
  return Evaluation(points, model, frame, region, options, workspace).value();
}

ContrastResult contrast_and_gradient(const PointView& points, const MotionModel& model,
                                     const WarpFrame& frame, Region region, const ContrastOptions& options,
                                     ContrastWorkspace& workspace) {
  Evaluation evaluation(points, model, frame, region, options, workspace);
  ContrastResult result;
  result.value = evaluation.value();
  result.gradient = evaluation.gradient();
  return result;
}

}  // namespace emseg
