// Every level of instructions gives the same bits; what the kernels compute is tested where they are used.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "kernels/kernel_table.hpp"
#include "synthetic_events.hpp"
#include "warp_field.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

using Floats = std::vector<float>;

Floats random_floats(std::mt19937& random, std::size_t count, double low, double high) {
  Floats values(count);
  for (float& value : values) value = static_cast<float>(uniform(random, low, high));
  return values;
}

template <typename T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

// run(table) for every level above the baseline gives what it gives for the baseline.
template <typename Run>
void require_same(const Run& run) {
  const auto expected = run(kernels_at(SimdLevel::baseline));
  for (const SimdLevel level : simd_levels()) {
    CAPTURE(name_of(level));
    REQUIRE(same_bits(run(kernels_at(level)), expected));
  }
}

// Around the widths of vectors and blocks, and one that is neither.
const std::vector<std::size_t> sizes{0, 1, 3, 4, 7, 8, 15, 16, 17, 31, 33, 64, 100, 517};

std::vector<MotionModel> motions() {
  return {Translation{{130, -70}},
          Rotation{{0.8, -1.1, 0.5}},
          Rotation{{0, 0, 0}},
          Rotation{{90, 10, -40}},
          Similarity{{60, 90, 0.4, -0.9}},
          Affine{{-50, 80, 0.5, -0.7, 0.3, 0.9}},
          Homography{{40, -90, 0.6, -0.3, 0.8, -0.5, 0.9, -0.7}}};
}

}  // namespace

TEST_CASE("levels have names, and the lowest is everywhere") {
  const auto levels = simd_levels();
  REQUIRE(!levels.empty());
  CHECK(levels.front() == SimdLevel::baseline);
  CHECK(name_of(SimdLevel::baseline) == "baseline");
  CHECK(name_of(SimdLevel::avx2) == "avx2");
  CHECK(name_of(SimdLevel::avx512) == "avx512");
  CHECK(std::find(levels.begin(), levels.end(), simd_level()) != levels.end());
}

TEST_CASE("warps and their gradients have the same bits on every level") {
  std::mt19937 random(1);
  const WarpFrame frame = make_warp_frame({346, 260});
  for (const MotionModel& model : motions()) {
    CAPTURE(name_of(kind_of(model)));
    const WarpField field = warp_field(model, frame);
    for (const std::size_t n : sizes) {
      CAPTURE(n);
      const Floats x = random_floats(random, n, 0, 346), y = random_floats(random, n, 0, 260);
      const Floats dt = random_floats(random, n, -0.1, 0.1);
      const Floats sx = random_floats(random, n, -1, 1), sy = random_floats(random, n, -1, 1);
      require_same([&](const KernelTable& table) {
        Floats warped(2 * n);
        table.warp(field, x.data(), y.data(), dt.data(), n, warped.data(), warped.data() + n);
        return warped;
      });
      require_same([&](const KernelTable& table) {
        std::vector<double> sum(8, 0.25);
        table.add_gradient(field, x.data(), y.data(), dt.data(), sx.data(), sy.data(), n, sum.data());
        return sum;
      });
    }
  }
}

TEST_CASE("votes and samples have the same bits on every level") {
  std::mt19937 random(2);
  constexpr int width = 41, height = 30, stride = 48;
  const CellGrid grid{-3, 5, width, height, stride};
  const Floats image = random_floats(random, stride * (height + 3), -1, 1);
  for (const std::size_t n : sizes) {
    CAPTURE(n);
    Floats x = random_floats(random, n, -6, 40), y = random_floats(random, n, 2, 38);
    for (std::size_t k = 0; k < n; k += 9) x[k] = std::round(x[k]);
    for (std::size_t k = 4; k < n; k += 11) y[k] = std::numeric_limits<float>::quiet_NaN();
    for (std::size_t k = 5; k < n; k += 13) x[k] = -std::numeric_limits<float>::infinity();
    struct Located {
      std::vector<std::int32_t> cell;
      Floats right, low;
      CellBox box;
    };
    const auto located = [&](const KernelTable& table) {
      Located to{std::vector<std::int32_t>(n), Floats(n), Floats(n), {}};
      table.locate(grid, x.data(), y.data(), n, to.cell.data(), to.right.data(), to.low.data(), &to.box);
      return to;
    };
    require_same([&](const KernelTable& table) {
      auto [cell, right, low, box] = located(table);
      cell.insert(cell.end(), {box.min_column, box.max_column, box.min_row, box.max_row});
      return cell;
    });
    require_same([&](const KernelTable& table) {
      auto [cell, right, low, box] = located(table);
      right.insert(right.end(), low.begin(), low.end());
      return right;
    });
    const Located at = located(kernels_at(SimdLevel::baseline));
    const Floats signs = random_signs(random, n);
    for (const float* const sign : {static_cast<const float*>(nullptr), signs.data()}) {
      require_same([&](const KernelTable& table) {
        Floats pairs(2 * stride * (height + 4));
        table.scatter(pairs.data() + 2 * stride, at.cell.data(), at.right.data(), at.low.data(), sign, n);
        Floats rows(static_cast<std::size_t>(width) * height);
        for (std::size_t row = 0; row < height; ++row) {
          float* const above = pairs.data() + 2 * stride * (row + 1);
          table.fold(above + 2 * stride, above, width, rows.data() + row * width);
        }
        pairs.insert(pairs.end(), rows.begin(), rows.end());
        return pairs;
      });
    }
    require_same([&](const KernelTable& table) {
      Floats values(3 * n);
      table.sample_values(image.data(), stride, at.cell.data(), at.right.data(), at.low.data(), n,
                          values.data());
      table.sample_slopes(image.data(), stride, at.cell.data(), at.right.data(), at.low.data(), n,
                          values.data() + n, values.data() + 2 * n);
      return values;
    });
  }
}

TEST_CASE("a signed vote adds its sign's worth of each share, on every level") {
  std::mt19937 random(6);
  constexpr std::size_t stride = 16, cells = 10 * stride;
  for (const SimdLevel level : simd_levels()) {
    CAPTURE(name_of(level));
    for (const std::size_t n : sizes) {
      std::vector<std::int32_t> cell(n);
      for (std::int32_t& at : cell) at = static_cast<std::int32_t>(random() % (cells - 1));
      const Floats right = random_floats(random, n, 0, 1), low = random_floats(random, n, 0, 1);
      const Floats signs = random_signs(random, n);
      for (const float* const sign : {static_cast<const float*>(nullptr), signs.data()}) {
        Floats pairs(2 * cells);
        kernels_at(level).scatter(pairs.data(), cell.data(), right.data(), low.data(), sign, n);
        std::vector<double> expected(2 * cells);
        for (std::size_t k = 0; k < n; ++k) {
          const double vote = sign ? sign[k] : 1, r = right[k], l = low[k];
          double* const at = expected.data() + 2 * cell[k];
          at[0] += vote * (1 - r) * (1 - l);
          at[1] += vote * (1 - r) * l;
          at[2] += vote * r * (1 - l);
          at[3] += vote * r * l;
        }
        for (std::size_t i = 0; i < pairs.size(); ++i) REQUIRE(std::abs(pairs[i] - expected[i]) < 5e-6);
      }
    }
  }
}

TEST_CASE("whole votes have the same bits on every level, and are smoothed alike for either sign") {
  std::mt19937 random(7);
  constexpr std::array weight{1, 4, 6, 4, 1};
  for (const std::size_t n : sizes) {
    CAPTURE(n);
    const std::size_t stride = n + 4;
    std::vector<int> votes(5 * stride);
    for (int& vote : votes) vote = random() % 3 ? static_cast<int>(random() % 255) - 127 : 127;
    const auto smoothed = [&](const KernelTable& table, int sign) {
      std::vector<std::uint16_t> counts, column(stride), smooth(n);
      for (const int vote : votes) counts.push_back(static_cast<std::uint16_t>(sign * vote));
      table.smooth_counts_down(counts.data() + 2 * stride, static_cast<std::ptrdiff_t>(stride), stride,
                               column.data());
      table.smooth_counts_across(column.data() + 2, n, smooth.data());
      return smooth;
    };
    for (const int sign : {1, -1}) {
      require_same([&](const KernelTable& table) { return smoothed(table, sign); });
      const auto found = smoothed(kernels(), sign);
      for (std::size_t x = 0; x < n; ++x) {
        int sum = 0;
        for (std::size_t j = 0; j < 5; ++j) {
          for (std::size_t i = 0; i < 5; ++i) sum += weight[i] * weight[j] * votes[j * stride + x + i];
        }
        REQUIRE(static_cast<std::int16_t>(found[x]) == sign * (sum / 16));
      }
    }
    const auto clamped = [&](const KernelTable& table) {
      std::vector<std::uint16_t> counts;
      for (std::size_t k = 0; k < n; ++k) counts.push_back(static_cast<std::uint16_t>(700 * votes[k]));
      table.clamp_counts(counts.data(), n, 127);
      return counts;
    };
    require_same(clamped);
    const auto counts = clamped(kernels());
    for (std::size_t k = 0; k < n; ++k) {
      const auto wrapped = static_cast<std::int16_t>(static_cast<std::uint16_t>(700 * votes[k]));
      REQUIRE(static_cast<std::int16_t>(counts[k]) == std::clamp<int>(wrapped, -127, 127));
    }
    const Floats x = random_floats(random, n, -6, 40), y = random_floats(random, n, -3, 30);
    require_same([&](const KernelTable& table) {
      std::vector<std::int32_t> cell(n);
      table.nearest_cells({-2, 1, 33, 25, 37}, x.data(), y.data(), n, 2, cell.data());
      return cell;
    });
  }
}

TEST_CASE("the largest magnitude is that of either sign") {
  std::mt19937 random(8);
  for (const SimdLevel level : simd_levels()) {
    CHECK(kernels_at(level).largest_magnitude(nullptr, 0) == 0);
    for (const std::size_t n : sizes) {
      Floats values = random_floats(random, n, -2, 1);
      float largest = 0;
      for (const float value : values) largest = std::max(largest, std::abs(value));
      CHECK(kernels_at(level).largest_magnitude(values.data(), n) == largest);
      for (float& value : values) value = -value;
      CHECK(kernels_at(level).largest_magnitude(values.data(), n) == largest);
    }
  }
}

TEST_CASE("a range is widened to hold all elements but undefined ones") {
  std::mt19937 random(9);
  for (const SimdLevel level : simd_levels()) {
    for (const std::size_t n : sizes) {
      Floats values = random_floats(random, n, -2, 1);
      float low = -0.5f, high = 0.25f;  // what it held before
      for (const float value : values) low = std::min(low, value), high = std::max(high, value);
      values.insert(values.begin() + static_cast<std::ptrdiff_t>(n / 2), std::nanf(""));
      float found_low = -0.5f, found_high = 0.25f;
      kernels_at(level).widen(values.data(), values.size(), &found_low, &found_high);
      CHECK(found_low == low);
      CHECK(found_high == high);
    }
  }
}

TEST_CASE("sums of minima are those of the smaller elements") {
  std::mt19937 random(10);
  for (const SimdLevel level : simd_levels()) {
    for (const std::size_t n : sizes) {
      std::vector<std::int32_t> a(n), b(n);
      std::int32_t sum = 0;
      for (std::size_t k = 0; k < n; ++k) {
        a[k] = static_cast<std::int32_t>(random() % 100'000);
        b[k] = k % 5 == 0 ? INT32_MAX : static_cast<std::int32_t>(random() % 100'000);
        sum += std::min(a[k], b[k]);
      }
      CHECK(kernels_at(level).sum_of_minima(a.data(), b.data(), n) == sum);
    }
  }
}

TEST_CASE("counts are added up in wider numbers") {
  std::mt19937 random(11);
  for (const SimdLevel level : simd_levels()) {
    for (const std::size_t n : sizes) {
      std::vector<std::uint16_t> counts(n);
      std::vector<std::uint32_t> sums(n + 1, 65'535), expected = sums;  // the last is not to be touched
      for (std::size_t i = 0; i < n; ++i) {
        counts[i] = static_cast<std::uint16_t>(random());
        expected[i] += counts[i];
      }
      kernels_at(level).add_counts(counts.data(), n, sums.data());
      CHECK(sums == expected);
    }
  }
}

TEST_CASE("filters and sums have the same bits on every level") {
  std::mt19937 random(3);
  for (const int radius : {0, 1, 2, 4, 7, 8, 9, 20}) {
    CAPTURE(radius);
    const auto reach = static_cast<std::size_t>(radius);
    const Floats taps = random_floats(random, reach + 1, 0, 1);
    for (const std::size_t n : sizes) {
      CAPTURE(n);
      const Floats row = random_floats(random, n + 2 * reach, -1, 2);
      const Floats image = random_floats(random, (2 * reach + 1) * n, -1, 2);
      std::vector<const float*> rows;
      for (std::size_t i = 0; i <= 2 * reach; ++i) rows.push_back(image.data() + i * n);
      require_same([&](const KernelTable& table) {
        Floats filtered(2 * n);
        table.filter_row(row.data() + reach, n, taps.data(), radius, filtered.data());
        table.filter_rows(rows.data(), n, taps.data(), radius, filtered.data() + n);
        return filtered;
      });
      require_same([&](const KernelTable& table) {
        Floats changed(row.begin(), row.begin() + static_cast<std::ptrdiff_t>(n));
        table.subtract_scaled(changed.data(), image.data(), 0.37f, n);
        std::vector<double> sums{1, 2};
        table.add_sums(changed.data(), n, &sums[0], &sums[1]);
        sums.push_back(table.largest_magnitude(changed.data(), n));
        for (const float value : changed) sums.push_back(value);
        return sums;
      });
    }
  }
}

TEST_CASE("logarithms have the same bits on every level") {
  std::mt19937 random(4);
  for (const std::size_t n : sizes) {
    Floats values = random_floats(random, n, -30, 30);
    for (float& value : values) value = std::exp(value);
    require_same([&](const KernelTable& table) {
      Floats logs(n);
      table.natural_log(values.data(), n, logs.data());
      return logs;
    });
  }
}

TEST_CASE("rotations by the kernels are those of the model, however large the angle") {
  std::mt19937 random(5);
  const WarpFrame frame = make_warp_frame({346, 260});
  for (int trial = 0; trial < 200; ++trial) {
    const double speed = std::pow(10, uniform(random, -4, 2.5));
    const Rotation model{{uniform(random, -1, 1) * std::min(speed, 1.0),
                          uniform(random, -1, 1) * std::min(speed, 1.0), uniform(random, -1, 1) * speed}};
    const Rotation::Warp warp(model, frame);
    const Floats x = random_floats(random, 40, 0, 346), y = random_floats(random, 40, 0, 260);
    const Floats dt = random_floats(random, 40, -0.2, 0.2);
    Floats made_x(40), made_y(40);
    kernels().warp(warp_field(model, frame), x.data(), y.data(), dt.data(), 40, made_x.data(), made_y.data());
    for (std::size_t k = 0; k < 40; ++k) {
      const Vec2f expected = warp(x[k], y[k], dt[k]);
      // Where a place runs off to infinity its digits go with it.
      REQUIRE(std::abs(made_x[k] - expected.x) <= 1e-3 * (1 + std::abs(expected.x) / 100));
      REQUIRE(std::abs(made_y[k] - expected.y) <= 1e-3 * (1 + std::abs(expected.y) / 100));
    }
  }
}
