#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "emseg/axis_doubt.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr double window = 0.04;  // s

std::vector<std::int32_t> axis_doubts(const BlockGrid& grid, const MotionModel& model, const WarpFrame& frame,
                                      double seconds, double cost) {
  return AxisDoubts(grid, seconds, cost).of(model, frame);
}

BlockGrid grid_over(Region plane, int block) { return make_block_grid(Points{}.view(), plane, block); }

double share(double value) { return std::min(1.0, std::max(0.0, value)); }

// The definition, in double precision: of a displacement (px).
double defined_doubt(double dx, double dy, double cost) {
  const double along = std::max(std::abs(dx), std::abs(dy)), across = std::min(std::abs(dx), std::abs(dy));
  return cost * share((along - 4) / (8 - 4)) * share(1.5 + along / 20 - across);
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
std::int32_t uniform_doubt(double dx, double dy, double cost) {
  const WarpFrame frame = make_warp_frame({64, 48});
  const auto doubts = axis_doubts(grid_over({0, 0, 64, 48}, 16), Translation{{dx / window, dy / window}},
                                  frame, window, cost);
  REQUIRE(doubts.size() == 12);
  REQUIRE(std::ranges::count(doubts, doubts.front()) == 12);
  return doubts.front();
}

}  // namespace

TEST_CASE("doubts by hand: full from 8 px along and nearly none across, none below 4 px") {
  CHECK(uniform_doubt(8, 0, 40) == 40);
  CHECK(uniform_doubt(0, -20, 40) == 40);
  CHECK(uniform_doubt(6, 0, 40) == 20);
  CHECK(uniform_doubt(-5, 0, 40) == 10);
  CHECK(uniform_doubt(4, 0, 40) == 0);
  CHECK(uniform_doubt(0, 0, 40) == 0);
  // Across: 1.5 px and 8/20 at the most.
  CHECK(uniform_doubt(8, 0.8, 40) == 40);
  CHECK(uniform_doubt(8, -1.4, 40) == 20);
  CHECK(uniform_doubt(1.4, 8, 40) == 20);
  CHECK(uniform_doubt(8, 2, 40) == 0);
  CHECK(uniform_doubt(-100, 5, 40) == 40);  // 1.5 px and 100/20, and one less
  CHECK(uniform_doubt(100, 100, 40) == 0);
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
    const double cost = uniform(random, 1, 255);
    const auto doubts = axis_doubts(grid, model, frame, window, cost);
    REQUIRE(doubts.size() == grid.count());
    for (int b = 0; b < static_cast<int>(grid.count()); ++b) {
      const Place along = displacement(grid, b, model, frame);
      const double expected = defined_doubt(along.x, along.y, cost);
      const std::int32_t doubt = doubts[static_cast<std::size_t>(b)];
      // Half a unit of rounding, and what floats of some hundred pixels say of a tenth of a thousandth.
      REQUIRE(std::abs(doubt - expected) <= 0.5 + 1e-4 * cost);
      REQUIRE(doubt >= 0);
      REQUIRE(doubt <= std::lround(cost));
      between += expected > 1 && expected < cost - 1;
    }
  }
  CHECK(between > 500);
}

TEST_CASE("columns and rows are alike, and so are the two ways along them") {
  std::mt19937 random(7);
  const WarpFrame frame = make_warp_frame({97, 97});  // whose middle is that of the blocks
  const BlockGrid grid = grid_over({0, 0, 96, 96}, 16);
  for (int trial = 0; trial < 50; ++trial) {
    const double vx = uniform(random, -400, 400), vy = uniform(random, -60, 60);
    const double scale = uniform(random, -1, 1), angle = uniform(random, -1, 1);
    const auto doubts = axis_doubts(grid, Similarity{{vx, vy, scale, angle}}, frame, window, 100);
    // Rows for columns: what turned left turns right.
    const auto swapped = axis_doubts(grid, Similarity{{vy, vx, scale, -angle}}, frame, window, 100);
    // Half a turn about the middle.
    const auto back = axis_doubts(grid, Similarity{{-vx, -vy, scale, angle}}, frame, window, 100);
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t column = 0; column < 6; ++column) {
        const std::int32_t doubt = doubts[row * 6 + column];
        REQUIRE(std::abs(swapped[column * 6 + row] - doubt) <= 1);  // roundings of the warps
        REQUIRE(std::abs(back[(5 - row) * 6 + 5 - column] - doubt) <= 1);
      }
    }
  }
}

TEST_CASE("where nothing is to be doubted, nothing is") {
  const WarpFrame frame = make_warp_frame({64, 48});
  const BlockGrid grid = grid_over({0, 0, 64, 48}, 16);
  const std::vector<std::int32_t> none(12, 0);
  CHECK(axis_doubts(grid, Translation{{500, 0}}, frame, window, 0) == none);
  CHECK(axis_doubts(grid, Translation{{500, 0}}, frame, 0, 40) == none);
  CHECK(axis_doubts(grid_over({0, 0, 0, 0}, 16), Translation{{500, 0}}, frame, window, 40).empty());
  // No image holds what flies further than a float counts.
  CHECK(axis_doubts(grid, Translation{{1e300, 0}}, frame, window, 40) == none);
  CHECK(axis_doubts(grid, Similarity{{0, 1e300, 1e300, 2}}, frame, window, 40) == none);
}
