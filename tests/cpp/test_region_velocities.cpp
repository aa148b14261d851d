#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "emseg/region_velocities.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

using Found = std::vector<std::vector<RegionVelocity>>;

constexpr Region plane{0, 0, 160, 128};
constexpr Region left{0, 0, 80, 128};
constexpr Region right{80, 0, 80, 128};

Scene two_halves(double duration, Place left_velocity, Place right_velocity, std::uint32_t seed) {
  const WarpFrame frame = make_warp_frame({160, 128});
  return moving_dots({{Translation{{left_velocity.x, left_velocity.y}}, {8, 8, 60, 112}, 150, 12},
                      {Translation{{right_velocity.x, right_velocity.y}}, {92, 8, 60, 112}, 150, 12}},
                     frame, duration, seed);
}

Found find(const Scene& scene, std::vector<Region> regions, int threads = 2,
           const RegionVelocityOptions& options = {}) {
  ThreadPool pool(threads);
  return find_region_velocities(scene.view(), scene.positive, regions, plane, options, pool);
}

void add(Scene& scene, double x, double y, double dt, int positive = 1) {
  scene.points.x.push_back(static_cast<float>(x));
  scene.points.y.push_back(static_cast<float>(y));
  scene.points.dt.push_back(static_cast<float>(dt));
  scene.positive.push_back(static_cast<std::uint8_t>(positive));
}

// How far off a velocity is over the window, px.
double error(const RegionVelocity& found, Place truth, double duration) {
  return std::hypot(found.vx - truth.x, found.vy - truth.y) * duration;
}

bool same(const Found& a, const Found& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& p, const auto& q) {
    return std::equal(p.begin(), p.end(), q.begin(), q.end(),
                      [](const RegionVelocity& v, const RegionVelocity& w) {
                        return v.vx == w.vx && v.vy == w.vy && v.significance == w.significance;
                      });
  });
}

// The definition for one lag of half the window, all events voting: displacements of pairs whose slices are
// `lag` apart, counted one by one, and the peak of the excess over their mean.  Places are whole pixels.
RegionVelocity defined_velocity(const Scene& scene, Region region) {
  constexpr int reach = 15, slices = 8;
  const double first = scene.points.dt.front(), window = scene.points.dt.back() - first;
  const double lag = window / 2;
  const auto slice_of = [&](std::size_t k) {
    return static_cast<int>(std::floor((scene.points.dt[k] - first) / (lag / slices)));
  };
  std::map<std::pair<int, int>, double> votes;
  std::map<std::array<int, 4>, int> later;  // events of a slice at a pixel, by polarity
  for (std::size_t k = 0; k < scene.size(); ++k) {
    const int x = static_cast<int>(scene.points.x[k]), y = static_cast<int>(scene.points.y[k]);
    ++later[{slice_of(k), scene.positive[k], x, y}];
  }
  for (std::size_t k = 0; k < scene.size(); ++k) {
    const int x = static_cast<int>(scene.points.x[k]), y = static_cast<int>(scene.points.y[k]);
    if (x < region.x0 || y < region.y0 || x >= region.x0 + region.width || y >= region.y0 + region.height)
      continue;
    if (slice_of(k) >= slices) continue;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        const auto there = later.find({slice_of(k) + slices, scene.positive[k], x + dx, y + dy});
        if (there != later.end()) votes[{dx, dy}] += std::min(there->second, 8);
      }
    }
  }
  double mean = 0;
  for (const auto& [displacement, count] : votes) mean += count;
  mean /= (2 * reach + 1) * (2 * reach + 1);
  RegionVelocity best;
  for (const auto& [displacement, count] : votes) {
    const auto& [x, y] = displacement;
    if (std::max(std::abs(x), std::abs(y)) >= reach) continue;
    double sum = 0, along_x = 0, along_y = 0;
    bool highest = true;
    for (int j = -1; j <= 1; ++j) {
      for (int i = -1; i <= 1; ++i) {
        const auto near = votes.find({x + i, y + j});
        const double of_near = near == votes.end() ? 0 : near->second;
        highest = highest && of_near <= count;
        const double excess = std::max(0.0, of_near - mean);
        sum += excess;
        along_x += i * excess;
        along_y += j * excess;
      }
    }
    const double significance = sum / std::sqrt(9 * mean + 1);
    if (highest && significance > best.significance)
      best = {(x + along_x / sum) / lag, (y + along_y / sum) / lag, significance};
  }
  return best;
}

}  // namespace

TEST_CASE("each region gets the velocity of its dots, over windows short and long") {
  struct Case {
    double duration;
    Place left, right;
  };
  const std::vector<Case> cases{{0.004, {3000, -1500}, {-2500, 2000}},
                                {0.03, {300, 100}, {-200, 250}},
                                {0.03, {1500, 900}, {-1200, 1700}},
                                {0.05, {0, 0}, {400, -100}},
                                {0.2, {-60, 40}, {50, 80}},
                                {3.0, {-5, 3}, {4, 6}}};
  for (const auto& [duration, left_velocity, right_velocity] : cases) {
    CAPTURE(duration);
    const Scene scene = two_halves(duration, left_velocity, right_velocity, 1);
    const auto found = find(scene, {left, right});
    REQUIRE(found.size() == 2);
    REQUIRE(!found[0].empty());
    REQUIRE(!found[1].empty());
    // Displacements over half the window are good to half a pixel.
    CHECK(error(found[0].front(), left_velocity, duration) < 1);
    CHECK(error(found[1].front(), right_velocity, duration) < 1);
    CHECK(found[0].front().significance >= RegionVelocityOptions{}.least_significance);
  }
}

TEST_CASE("the whole plane's velocities hold both motions, the most significant first") {
  const Scene scene = two_halves(0.03, {300, 100}, {-200, 250}, 2);
  const auto found = find(scene, {plane}).front();
  REQUIRE(found.size() == 2);
  CHECK(found[0].significance >= found[1].significance);
  const auto nearest = [&](Place truth) {
    return std::min(error(found[0], truth, 0.03), error(found[1], truth, 0.03));
  };
  CHECK(nearest({300, 100}) < 1);
  CHECK(nearest({-200, 250}) < 1);
  RegionVelocityOptions one;
  one.per_region = 1;
  const auto best = find(scene, {plane}, 2, one).front();
  REQUIRE(best.size() == 1);
  CHECK(best[0].significance == found[0].significance);
}

TEST_CASE("velocities are those of the displacements of all pairs, counted one by one") {
  // Slices begin and end on binary fractions, which floats hold; whole pixels and a few hot ones.
  std::mt19937 random(11);
  RegionVelocityOptions options;
  options.max_speed = 20;  // one lag is enough
  options.per_region = 1;
  options.max_events = options.max_voters = 1'000'000;
  for (int trial = 0; trial < 8; ++trial) {
    CAPTURE(trial);
    const double vx = uniform(random, -18, 18), vy = uniform(random, -18, 18);
    struct Event {
      int time;
      double x, y;
      int positive;
    };
    std::vector<Event> events;
    for (int dot = 0; dot < 60; ++dot) {
      const double x = uniform(random, 0, 140), y = uniform(random, 0, 110);
      const int positive = static_cast<int>(random() % 2);
      for (int flash = 0; flash < 20; ++flash) {
        const int time = static_cast<int>(random() % 1024);
        events.push_back(
            {time, std::round(x + vx * time / 1024), std::round(y + vy * time / 1024), positive});
      }
    }
    for (int k = 0; k < 1500; ++k) {
      events.push_back({static_cast<int>(random() % 1024), double(random() % 160), double(random() % 128),
                        static_cast<int>(random() % 2)});
    }
    for (int k = 0; k < 600; ++k) events.push_back({static_cast<int>(random() % 1024), 70, 60.0 + k % 2, 1});
    events.push_back({0, 5, 5, 1});
    events.push_back({1024, 5, 5, 0});
    std::erase_if(events, [](const Event& e) { return e.x < 0 || e.y < 0 || e.x > 159 || e.y > 127; });
    std::stable_sort(events.begin(), events.end(),
                     [](const Event& a, const Event& b) { return a.time < b.time; });
    Scene scene;
    for (const Event& e : events) add(scene, e.x, e.y, e.time / 1024.0 - 0.5, e.positive);
    const std::vector<Region> regions{plane, {0, 0, 96, 128}, {64, 32, 96, 96}};
    const auto found = find(scene, regions, 2, options);
    for (std::size_t r = 0; r < regions.size(); ++r) {
      CAPTURE(r);
      const RegionVelocity expected = defined_velocity(scene, regions[r]);
      REQUIRE(found[r].size() == (expected.significance >= options.least_significance ? 1 : 0));
      if (found[r].empty()) continue;
      CHECK(found[r][0].significance == doctest::Approx(expected.significance).epsilon(1e-9));
      CHECK(found[r][0].vx == doctest::Approx(expected.vx).epsilon(1e-9));
      CHECK(found[r][0].vy == doctest::Approx(expected.vy).epsilon(1e-9));
    }
    CHECK(!found[0].empty());
  }
}

TEST_CASE("the same for any number of workers") {
  for (const Place fast : {Place{250, 130}, {2500, -900}}) {
    const Scene scene = two_halves(0.05, fast, {-210, 40}, 3);
    const auto alone = find(scene, {plane, left, right}, 1);
    CHECK(!alone[0].empty());
    CHECK(same(find(scene, {plane, left, right}, 2), alone));
    CHECK(same(find(scene, {plane, left, right}, 7), alone));
  }
}

TEST_CASE("events of opposite polarity do not pair") {
  Scene scene = two_halves(0.03, {300, 100}, {300, 100}, 4);
  const double with_polarity = find(scene, {plane}).front().front().significance;
  for (std::size_t k = 0; k < scene.size(); ++k) scene.positive[k] = static_cast<std::uint8_t>(k % 2);
  CHECK(find(scene, {plane}).front().front().significance < 0.7 * with_polarity);
  // What was of one polarity in the first half and of the other in the second makes no pair at all.
  for (std::size_t k = 0; k < scene.size(); ++k) scene.positive[k] = scene.points.dt[k] < 0;
  RegionVelocityOptions slow;
  slow.max_speed = 500;  // lags of half the window alone
  CHECK(find(scene, {plane}, 1, slow).front().empty());
  for (std::uint8_t& positive : scene.positive) positive = 7;  // any number but 0 is a rise
  CHECK(!find(scene, {plane}, 1, slow).front().empty());
}

TEST_CASE("regions without events have no velocities, and none lies outside the plane") {
  const WarpFrame frame = make_warp_frame({160, 128});
  const Scene scene = moving_dots({{Translation{{100, 0}}, {10, 10, 50, 100}, 100, 10}}, frame, 0.03, 5);
  // The last two are rounded to a tile each: the last of the plane and the first.
  const auto found = find(scene, {left, {128, 0, 32, 128}, {400, 400, 10, 10}, {5, 5, 0, 0}});
  REQUIRE(found.size() == 4);
  CHECK(!found[0].empty());
  CHECK(found[1].empty());
  CHECK(found[2].empty());
  CHECK(find(scene, {}).empty());
}

TEST_CASE("a plane that begins anywhere gives the same velocities") {
  const Scene scene = two_halves(0.03, {300, 100}, {-200, 250}, 8);
  Scene moved = scene;
  for (float& x : moved.points.x) x -= 1024;
  for (float& y : moved.points.y) y += 512;
  ThreadPool pool(2);
  const auto there = [](Region r) { return Region{r.x0 - 1024, r.y0 + 512, r.width, r.height}; };
  const std::vector<Region> regions{there(plane), there(left), there(right)};
  const auto found = find_region_velocities(moved.view(), moved.positive, regions, there(plane), {}, pool);
  const auto expected = find(scene, {plane, left, right});
  for (std::size_t r = 0; r < 3; ++r) {
    REQUIRE(found[r].size() == expected[r].size());
    // Floats so far from zero have fewer digits: a few places are rounded to other pixels.
    for (std::size_t i = 0; i < found[r].size(); ++i)
      CHECK(error(found[r][i], {expected[r][i].vx, expected[r][i].vy}, 0.03) < 0.1);
  }
}

TEST_CASE("noise has no velocity") {
  std::mt19937 random(6);
  std::vector<Region> tiles{plane, left, right};
  for (int y = 0; y < 128; y += 32) {
    for (int x = 0; x < 160; x += 32) tiles.push_back({x, y, 32, 32});
  }
  std::size_t accidents = 0, regions = 0;
  for (int trial = 0; trial < 20; ++trial) {
    Scene scene;
    for (int k = 0; k < 6000; ++k) {
      add(scene, static_cast<double>(random() % 160), static_cast<double>(random() % 128), 5e-6 * k,
          static_cast<int>(random() % 2));
    }
    for (const auto& found : find(scene, tiles)) {
      accidents += !found.empty();
      ++regions;
    }
  }
  // The largest of a thousand displacements reaches five deviations by chance now and then.
  CHECK(accidents < regions / 20);
}

TEST_CASE("without two times there are no velocities") {
  Scene scene;
  CHECK(find(scene, {plane}).front().empty());
  for (int k = 0; k < 3; ++k) {
    add(scene, 5, 6, 0.25);
    CHECK(find(scene, {plane}).front().empty());
  }
}

TEST_CASE("a pause in the middle of the window hides no velocity") {
  const Place truth{900, -500};
  const Scene all = two_halves(0.03, truth, truth, 6);
  Scene scene;
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (std::abs(all.points.dt[k]) < 0.003f) continue;
    scene.points.push_back(all.view(), k);
    scene.positive.push_back(all.positive[k]);
  }
  const auto found = find(scene, {plane}).front();
  REQUIRE(!found.empty());
  CHECK(error(found.front(), truth, 0.03) < 1.5);
}

TEST_CASE("no velocity is larger than asked for, and faster motions have none that is") {
  const Scene scene = two_halves(0.03, {1500, 100}, {-200, 250}, 9);
  RegionVelocityOptions options;
  for (const double most : {100.0, 260.0, 800.0, 1600.0}) {
    options.max_speed = most;
    const auto found = find(scene, {left, right, plane}, 2, options);
    for (const auto& region : found) {
      for (const RegionVelocity& velocity : region) {
        CHECK(std::abs(velocity.vx) <= most);
        CHECK(std::abs(velocity.vy) <= most);
      }
    }
    if (most > 250) {
      REQUIRE(!found[1].empty());
      CHECK(error(found[1].front(), {-200, 250}, 0.03) < 1);
    }
    if (most > 1500) {
      REQUIRE(!found[0].empty());
      CHECK(error(found[0].front(), {1500, 100}, 0.03) < 1);
    }
  }
}

TEST_CASE("a pixel with more events than 16 bits count is still, and its tile's others still count") {
  Scene scene;
  constexpr std::size_t count = 2 * 65536;  // nothing at all, modulo 2^16
  for (std::size_t k = 0; k < count; ++k) add(scene, 21, 21, 1e-7 * static_cast<double>(k));
  RegionVelocityOptions options;
  options.max_events = options.max_voters = count;
  const auto found = find(scene, {plane}, 1, options).front();
  REQUIRE(!found.empty());
  CHECK(found.front().vx == 0);
  CHECK(found.front().vy == 0);
  // It counts for no more than 8 at a time: dots that move outweigh it.
  const double duration = 0.03;
  const Scene dots = two_halves(duration, {300, 100}, {300, 100}, 7);
  Scene both;
  std::size_t next = 0;
  for (std::size_t k = 0; k < 20'000; ++k) {
    const double dt = duration * (static_cast<double>(k) / 20'000 - 0.5);
    for (; next < dots.size() && dots.points.dt[next] <= dt; ++next) {
      both.points.push_back(dots.view(), next);
      both.positive.push_back(dots.positive[next]);
    }
    if (k % 20 == 0) add(both, 21, 21, dt);
  }
  const auto with_hot = find(both, {plane}, 1).front();
  CHECK(std::any_of(with_hot.begin(), with_hot.end(), [&](const RegionVelocity& velocity) {
    return error(velocity, {300, 100}, duration) < 1;
  }));
}

TEST_CASE("windows of any length are searched at a bounded number of lags") {
  RegionVelocityOptions options;
  options.max_speed = 1e7;
  for (const float long_time : {1.0f, 9e12f, 1e30f}) {
    Scene scene;
    for (const float dt : {-long_time, -1.0f, 0.0f, 1.0f, long_time}) add(scene, 20, 20, dt);
    const Found found = find(scene, {plane}, 1, options);
    for (const RegionVelocity& velocity : found.front()) {
      CHECK(std::abs(velocity.vx) <= 1e7);
      CHECK(std::abs(velocity.vy) <= 1e7);
    }
  }
  // The shortest that floats tell apart.
  Scene scene;
  for (int k = 0; k < 400; ++k)
    add(scene, k % 40, 20, k < 200 ? 0.0 : double(std::numeric_limits<float>::denorm_min()));
  const Found found = find(scene, {plane}, 1, options);
  for (const RegionVelocity& velocity : found.front()) CHECK(std::abs(velocity.vx) <= 1e7);
  // Lags far below what the motion asks for take nothing from it.
  const Scene moving = two_halves(0.03, {300, 100}, {300, 100}, 10);
  const auto wide = find(moving, {plane}, 1, options).front();
  REQUIRE(!wide.empty());
  CHECK(error(wide.front(), {300, 100}, 0.03) < 1);
}

TEST_CASE("samples of a long window tell what all its events tell") {
  const WarpFrame frame = make_warp_frame({160, 128});
  const Place truth{220, -140};
  const Scene scene =
      moving_dots({{Translation{{truth.x, truth.y}}, {4, 4, 150, 118}, 3000, 30}}, frame, 0.03, 12);
  REQUIRE(scene.size() > 5 * RegionVelocityOptions{}.max_events);
  const auto found = find(scene, {plane, left, right});
  for (const auto& region : found) {
    REQUIRE(!region.empty());
    CHECK(error(region.front(), truth, 0.03) < 1);
  }
}
