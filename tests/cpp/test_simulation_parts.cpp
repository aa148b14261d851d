#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>

#include "emseg/simulation/numeric.hpp"
#include "emseg/simulation/random.hpp"
#include "emseg/simulation/rigid.hpp"
#include "emseg/simulation/texture.hpp"

using namespace emseg::simulation;

TEST_CASE("the fast logarithm is the logarithm") {
  float worst = 0;
  for (float x = 1e-6f; x < 1e6f; x *= 1.0007f) {
    const float expected = std::log(x);
    worst = std::max(worst, std::abs(fast_log(x) - expected) / std::max(1.0f, std::abs(expected)));
  }
  CHECK(worst < 3e-7f);
  CHECK(fast_log(1) == 0);
}

TEST_CASE("the fast saturation is 1 - exp(-x)") {
  float worst = 0;
  for (float x = 0; x < 30; x += 0.01f)
    worst = std::max(worst, std::abs(fast_saturation(x) + std::expm1(-x)));
  CHECK(worst < 2e-3f);
  CHECK(fast_saturation(0) == 0);
}

TEST_CASE("counter-based draws depend on key, stream and counter, and are uniform") {
  const CounterRandom random(1), other(2);
  CHECK(random.bits(3, 4) == CounterRandom(1).bits(3, 4));
  std::set<std::uint64_t> words;
  for (std::uint64_t stream = 0; stream < 40; ++stream) {
    for (std::uint64_t counter = 0; counter < 40; ++counter) {
      words.insert(random.bits(stream, counter));
      words.insert(other.bits(stream, counter));
    }
  }
  CHECK(words.size() == 3200);
  double sum = 0, squares = 0, normal = 0, normal_squares = 0, exponential = 0, neighbours = 0, before = 0.5;
  const int n = 20000;
  for (int k = 0; k < n; ++k) {
    const auto counter = static_cast<std::uint64_t>(k);
    const double u = random.uniform(7, counter), z = random.normal(counter, 0);
    sum += u, squares += u * u, normal += z, normal_squares += z * z;
    exponential += random.exponential(counter, 1);
    neighbours += (u - 0.5) * (before - 0.5);
    before = u;
    REQUIRE((u > 0 && u <= 1));
  }
  // Four standard errors each.
  CHECK(sum / n == doctest::Approx(0.5).epsilon(4 * std::sqrt(1 / 12. / n) / 0.5));
  CHECK(squares / n == doctest::Approx(1 / 3.).epsilon(4 * std::sqrt(4 / 45. / n) * 3));
  CHECK(std::abs(normal / n) < 4 / std::sqrt(n));
  CHECK(normal_squares / n == doctest::Approx(1).epsilon(4 * std::sqrt(2. / n)));
  CHECK(exponential / n == doctest::Approx(1).epsilon(4 / std::sqrt(n)));
  CHECK(std::abs(neighbours / n) < 4 / 12. / std::sqrt(n));
}

TEST_CASE("a path passes its samples and follows a smooth motion between them") {
  std::vector<Path::Sample> samples;
  const auto truth = [](double t) {
    const double angle = 0.8 * std::sin(9 * t);
    return Path::Sample{{std::sin(40 * t), t, std::cos(11 * t)},
                        {std::cos(angle / 2), 0, 0, std::sin(angle / 2)}};
  };
  for (int k = 0; k <= 1000; ++k) {
    samples.push_back(truth(1e-3 * k));
    if (k % 3 == 0) {  // the same rotation by the other quaternion
      for (double& part : samples.back().quaternion) part = -2 * part;
    }
  }
  const Path path(samples, 1e-3);
  for (const double t : {0.0, 0.25, 0.5004, 0.73331, 0.9995}) {
    const Pose pose = path.at(t);
    const auto expected = truth(t);
    const double angle = 2 * std::atan2(expected.quaternion[3], expected.quaternion[0]);
    const double slack = t > 0.999 ? 1e-5 : 1e-6;  // in the last interval the next sample is not known
    CHECK(norm(pose.translation - expected.position) < slack);
    CHECK(norm(pose.rows[0] - Vec3{std::cos(angle), -std::sin(angle), 0}) < slack);
    CHECK(std::abs(dot(pose.rows[0], pose.rows[1])) < 1e-14);
  }
  CHECK(path.at(-1) == path.at(0));
  CHECK(path.at(5) == path.at(1));
  CHECK(Path().is_still());
}

TEST_CASE("poses compose and invert") {
  const Pose T_a_b = Path({{{1, 2, 3}, {0.5, 0.5, -0.5, 0.5}}}, 1).at(0);
  const Pose T_b_c = Path({{{-1, 0, 2}, {0.8, 0, 0.6, 0}}}, 1).at(0);
  const Vec3 p{0.3, -0.7, 1.1};
  CHECK(norm((T_a_b * T_b_c) * p - T_a_b * (T_b_c * p)) < 1e-14);
  CHECK(norm(inverse(T_a_b) * (T_a_b * p) - p) < 1e-14);
}

TEST_CASE("paths that are none are refused") {
  CHECK_THROWS_AS(Path({}, 1), std::invalid_argument);
  CHECK_THROWS_AS(Path({{{0, 0, 0}, {1, 0, 0, 0}}}, 0), std::invalid_argument);
  CHECK_THROWS_AS(Path({{{0, 0, 0}, {0, 0, 0, 0}}}, 1), std::invalid_argument);
  CHECK_THROWS_AS(Path({{{NAN, 0, 0}, {1, 0, 0, 0}}}, 1), std::invalid_argument);
}

TEST_CASE("textures keep their range, their mean over the pyramid, and are periodic") {
  for (const TextureKind kind : {TextureKind::plain, TextureKind::leaves, TextureKind::blocks,
                                 TextureKind::checker, TextureKind::stripes, TextureKind::clouds}) {
    TextureOptions options;
    options.kind = kind;
    options.size = 128;
    options.low = 0.1;
    options.high = 0.8;
    const Texture texture(options);
    REQUIRE(texture.level_count() == 8);
    const auto mean = [&](int level) {
      double sum = 0;
      const int size = texture.size() >> level;
      for (int row = 0; row < size; ++row) {
        for (int column = 0; column < size; ++column) sum += texture.texel(level, column, row);
      }
      return sum / size / size;
    };
    for (int level = 1; level < 8; ++level) CHECK(mean(level) == doctest::Approx(mean(0)).epsilon(1e-5));
    float least = 1, greatest = 0;
    for (int k = 0; k < 128 * 128; ++k) {
      least = std::min(least, texture.texel(0, k % 128, k / 128));
      greatest = std::max(greatest, texture.texel(0, k % 128, k / 128));
    }
    CHECK(least >= 0.0999f);
    CHECK(greatest <= 0.8001f);
    if (kind != TextureKind::plain) CHECK(greatest > 2 * least);
    CHECK(texture.sample(3.25f, 100.5f, 1.3f) == doctest::Approx(texture.sample(3.25f - 256, 228.5f, 1.3f)));
    CHECK(texture.sample(10.5f, 20.5f, 0.0f) == texture.texel(0, 10, 20));
    CHECK(texture.sample(11.0f, 20.5f, 0.0f) ==
          doctest::Approx((texture.texel(0, 10, 20) + texture.texel(0, 11, 20)) / 2));
    CHECK(texture.sample(5.0f, 5.0f, 99.0f) == texture.texel(7, 0, 0));
  }
}

TEST_CASE("a checkered texture seen from afar is grey") {
  TextureOptions options;
  options.kind = TextureKind::checker;
  options.low = 0.2;
  options.high = 0.6;
  const Texture texture(options);
  CHECK(texture.sample(17.0f, 23.0f, 7.0f) == doctest::Approx(0.4).epsilon(0.02));
}

TEST_CASE("options of textures that make none are named") {
  const auto complaint = [](auto change) {
    TextureOptions options;
    change(options);
    try {
      const Texture texture(options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(complaint([](auto&) {}) == "");
  CHECK(complaint([](auto& o) { o.size = 100; }).find("size is 100") != std::string::npos);
  CHECK(complaint([](auto& o) { o.grain = 0; }).find("grain is 0") != std::string::npos);
  CHECK(complaint([](auto& o) { o.low = 0; }).find("low is 0") != std::string::npos);
  CHECK(complaint([](auto& o) { o.high = 2; }).find("high is 2") != std::string::npos);
}
