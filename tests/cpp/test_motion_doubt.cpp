#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "emseg/motion_doubt.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr double window = 0.04;  // s

std::vector<std::int32_t> doubts_of(const MotionModel& model, const DoubtOptions& options,
                                    const BlockGrid& grid, const WarpFrame& frame, double seconds = window) {
  return MotionDoubt(grid, seconds, options).of(model, frame);
}

BlockGrid grid_over(Region plane, int block) { return make_block_grid(Points{}.view(), plane, block); }

double share(double value) { return std::min(1.0, std::max(0.0, value)); }

// The definition, in double precision: of a displacement (px).
double defined_doubt(double dx, double dy, const DoubtOptions& options) {
  const double along = std::max(std::abs(dx), std::abs(dy)), across = std::min(std::abs(dx), std::abs(dy));
  return options.axis * share((along - 4) / (8 - 4)) * share(1.5 + along / 20 - across) +
         options.speed * std::log(1 + std::sqrt(dx * dx + dy * dy) / 10);
}

// How far the middle of a block goes within the window.
Place displacement(const BlockGrid& grid, int block, const MotionModel& model, const WarpFrame& frame) {
  const double side = grid.block;
  const Place middle{grid.plane.x0 + side * (block % grid.columns) + side / 2,
                     grid.plane.y0 + side * (block / grid.columns) + side / 2};
  const Place late = reference_warp(model, frame, middle, window / 2);
  const Place early = reference_warp(model, frame, middle, -window / 2);
  return {early.x - late.x, early.y - late.y};
}

// Of all blocks, which agree where the motion is uniform.
std::int32_t uniform_doubt(double dx, double dy, const DoubtOptions& options) {
  const WarpFrame frame = make_warp_frame({64, 48});
  const auto doubts =
      doubts_of(Translation{{dx / window, dy / window}}, options, grid_over({0, 0, 64, 48}, 16), frame);
  REQUIRE(doubts.size() == 12);
  REQUIRE(std::ranges::count(doubts, doubts.front()) == 12);
  return doubts.front();
}

}  // namespace

TEST_CASE("doubts by hand along an axis: full from 8 px along and nearly none across, none below 4 px") {
  const auto axis_doubt = [](double dx, double dy) { return uniform_doubt(dx, dy, {.axis = 40}); };
  CHECK(axis_doubt(8, 0) == 40);
  CHECK(axis_doubt(0, -20) == 40);
  CHECK(axis_doubt(6, 0) == 20);
  CHECK(axis_doubt(-5, 0) == 10);
  CHECK(axis_doubt(4, 0) == 0);
  CHECK(axis_doubt(0, 0) == 0);
  // Across: 1.5 px and 8/20 at the most.
  CHECK(axis_doubt(8, 0.8) == 40);
  CHECK(axis_doubt(8, -1.4) == 20);
  CHECK(axis_doubt(1.4, 8) == 20);
  CHECK(axis_doubt(8, 2) == 0);
  CHECK(axis_doubt(-100, 5) == 40);  // 1.5 px and 100/20, and one less
  CHECK(axis_doubt(100, 100) == 0);
}

TEST_CASE("doubts by hand of speed: by the logarithm of the way, whichever way") {
  const DoubtOptions options{.speed = 100};
  CHECK(uniform_doubt(0, 0, options) == 0);
  CHECK(uniform_doubt(10, 0, options) == 69);  // log 2
  CHECK(uniform_doubt(-6, 8, options) == 69);
  CHECK(uniform_doubt(0, -90, options) == 230);  // log 10
  CHECK(uniform_doubt(54, 72, options) == 230);
  CHECK(uniform_doubt(1, 0, options) == 10);  // log 1.1, and half a unit of rounding
  CHECK(uniform_doubt(54, 72, {.speed = 21}) == 48);
  // Both together, and rounded together: 100 log 1.8 is 58.78, and 40.3 along the axis.
  CHECK(uniform_doubt(8, 0, {.axis = 40.3, .speed = 100}) == 99);
}

TEST_CASE("the doubt of every block is that of its definition") {
  std::mt19937 random(6);
  const WarpFrame frame = make_warp_frame({160, 120});
  int between = 0;
  for (int trial = 0; trial < 200; ++trial) {
    CAPTURE(trial);
    const auto velocity = [&] { return uniform(random, -1, 1) * (random() % 2 ? 60 : 500); };
    const auto rate = [&] { return uniform(random, -1.5, 1.5); };
    MotionModel model = Translation{{velocity(), velocity()}};
    if (trial % 3 == 1) model = Similarity{{velocity(), velocity(), rate(), rate()}};
    if (trial % 3 == 2) model = Affine{{velocity(), velocity(), rate(), rate(), rate(), rate()}};
    const BlockGrid grid = grid_over({-7, -3, 171, 130}, trial % 2 ? 16 : 8);
    DoubtOptions options{uniform(random, 1, 255), uniform(random, 1, 255)};
    if (trial / 6 % 3 == 1) options.axis = 0;
    if (trial / 6 % 3 == 2) options.speed = 0;
    const auto doubts = doubts_of(model, options, grid, frame);
    REQUIRE(doubts.size() == grid.count());
    for (int b = 0; b < static_cast<int>(grid.count()); ++b) {
      const Place along = displacement(grid, b, model, frame);
      const double expected = defined_doubt(along.x, along.y, options);
      const std::int32_t doubt = doubts[static_cast<std::size_t>(b)];
      // Half a unit of rounding, and what floats of some hundred pixels say of a tenth of a thousandth.
      REQUIRE(std::abs(doubt - expected) <= 0.5 + 1e-4 * (options.axis + options.speed));
      REQUIRE(doubt >= 0);
      if (options.speed > 0) continue;
      REQUIRE(doubt <= std::lround(options.axis));
      between += expected > 1 && expected < options.axis - 1;
    }
  }
  CHECK(between > 200);
}

TEST_CASE("columns and rows are alike, and so are the two ways along them") {
  std::mt19937 random(7);
  const WarpFrame frame = make_warp_frame({97, 97});  // whose middle is that of the blocks
  const BlockGrid grid = grid_over({0, 0, 96, 96}, 16);
  for (int trial = 0; trial < 50; ++trial) {
    const double vx = uniform(random, -400, 400), vy = uniform(random, -60, 60);
    const double scale = uniform(random, -1, 1), angle = uniform(random, -1, 1);
    const DoubtOptions options{.axis = 100, .speed = 50};
    const auto doubts = doubts_of(Similarity{{vx, vy, scale, angle}}, options, grid, frame);
    // Rows for columns: what turned left turns right.
    const auto swapped = doubts_of(Similarity{{vy, vx, scale, -angle}}, options, grid, frame);
    // Half a turn about the middle.
    const auto back = doubts_of(Similarity{{-vx, -vy, scale, angle}}, options, grid, frame);
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t column = 0; column < 6; ++column) {
        const std::int32_t doubt = doubts[row * 6 + column];
        REQUIRE(std::abs(swapped[column * 6 + row] - doubt) <= 1);  // roundings of the warps
        REQUIRE(std::abs(back[(5 - row) * 6 + 5 - column] - doubt) <= 1);
      }
    }
  }
}

TEST_CASE("what goes further is doubted no less for its speed, and half as much for half the weight") {
  std::mt19937 random(8);
  for (int trial = 0; trial < 100; ++trial) {
    const double angle = uniform(random, 0, 6.3), speed = uniform(random, 20, 255);
    std::int32_t last = 0;
    for (double way = 0; way < 60; way += uniform(random, 0.1, 8)) {
      const auto of_weight = [&](double weight) {
        return uniform_doubt(way * std::cos(angle), way * std::sin(angle), {.speed = weight});
      };
      const std::int32_t doubt = of_weight(speed);
      REQUIRE(doubt >= last);
      REQUIRE(std::abs(2 * of_weight(speed / 2) - doubt) <= 1);  // roundings: a half twice, and a half
      last = doubt;
    }
    REQUIRE(last > speed);  // 50 px and more: an e-fold and most of another
  }
}

TEST_CASE("the two doubts add up") {
  std::mt19937 random(9);
  const WarpFrame frame = make_warp_frame({160, 120});
  const BlockGrid grid = grid_over({0, 0, 160, 120}, 16);
  for (int trial = 0; trial < 50; ++trial) {
    const MotionModel model = Similarity{{uniform(random, -500, 500), uniform(random, -60, 60),
                                          uniform(random, -1, 1), uniform(random, -1, 1)}};
    const DoubtOptions both{uniform(random, 1, 255), uniform(random, 1, 255)};
    const auto axis = doubts_of(model, {.axis = both.axis}, grid, frame);
    const auto speed = doubts_of(model, {.speed = both.speed}, grid, frame);
    const auto sum = doubts_of(model, both, grid, frame);
    for (std::size_t b = 0; b < grid.count(); ++b)
      REQUIRE(std::abs(sum[b] - axis[b] - speed[b]) <= 1);  // each is rounded
  }
}

TEST_CASE("where nothing is to be doubted, nothing is") {
  const WarpFrame frame = make_warp_frame({64, 48});
  const BlockGrid grid = grid_over({0, 0, 64, 48}, 16);
  const std::vector<std::int32_t> none(12, 0);
  const MotionModel fast = Translation{{500, 0}};
  CHECK(doubts_of(fast, {}, grid, frame) == none);
  for (const DoubtOptions& options :
       {DoubtOptions{.axis = 40}, DoubtOptions{.speed = 40}, DoubtOptions{.axis = 40, .speed = 40}}) {
    CHECK(doubts_of(fast, options, grid, frame) != none);
    CHECK(doubts_of(fast, options, grid, frame, 0) == none);
    CHECK(doubts_of(Translation{}, options, grid, frame) == none);
    CHECK(doubts_of(fast, options, grid_over({0, 0, 0, 0}, 16), frame).empty());
    // No image holds what flies further than a float counts.
    CHECK(doubts_of(Translation{{1e300, 0}}, options, grid, frame) == none);
    CHECK(doubts_of(Similarity{{0, 1e300, 1e300, 2}}, options, grid, frame) == none);
  }
}
