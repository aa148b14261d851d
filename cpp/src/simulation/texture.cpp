#include "emseg/simulation/texture.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "emseg/simulation/random.hpp"

namespace emseg::simulation {
namespace {

[[noreturn]] void refuse(const char* name, double value, const char* expected) {
  throw std::invalid_argument("texture: " + std::string(name) + " is " + std::to_string(value) +
                              ", expected " + expected);
}

void check(const TextureOptions& options) {
  const int size = options.size;
  if (size < 8 || size > 4096 || (size & (size - 1)) != 0) refuse("size", size, "a power of two, 8..4096");
  if (!(options.grain >= 1 && options.grain <= size)) refuse("grain", options.grain, "1..size texels");
  if (!(options.density >= 0 && options.density <= 10)) refuse("density", options.density, "0..10");
  if (!(options.low > 0 && options.low <= options.high)) refuse("low", options.low, "0 < low <= high");
  if (!(options.high <= 1)) refuse("high", options.high, "at most 1");
}

// Reflectances are rounded to this grid, far coarser than what mathematical libraries differ by.
constexpr double reflectance_grid = 0x1p-16;

// Paints features into a periodic image.
class Painter {
 public:
  explicit Painter(const TextureOptions& options)
      : options_(options),
        random_(options.seed),
        size_(static_cast<std::size_t>(options.size)),
        image_(size_ * size_, reflectance(0.5)) {}

  std::vector<float> paint() && {
    switch (options_.kind) {
      case TextureKind::plain:
        return std::move(image_);
      case TextureKind::leaves:
      case TextureKind::blocks:
        scatter();
        break;
      case TextureKind::checker:
        checker();
        break;
      case TextureKind::stripes:
        stripes();
        break;
      case TextureKind::clouds:
        clouds();
        return std::move(image_);
    }
    soften();
    return std::move(image_);
  }

 private:
  double uniform() { return random_.uniform(0, counter_++); }

  float reflectance(double share) const {
    const double value = options_.low * std::pow(options_.high / options_.low, share);
    return static_cast<float>(std::round(value / reflectance_grid) * reflectance_grid);
  }

  void scatter() {
    // The mean area of a feature is 1.37 grain^2 for discs, 1.23 grain^2 for rectangles.
    const double count = options_.density * std::pow(options_.size / options_.grain, 2) / 1.3;
    for (int k = 0; k < static_cast<int>(std::ceil(count)); ++k) {
      const double x = uniform() * options_.size, y = uniform() * options_.size;
      if (options_.kind == TextureKind::leaves) {
        const double radius = options_.grain * (0.25 + 0.75 * uniform() * uniform() + 0.1);
        disc(x, y, radius, reflectance(uniform()));
      } else {
        const double half_width = options_.grain * (0.15 + 0.8 * uniform());
        const double half_height = options_.grain * (0.15 + 0.8 * uniform());
        rectangle(x, y, half_width, half_height, reflectance(uniform()));
      }
    }
  }

  template <typename Inside>
  void fill(double x, double y, double reach_x, double reach_y, float value, Inside inside) {
    const auto mask = static_cast<std::ptrdiff_t>(size_) - 1;
    for (auto row = static_cast<std::ptrdiff_t>(std::floor(y - reach_y)); row <= std::ceil(y + reach_y);
         ++row) {
      float* line = image_.data() + static_cast<std::size_t>(row & mask) * size_;
      for (auto column = static_cast<std::ptrdiff_t>(std::floor(x - reach_x));
           column <= std::ceil(x + reach_x); ++column) {
        if (inside(static_cast<double>(column) - x, static_cast<double>(row) - y))
          line[column & mask] = value;
      }
    }
  }

  void disc(double x, double y, double radius, float value) {
    fill(x, y, radius, radius, value,
         [&](double dx, double dy) { return dx * dx + dy * dy < radius * radius; });
  }

  void rectangle(double x, double y, double half_width, double half_height, float value) {
    fill(x, y, half_width, half_height, value,
         [&](double dx, double dy) { return std::abs(dx) < half_width && std::abs(dy) < half_height; });
  }

  // Squares as near to the grain as go into the period an even number of times.
  void checker() {
    const auto pairs = std::max(1.0, std::round(options_.size / (2 * options_.grain)));
    const double square = options_.size / (2 * pairs);
    for (std::size_t row = 0; row < size_; ++row) {
      for (std::size_t column = 0; column < size_; ++column) {
        const auto parity = static_cast<int>((static_cast<double>(row) + 0.5) / square) +
                            static_cast<int>((static_cast<double>(column) + 0.5) / square);
        image_[row * size_ + column] = reflectance(parity % 2);
      }
    }
  }

  void stripes() {
    double end = 0;
    float value = 0;
    for (std::size_t column = 0; column < size_; ++column) {
      if (static_cast<double>(column) >= end) {
        end += options_.grain * (0.4 + 1.2 * uniform());
        value = reflectance(uniform());
      }
      for (std::size_t row = 0; row < size_; ++row) image_[row * size_ + column] = value;
    }
  }

  // Values at the nodes of a lattice, blended by a smooth step; octaves of half the size and weight.
  void clouds() {
    std::vector<double> sum(image_.size(), 0.0);
    double weight = 0.5;
    auto cells = std::max<std::size_t>(1, static_cast<std::size_t>(options_.size / (2 * options_.grain)));
    for (std::uint64_t octave = 1; octave <= 4 && cells <= size_; ++octave, cells *= 2, weight /= 2) {
      const double scale = static_cast<double>(cells) / options_.size;
      const auto node = [&](std::size_t row, std::size_t column) {
        return random_.uniform(octave, (row % cells) * cells + column % cells);
      };
      for (std::size_t row = 0; row < size_; ++row) {
        const double y = static_cast<double>(row) * scale;
        const auto top = static_cast<std::size_t>(y);
        for (std::size_t column = 0; column < size_; ++column) {
          const double x = static_cast<double>(column) * scale;
          const auto left = static_cast<std::size_t>(x);
          const double a = smooth(x - static_cast<double>(left)), b = smooth(y - static_cast<double>(top));
          const double above = node(top, left) * (1 - a) + node(top, left + 1) * a;
          const double below = node(top + 1, left) * (1 - a) + node(top + 1, left + 1) * a;
          sum[row * size_ + column] += weight * (above * (1 - b) + below * b);
        }
      }
    }
    for (std::size_t k = 0; k < sum.size(); ++k) {
      image_[k] = reflectance(std::clamp(0.5 + 1.6 * (sum[k] - 0.47), 0.0, 1.0));
    }
  }

  static double smooth(double s) { return s * s * (3 - 2 * s); }

  // Edges about two texels wide, so that outlines along the texture's axes are no sharper than others.
  void soften() {
    std::vector<float> line(size_);
    const std::size_t mask = size_ - 1;
    for (const bool along_rows : {true, false}) {
      for (std::size_t k = 0; k < size_; ++k) {
        const auto at = [&](std::size_t i) -> float& {
          return along_rows ? image_[k * size_ + i] : image_[i * size_ + k];
        };
        for (std::size_t i = 0; i < size_; ++i) line[i] = at(i);
        for (std::size_t i = 0; i < size_; ++i) {
          at(i) = 0.125f * line[(i - 1) & mask] + 0.75f * line[i] + 0.125f * line[(i + 1) & mask];
        }
      }
    }
  }

  const TextureOptions& options_;
  CounterRandom random_;
  std::uint64_t counter_ = 0;
  std::size_t size_;
  std::vector<float> image_;
};

}  // namespace

Texture::Texture(const TextureOptions& options) {
  check(options);
  while ((1 << log2_size_) < options.size) ++log2_size_;
  texels_ = Painter(options).paint();
  offsets_.push_back(0);
  for (int level = 1; level <= log2_size_; ++level) {
    const auto size = static_cast<std::size_t>(options.size >> level);
    const std::size_t finer = offsets_.back();
    offsets_.push_back(texels_.size());
    texels_.reserve(texels_.size() + size * size);
    for (std::size_t row = 0; row < size; ++row) {
      for (std::size_t column = 0; column < size; ++column) {
        const float* corner = texels_.data() + finer + 2 * row * (2 * size) + 2 * column;
        texels_.push_back(0.25f * ((corner[0] + corner[1]) + (corner[2 * size] + corner[2 * size + 1])));
      }
    }
  }
}

}  // namespace emseg::simulation
