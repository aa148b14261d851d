#include <doctest/doctest.h>

#include <cmath>

#include "emseg/velocity_sweep.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr Region plane{0, 0, 160, 128};
constexpr Region left{0, 0, 80, 128};
constexpr Region right{80, 0, 80, 128};

Scene two_halves(double duration, Place left_velocity, Place right_velocity, std::uint32_t seed) {
  const WarpFrame frame = make_warp_frame({160, 128});
  return moving_dots({{Translation{{left_velocity.x, left_velocity.y}}, {8, 8, 60, 112}, 150, 12},
                      {Translation{{right_velocity.x, right_velocity.y}}, {92, 8, 60, 112}, 150, 12}},
                     frame, duration, seed);
}

std::vector<std::vector<VelocityScore>> sweep(const Scene& scene, std::vector<Region> regions,
                                              int threads = 2, const SweepOptions& options = {}) {
  ThreadPool pool(threads);
  return sweep_velocities(scene.view(), scene.positive, regions, plane, options, pool);
}

// How far off a velocity is over the window, px.
double error(const VelocityScore& found, Place truth, double duration) {
  return std::hypot(found.vx - truth.x, found.vy - truth.y) * duration;
}

bool same(const std::vector<std::vector<VelocityScore>>& a,
          const std::vector<std::vector<VelocityScore>>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& p, const auto& q) {
    return std::equal(p.begin(), p.end(), q.begin(), q.end(),
                      [](const VelocityScore& v, const VelocityScore& w) {
                        return v.vx == w.vx && v.vy == w.vy && v.score == w.score;
                      });
  });
}

}  // namespace

TEST_CASE("each region gets the velocity of its dots, over windows short and long") {
  struct Case {
    double duration;
    Place left, right;
  };
  const std::vector<Case> cases{{0.004, {3000, -1500}, {-2500, 2000}},
                                {0.03, {300, 100}, {-200, 250}},
                                {0.05, {0, 0}, {400, -100}},
                                {0.2, {-60, 40}, {50, 80}}};
  for (const auto& [duration, left_velocity, right_velocity] : cases) {
    CAPTURE(duration);
    const Scene scene = two_halves(duration, left_velocity, right_velocity, 1);
    const auto best = sweep(scene, {left, right});
    REQUIRE(best.size() == 2);
    REQUIRE(!best[0].empty());
    REQUIRE(!best[1].empty());
    // Velocities lie on a grid of 3.75 px over the window: the nearest is at most half its diagonal away.
    CHECK(error(best[0].front(), left_velocity, duration) < 0.75 * 3.75);
    CHECK(error(best[1].front(), right_velocity, duration) < 0.75 * 3.75);
    CHECK(best[0].front().score > 0);
  }
}

TEST_CASE("the whole plane's best velocities hold both motions, best first") {
  const Scene scene = two_halves(0.03, {300, 100}, {-200, 250}, 2);
  const auto best = sweep(scene, {plane}).front();
  REQUIRE(best.size() == 2);
  CHECK(best[0].score >= best[1].score);
  const auto nearest = [&](Place truth) {
    return std::min(error(best[0], truth, 0.03), error(best[1], truth, 0.03));
  };
  CHECK(nearest({300, 100}) < 0.75 * 3.75);
  CHECK(nearest({-200, 250}) < 0.75 * 3.75);
}

TEST_CASE("the same for any number of workers") {
  const Scene scene = two_halves(0.05, {250, 130}, {-210, 40}, 3);
  const auto alone = sweep(scene, {plane, left, right}, 1);
  CHECK(same(sweep(scene, {plane, left, right}, 2), alone));
  CHECK(same(sweep(scene, {plane, left, right}, 7), alone));
}

TEST_CASE("votes of opposite polarity do not coincide") {
  Scene scene = two_halves(0.03, {300, 100}, {300, 100}, 4);
  const double with_polarity = sweep(scene, {plane}).front().front().score;
  for (std::size_t k = 0; k < scene.size(); ++k) scene.positive[k] = static_cast<std::uint8_t>(k % 2);
  CHECK(sweep(scene, {plane}).front().front().score < 0.7 * with_polarity);
}

TEST_CASE("regions without events have no velocities") {
  const WarpFrame frame = make_warp_frame({160, 128});
  const Scene scene = moving_dots({{Translation{{100, 0}}, {10, 10, 50, 100}, 100, 10}}, frame, 0.03, 5);
  const auto best = sweep(scene, {left, {128, 0, 32, 128}, {400, 400, 10, 10}, {5, 5, 0, 0}});
  REQUIRE(best.size() == 4);
  CHECK(!best[0].empty());
  CHECK(best[1].empty());
}

TEST_CASE("without two times there are no velocities") {
  Scene scene;
  CHECK(sweep(scene, {plane}).front().empty());
  for (int k = 0; k < 3; ++k) {
    scene.points.x.push_back(5);
    scene.points.y.push_back(6);
    scene.points.dt.push_back(0.25f);
    scene.positive.push_back(1);
    CHECK(sweep(scene, {plane}).front().empty());
  }
}

TEST_CASE("a pause in the middle of the window hides no velocity") {
  // The sweep begins with a short slice in the middle; here nothing happens there.
  const Place truth{900, -500};
  Scene all = two_halves(0.03, truth, truth, 6), scene;
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (std::abs(all.points.dt[k]) < 0.008f) continue;
    scene.points.push_back(all.view(), k);
    scene.positive.push_back(all.positive[k]);
  }
  const auto best = sweep(scene, {plane}).front();
  REQUIRE(!best.empty());
  // Events at the ends alone tell velocities apart no better than to a step of the grid.
  CHECK(error(best.front(), truth, 0.03) < 3.75);
}

TEST_CASE("more votes in a cell than 16 bits count") {
  Scene scene;
  constexpr std::size_t count = 2 * 65536;  // nothing at all, modulo 2^16
  for (std::size_t k = 0; k < count; ++k) {
    scene.points.x.push_back(21);
    scene.points.y.push_back(21);
    scene.points.dt.push_back(static_cast<float>(k) * 1e-7f);
    scene.positive.push_back(1);
  }
  SweepOptions options;
  options.max_events = count;
  const auto best = sweep(scene, {plane}, 1, options).front();
  REQUIRE(!best.empty());
  CHECK(best.front().vx == 0);
  CHECK(best.front().vy == 0);
  CHECK(best.front().score > 10000);
}

TEST_CASE("windows of any length are searched in a bounded number of levels") {
  Scene scene;
  for (const float dt : {-9e12f, -1.0f, 0.0f, 1.0f, 9e12f}) {
    scene.points.x.push_back(20);
    scene.points.y.push_back(20);
    scene.points.dt.push_back(dt);
    scene.positive.push_back(1);
  }
  SweepOptions options;
  options.max_speed = 1e7;
  const auto best = sweep(scene, {plane}, 1, options);
  for (const VelocityScore& velocity : best.front()) {
    CHECK(std::isfinite(velocity.vx));
    CHECK(std::hypot(velocity.vx, velocity.vy) <= 2e7);
  }
}
