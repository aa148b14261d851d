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
                                    const BlockGrid& grid, const WarpFrame& frame,
                                    const std::vector<EdgeDirection>& edges = {}, double seconds = window) {
  return MotionDoubt(grid, seconds, options, edges).of(model, frame);
}

BlockGrid grid_over(Region plane, int block) { return make_block_grid(Points{}.view(), plane, block); }

// As straight as may be, or less.
std::vector<EdgeDirection> random_edges(std::mt19937& random, std::size_t count) {
  std::vector<EdgeDirection> edges(count);
  for (EdgeDirection& edge : edges) {
    const double angle = uniform(random, 0, 6.3), straight = uniform(random, 0, 1);
    edge = {static_cast<float>(straight * std::cos(angle)), static_cast<float>(straight * std::sin(angle))};
  }
  return edges;
}

// The definition, in double precision: of a displacement (px).
double defined_doubt(double dx, double dy, const DoubtOptions& options, EdgeDirection edge) {
  const double along = std::abs(dx * double{edge.x} + dy * double{edge.y});
  return options.speed * std::log(1 + std::sqrt(dx * dx + dy * dy) / 10) +
         options.edge * std::log(1 + along / 10);
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

// Of all blocks, which agree where motion and edges are uniform.
std::int32_t uniform_doubt(double dx, double dy, const DoubtOptions& options,
                           const std::vector<EdgeDirection>& edges = {}) {
  const WarpFrame frame = make_warp_frame({64, 48});
  const auto doubts = doubts_of(Translation{{dx / window, dy / window}}, options,
                                grid_over({0, 0, 64, 48}, 16), frame, edges);
  REQUIRE(doubts.size() == 12);
  REQUIRE(std::ranges::count(doubts, doubts.front()) == 12);
  return doubts.front();
}

}  // namespace

TEST_CASE("doubts by hand along edges: by the logarithm of the way along them, straight as they are") {
  const auto edge_doubt = [](double dx, double dy, EdgeDirection edge) {
    return uniform_doubt(dx, dy, {.edge = 100}, std::vector(12, edge));
  };
  for (const EdgeDirection down : {EdgeDirection{0, 1}, EdgeDirection{0, -1}}) {
    CHECK(edge_doubt(0, 10, down) == 69);  // log 2
    CHECK(edge_doubt(0, -10, down) == 69);
    CHECK(edge_doubt(10, 0, down) == 0);
    CHECK(edge_doubt(-500, 10, down) == 69);
    CHECK(edge_doubt(0, -90, down) == 230);  // log 10
    CHECK(edge_doubt(0, 0, down) == 0);
  }
  CHECK(edge_doubt(10, 0, {1, 0}) == 69);
  CHECK(edge_doubt(0, 10, {1, 0}) == 0);
  CHECK(edge_doubt(6, 8, {0.6f, 0.8f}) == 69);
  CHECK(edge_doubt(-8, 6, {0.6f, 0.8f}) == 0);
  CHECK(edge_doubt(10, 0, {0.6f, 0.8f}) == 47);  // log 1.6
  // Half as straight is half the way; where edges run all ways there is none.
  CHECK(edge_doubt(0, 10, {0, 0.5f}) == 41);  // log 1.5
  CHECK(edge_doubt(0, 20, {0, 0.5f}) == 69);
  CHECK(edge_doubt(30, 40, {0, 0}) == 0);
  // Without edges there is nothing to go along.
  CHECK(uniform_doubt(0, 10, {.edge = 100}) == 0);
  CHECK(uniform_doubt(0, 10, {.speed = 100, .edge = 100}) == 69);
}

TEST_CASE("every block has its own edges") {
  const WarpFrame frame = make_warp_frame({48, 32});
  const std::vector<EdgeDirection> edges{{1, 0}, {0, 1}, {0, 0}, {0.5f, 0}, {0, -1}, {-1, 0}};
  const auto doubts =
      doubts_of(Translation{{10 / window, 0}}, {.edge = 100}, grid_over({0, 0, 48, 32}, 16), frame, edges);
  CHECK(doubts == std::vector<std::int32_t>{69, 0, 0, 41, 0, 69});
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
  // Both together, and rounded together: 58.78 and 23.69, each of log 1.8.
  CHECK(uniform_doubt(8, 0, {.speed = 100, .edge = 40.3}, std::vector(12, EdgeDirection{1, 0})) == 82);
}

TEST_CASE("the doubt of every block is that of its definition") {
  std::mt19937 random(6);
  const WarpFrame frame = make_warp_frame({160, 120});
  int by_edges = 0;
  for (int trial = 0; trial < 200; ++trial) {
    CAPTURE(trial);
    const auto velocity = [&] { return uniform(random, -1, 1) * (random() % 2 ? 60 : 500); };
    const auto rate = [&] { return uniform(random, -1.5, 1.5); };
    MotionModel model = Translation{{velocity(), velocity()}};
    if (trial % 3 == 1) model = Similarity{{velocity(), velocity(), rate(), rate()}};
    if (trial % 3 == 2) model = Affine{{velocity(), velocity(), rate(), rate(), rate(), rate()}};
    const BlockGrid grid = grid_over({-7, -3, 171, 130}, trial % 2 ? 16 : 8);
    DoubtOptions options{uniform(random, 1, 255), uniform(random, 1, 255)};
    if (trial / 6 % 3 == 1) options.speed = 0;
    if (trial / 6 % 3 == 2) options.edge = 0;
    const auto edges = random_edges(random, grid.count());
    const auto doubts = doubts_of(model, options, grid, frame, edges);
    REQUIRE(doubts.size() == grid.count());
    for (int b = 0; b < static_cast<int>(grid.count()); ++b) {
      const Place along = displacement(grid, b, model, frame);
      const double expected = defined_doubt(along.x, along.y, options, edges[static_cast<std::size_t>(b)]);
      const std::int32_t doubt = doubts[static_cast<std::size_t>(b)];
      // Half a unit of rounding, and what floats of some hundred pixels say of a tenth of a thousandth.
      REQUIRE(std::abs(doubt - expected) <= 0.5 + 1e-4 * (options.speed + options.edge));
      REQUIRE(doubt >= 0);
      by_edges += options.speed == 0 && doubt > 0;
    }
    // Without edges there is the doubt of speed.
    REQUIRE(doubts_of(model, options, grid, frame) ==
            doubts_of(model, {.speed = options.speed}, grid, frame));
  }
  CHECK(by_edges > 200);
}

TEST_CASE("columns and rows are alike, and so are the two ways along them") {
  std::mt19937 random(7);
  const WarpFrame frame = make_warp_frame({97, 97});  // whose middle is that of the blocks
  const BlockGrid grid = grid_over({0, 0, 96, 96}, 16);
  for (int trial = 0; trial < 50; ++trial) {
    const double vx = uniform(random, -400, 400), vy = uniform(random, -60, 60);
    const double scale = uniform(random, -1, 1), angle = uniform(random, -1, 1);
    const DoubtOptions options{.speed = 50, .edge = 100};
    const auto edges = random_edges(random, grid.count());
    std::vector<EdgeDirection> swapped_edges(grid.count());
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t column = 0; column < 6; ++column) {
        const EdgeDirection edge = edges[row * 6 + column];
        swapped_edges[column * 6 + row] = {edge.y, edge.x};
      }
    }
    const auto doubts = doubts_of(Similarity{{vx, vy, scale, angle}}, options, grid, frame, edges);
    // Rows for columns: what turned left turns right.
    const auto swapped = doubts_of(Similarity{{vy, vx, scale, -angle}}, options, grid, frame, swapped_edges);
    // Half a turn about the middle.
    const std::vector<EdgeDirection> back_edges(edges.rbegin(), edges.rend());
    const auto back = doubts_of(Similarity{{-vx, -vy, scale, angle}}, options, grid, frame, back_edges);
    for (std::size_t row = 0; row < 6; ++row) {
      for (std::size_t column = 0; column < 6; ++column) {
        const std::int32_t doubt = doubts[row * 6 + column];
        REQUIRE(std::abs(swapped[column * 6 + row] - doubt) <= 1);  // roundings of the warps
        REQUIRE(std::abs(back[(5 - row) * 6 + 5 - column] - doubt) <= 1);
      }
    }
  }
}

TEST_CASE("what goes further is doubted no less, and half as much for half the weight") {
  std::mt19937 random(8);
  for (int trial = 0; trial < 100; ++trial) {
    const double angle = uniform(random, 0, 6.3), heavy = uniform(random, 20, 255);
    // By its speed, or by as much along an edge that runs its way.
    const bool along = trial % 2;
    const EdgeDirection edge{static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))};
    std::int32_t last = 0;
    for (double way = 0; way < 60; way += uniform(random, 0.1, 8)) {
      const auto of_weight = [&](double weight) {
        const DoubtOptions options = along ? DoubtOptions{.edge = weight} : DoubtOptions{.speed = weight};
        return uniform_doubt(way * std::cos(angle), way * std::sin(angle), options, std::vector(12, edge));
      };
      const std::int32_t doubt = of_weight(heavy);
      REQUIRE(doubt >= last);
      REQUIRE(std::abs(2 * of_weight(heavy / 2) - doubt) <= 1);  // roundings: a half twice, and a half
      last = doubt;
    }
    REQUIRE(last > heavy);  // 50 px and more: an e-fold and most of another
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
    const auto edges = random_edges(random, grid.count());
    const auto speed = doubts_of(model, {.speed = both.speed}, grid, frame, edges);
    const auto edge = doubts_of(model, {.edge = both.edge}, grid, frame, edges);
    const auto sum = doubts_of(model, both, grid, frame, edges);
    for (std::size_t b = 0; b < grid.count(); ++b)
      REQUIRE(std::abs(sum[b] - speed[b] - edge[b]) <= 1);  // each is rounded
  }
}

TEST_CASE("where nothing is to be doubted, nothing is") {
  const WarpFrame frame = make_warp_frame({64, 48});
  const BlockGrid grid = grid_over({0, 0, 64, 48}, 16);
  const std::vector<std::int32_t> none(12, 0);
  const MotionModel fast = Translation{{500, 0}};
  const std::vector<EdgeDirection> edges(12, {0.8f, 0.6f}), unclear(12);
  CHECK(doubts_of(fast, {}, grid, frame) == none);
  CHECK(doubts_of(fast, {}, grid, frame, edges) == none);
  CHECK(doubts_of(fast, {.edge = 40}, grid, frame) == none);
  CHECK(doubts_of(fast, {.edge = 40}, grid, frame, unclear) == none);
  for (const DoubtOptions& options :
       {DoubtOptions{.speed = 40}, DoubtOptions{.edge = 40}, DoubtOptions{.speed = 40, .edge = 40}}) {
    CHECK(doubts_of(fast, options, grid, frame, edges) != none);
    CHECK(doubts_of(fast, options, grid, frame, edges, 0) == none);
    CHECK(doubts_of(Translation{}, options, grid, frame, edges) == none);
    CHECK(doubts_of(fast, options, grid_over({0, 0, 0, 0}, 16), frame).empty());
    // No image holds what flies further than a float counts.
    CHECK(doubts_of(Translation{{1e300, 0}}, options, grid, frame, edges) == none);
    CHECK(doubts_of(Similarity{{0, 1e300, 1e300, 2}}, options, grid, frame, edges) == none);
  }
}
