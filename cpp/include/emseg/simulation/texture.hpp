// Textures: periodic images of reflectance with a pyramid, so that a pixel never sees detail finer than
// itself.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace emseg::simulation {

enum class TextureKind {
  plain,   // one reflectance
  leaves,  // overlapping discs: Lee, Mumford, Huang, "Occlusion models for natural images", IJCV 2001
  blocks,  // overlapping rectangles along the axes: prints, windows, shelves
  checker,
  stripes,  // bars of random widths across u
  clouds,   // smooth noise over four octaves
};

struct TextureOptions {
  TextureKind kind = TextureKind::leaves;
  double grain = 16;  // texels: size of the features
  double density =
      2;  // leaves, blocks: how often the features would cover the texture if they lay side by side
  double low =
      0.15;  // reflectances are spread evenly in logarithm between low and high, 0 < low <= high <= 1
  double high = 0.85;
  int size = 512;  // texels each way, a power of two
  std::uint64_t seed = 0;
};

class Texture {
 public:
  // Throws std::invalid_argument where an option is out of its range.
  explicit Texture(const TextureOptions& options);

  int level_count() const { return static_cast<int>(offsets_.size()); }
  int size() const { return 1 << log2_size_; }
  float texel(int level, int column, int row) const {
    return texels_[offsets_[static_cast<std::size_t>(level)] +
                   static_cast<std::size_t>(row) * static_cast<std::size_t>(size() >> level) +
                   static_cast<std::size_t>(column)];
  }

  // One level, ready to be sampled.
  class Level {
   public:
    Level(const float* texels, int shift, float scale)
        : texels_(texels), shift_(shift), mask_((1 << shift) - 1), scale_(scale) {}

    // Bilinear; u and v in texels of the finest level, whose centres lie at whole numbers plus a half.
    float sample(float u, float v) const {
      const float x = u * scale_ - 0.5f, y = v * scale_ - 0.5f;
      const int column = floor_to_int(x), row = floor_to_int(y);
      const float a = x - static_cast<float>(column), b = y - static_cast<float>(row);
      const float* top = texels_ + (static_cast<std::ptrdiff_t>(row & mask_) << shift_);
      const float* bottom = texels_ + (static_cast<std::ptrdiff_t>((row + 1) & mask_) << shift_);
      const int left = column & mask_, right = (column + 1) & mask_;
      const float above = top[left] + a * (top[right] - top[left]);
      const float below = bottom[left] + a * (bottom[right] - bottom[left]);
      return above + b * (below - above);
    }

   private:
    static int floor_to_int(float x) {
      const int whole = static_cast<int>(x);
      return whole - (x < static_cast<float>(whole) ? 1 : 0);
    }

    const float* texels_;
    int shift_, mask_;
    float scale_;
  };

  Level level(int k) const {
    return {texels_.data() + offsets_[static_cast<std::size_t>(k)], log2_size_ - k,
            1.0f / static_cast<float>(1 << k)};
  }

  // Between two levels; level 0 is the finest, and levels beyond the coarsest are the coarsest.
  float sample(float u, float v, float level_of_detail) const {
    if (level_of_detail <= 0) return level(0).sample(u, v);
    const int fine = static_cast<int>(level_of_detail);
    if (fine + 1 >= level_count()) return level(level_count() - 1).sample(u, v);
    const float here = level(fine).sample(u, v), above = level(fine + 1).sample(u, v);
    return here + (level_of_detail - static_cast<float>(fine)) * (above - here);
  }

 private:
  int log2_size_ = 0;
  std::vector<std::size_t> offsets_;  // of each level in texels_
  std::vector<float> texels_;
};

}  // namespace emseg::simulation
