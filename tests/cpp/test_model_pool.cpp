#include <doctest/doctest.h>

#include <limits>

#include "emseg/model_pool.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr Region plane{0, 0, 160, 120};
const WarpFrame frame = make_warp_frame({160, 120});

// A scene that moves, and an object of its own motion in its middle.
Scene object_before_scene(const MotionModel& scene, const MotionModel& object) {
  return moving_dots({{scene, {-10, -10, 70, 140}, 150, 12},
                      {scene, {100, -10, 70, 140}, 150, 12},
                      {object, {62, 40, 36, 36}, 80, 12}},
                     frame, 0.05, 1);
}

// Smallest distance between a pool's models and a motion, over the points it made.
double nearest(const std::vector<MotionModel>& pool, const MotionModel& truth, const Scene& scene,
               std::int32_t source) {
  Points own;
  for (std::size_t k = 0; k < scene.size(); ++k) {
    if (scene.source[k] == source) own.push_back(scene.view(), k);
  }
  double least = std::numeric_limits<double>::infinity();
  for (const MotionModel& model : pool)
    least = std::min(least, motion_distance(model, truth, frame, own.view()));
  return least;
}

// Makes a pool from the events that a sensor would have seen.
ModelPool whole_pool_of(const Scene& scene, const PoolOptions& options, int threads = 2) {
  Scene seen;
  for (std::size_t k = 0; k < scene.size(); ++k) {
    const float x = scene.points.x[k], y = scene.points.y[k];
    if (!(x >= 0 && y >= 0 && x <= 159 && y <= 119)) continue;
    seen.points.push_back(scene.view(), k);
    seen.positive.push_back(scene.positive[k]);
  }
  ThreadPool pool(threads);
  ModelPool made = make_model_pool(seen.view(), seen.positive, frame, plane, options, pool);
  REQUIRE(made.object.size() == made.models.size());
  for (const std::int32_t object : made.object) {
    REQUIRE(object >= no_object);
    REQUIRE(object < static_cast<std::int32_t>(options.tracked.size()));
  }
  return made;
}

std::vector<MotionModel> pool_of(const Scene& scene, const PoolOptions& options, int threads = 2) {
  return whole_pool_of(scene, options, threads).models;
}

// The models of a pool that a tracked object moves by, or that none does.
std::vector<MotionModel> models_of(const ModelPool& pool, std::int32_t object) {
  std::vector<MotionModel> models;
  for (std::size_t m = 0; m < pool.models.size(); ++m) {
    if (pool.object[m] == object) models.push_back(pool.models[m]);
  }
  return models;
}

bool same(const MotionModel& a, const MotionModel& b) {
  return kind_of(a) == kind_of(b) && std::ranges::equal(params_of(a), params_of(b));
}

// Some of the places at which a scene's source is `seen` s after t_ref.
std::vector<Vec2f> places_of(const Scene& scene, std::int32_t source, const MotionModel& motion,
                             double seen) {
  std::vector<Vec2f> places;
  for (std::size_t k = 0; k < scene.size(); k += 3) {
    if (scene.source[k] != source) continue;
    const Place home =
        reference_warp(motion, frame, {scene.points.x[k], scene.points.y[k]}, scene.points.dt[k]);
    const Place then = reference_unwarp(motion, frame, home, seen);
    places.push_back({static_cast<float>(then.x), static_cast<float>(then.y)});
  }
  return places;
}

}  // namespace

TEST_CASE("sub-volumes of every division cover the plane once, the remainder in the last row and column") {
  for (const auto& [rows, columns] : {std::pair{1, 1}, {3, 3}, {6, 6}, {2, 5}, {7, 3}}) {
    for (const Region covered : {Region{0, 0, 346, 260}, {-5, -7, 31, 22}, {0, 0, 4, 3}, {2, 2, 1, 1}}) {
      CAPTURE(rows);
      CAPTURE(columns);
      CAPTURE(covered.width);
      const auto regions = sub_volumes(covered, rows, columns);
      std::size_t next = 0;
      for (int h = 1; h <= std::max(rows, columns); ++h) {
        const int down = std::min({h, rows, covered.height}), across = std::min({h, columns, covered.width});
        const int height = covered.height / down, width = covered.width / across;
        for (int j = 0; j < down; ++j) {
          for (int i = 0; i < across; ++i) {
            REQUIRE(next < regions.size());
            const int right = i + 1 == across ? covered.width : (i + 1) * width;
            const int bottom = j + 1 == down ? covered.height : (j + 1) * height;
            REQUIRE(regions[next++] == Region{covered.x0 + i * width, covered.y0 + j * height,
                                              right - i * width, bottom - j * height});
          }
        }
      }
      CHECK(next == regions.size());
    }
  }
  CHECK(sub_volumes({0, 0, 10, 10}, 3, 3).size() == 1 + 4 + 9);
}

TEST_CASE("the pool holds the motions of the scene and of an object before it, and little else") {
  const MotionModel scene_motion = Similarity{{120, 50, 0.3, -0.2}};
  const MotionModel object_motion = Translation{{-200, 90}};
  const Scene scene = object_before_scene(scene_motion, object_motion);
  PoolOptions options;
  options.lambda_label = 0.2 * static_cast<double>(scene.size());
  const auto pool = pool_of(scene, options);
  CHECK(pool.size() <= 4);
  for (const MotionModel& model : pool) CHECK(kind_of(model) == MotionKind::similarity);
  CHECK(nearest(pool, scene_motion, scene, 0) < 0.5);
  CHECK(nearest(pool, object_motion, scene, 2) < 0.5);
  for (const int threads : {1, 7}) {
    const auto again = pool_of(scene, options, threads);
    REQUIRE(again.size() == pool.size());
    for (std::size_t m = 0; m < pool.size(); ++m) {
      CHECK(std::equal(params_of(pool[m]).begin(), params_of(pool[m]).end(), params_of(again[m]).begin()));
    }
  }
}

TEST_CASE("one motion makes a pool of one, of the richest kind on offer") {
  const MotionModel motion = Translation{{150, -80}};
  const Scene scene = object_before_scene(motion, motion);
  for (const MotionKind kind :
       {MotionKind::translation, MotionKind::rotation, MotionKind::affine, MotionKind::homography}) {
    CAPTURE(name_of(kind));
    PoolOptions options;
    options.kinds = {MotionKind::translation, kind};
    options.lambda_label = static_cast<double>(scene.size());
    const auto pool = pool_of(scene, options);
    REQUIRE(pool.size() == 1);
    CHECK(kind_of(pool[0]) == kind);
    CHECK(nearest(pool, motion, scene, 0) < (kind == MotionKind::rotation ? 2.0 : 0.5));
  }
}

TEST_CASE("candidates from elsewhere are considered") {
  // Beyond the bounds of search and refinement.
  const MotionModel fast = Translation{{900, 400}};
  const Scene scene = object_before_scene(Translation{{50, 20}}, fast);
  PoolOptions options;
  options.search.max_speed = 200;
  options.refine.bounds.speed = 200;
  options.lambda_label = 0.2 * static_cast<double>(scene.size());
  const double without = nearest(pool_of(scene, options), fast, scene, 2);
  options.candidates = {Translation{{890, 410}}};
  CHECK(without > 3);
  CHECK(nearest(pool_of(scene, options), fast, scene, 2) < 1);
}

TEST_CASE("a pool is never empty") {
  PoolOptions options;
  Scene scene;
  for (int events = 0; events < 4; ++events) {
    CHECK(pool_of(scene, options).size() == 1);
    scene.points.x.push_back(30);
    scene.points.y.push_back(20 + static_cast<float>(events));
    scene.points.dt.push_back(0);
    scene.positive.push_back(1);
  }
}

TEST_CASE("labels for nothing: the pool holds the motions, whatever else it takes in") {
  const MotionModel scene_motion = Similarity{{120, 50, 0.3, -0.2}};
  const MotionModel object_motion = Translation{{-200, 90}};
  const Scene scene = object_before_scene(scene_motion, object_motion);
  PoolOptions options;
  options.lambda_label = 0;
  const auto pool = pool_of(scene, options);
  CHECK(nearest(pool, scene_motion, scene, 0) < 0.5);
  CHECK(nearest(pool, object_motion, scene, 2) < 0.5);
}

TEST_CASE("what is tracked stays in the pool, whether or not it explains anything") {
  const MotionModel scene_motion = Translation{{50, 20}};
  const Scene scene = object_before_scene(scene_motion, Translation{{-200, 90}});
  PoolOptions options;
  options.lambda_label = 0.2 * static_cast<double>(scene.size());
  options.candidates = {scene_motion};
  for (const MotionModel& model : pool_of(scene, options)) CHECK(!(params_of(model)[0] > 700));
  // Two that nothing moves by; the like among the candidates goes.
  options.candidates.push_back(Translation{{800, 700}});
  options.tracked = {{Translation{{900, -700}}}, {Similarity{{-800, -750, 0.1, 0.2}}}};
  const ModelPool pool = whole_pool_of(scene, options);
  for (std::size_t i = 0; i < 2; ++i) {
    // As it was, and once more: it may be anywhere, so there is nothing to fit it to.
    const auto tracked = models_of(pool, static_cast<std::int32_t>(i));
    REQUIRE(tracked.size() == 2);
    for (const MotionModel& model : tracked) {
      CHECK(kind_of(model) == MotionKind::similarity);
      CHECK(motion_distance(model, options.tracked[i].model, frame, scene.view()) < 1e-4);
    }
  }
  CHECK(nearest(models_of(pool, no_object), options.candidates[1], scene, 0) > 3);
  CHECK(nearest(models_of(pool, no_object), scene_motion, scene, 0) < 0.5);
}

TEST_CASE("refits of what is tracked are its object's too") {
  const MotionModel scene_motion = Translation{{50, 20}}, object_motion = Translation{{-200, 90}};
  const Scene scene = object_before_scene(scene_motion, object_motion);
  PoolOptions options;
  options.lambda_label = 0.2 * static_cast<double>(scene.size());
  options.candidates = {scene_motion};
  const MotionModel known = Translation{{-170, 120}};  // two pixels off over the window
  options.tracked = {{Translation{{900, -700}}}, {known}};
  const double off = nearest({known}, object_motion, scene, 2);
  REQUIRE(off > 0.4);
  const ModelPool pool = whole_pool_of(scene, options);
  const auto tracked = models_of(pool, 1);
  CHECK(nearest(tracked, known, scene, 2) < 1e-4);
  CHECK(nearest(tracked, object_motion, scene, 2) < 0.5 * off);
  CHECK(nearest(models_of(pool, 0), object_motion, scene, 2) > 3);
  CHECK(nearest(models_of(pool, no_object), object_motion, scene, 2) > 3);
  for (const int threads : {1, 7}) {
    const ModelPool again = whole_pool_of(scene, options, threads);
    CHECK(again.object == pool.object);
    CHECK(std::ranges::equal(again.models, pool.models, same));
  }
}

TEST_CASE("what is tracked is fitted to the events where it is expected, whatever else pays") {
  const MotionModel scene_motion = Translation{{50, 20}}, object_motion = Translation{{-200, 90}};
  const Scene scene = object_before_scene(scene_motion, object_motion);
  PoolOptions options;
  options.candidates = {scene_motion};
  options.lambda_label = 255 * static_cast<double>(scene.size());  // more than all data: one is chosen
  options.tracked_share = 1;
  const MotionModel known = Translation{{-150, 130}};
  const double off = nearest({known}, object_motion, scene, 2);
  REQUIRE(off > 0.8);
  // It has turned since it was seen, by what is known of it, where that brings it to where it is.
  for (const double seen : {0.0, -0.04}) {
    CAPTURE(seen);
    TrackedObject object{known, places_of(scene, 2, object_motion, 0), seen};
    for (Vec2f& place : object.places) {
      const Place then = reference_unwarp(known, frame, {place.x, place.y}, seen);
      place = {static_cast<float>(then.x), static_cast<float>(then.y)};
    }
    options.tracked = {object};
    const ModelPool pool = whole_pool_of(scene, options);
    const auto tracked = models_of(pool, 0);
    REQUIRE(tracked.size() == 2);
    CHECK(nearest({tracked[0]}, known, scene, 2) < 1e-4);
    CHECK(nearest({tracked[1]}, object_motion, scene, 2) < 0.3 * off);
    for (const int threads : {1, 7})
      CHECK(std::ranges::equal(whole_pool_of(scene, options, threads).models, pool.models, same));
  }
  // Where nothing, or next to nothing is, there is nothing to fit it to: it stays as it was.
  for (const std::vector<Vec2f>& places : {std::vector<Vec2f>{{-60, -40}}, {{1e9f, 0}}, {}}) {
    options.tracked = {{known, places, 0}};
    const auto tracked = models_of(whole_pool_of(scene, options), 0);
    REQUIRE(tracked.size() == 2);
    CHECK(same(tracked[0], tracked[1]));
  }
}

TEST_CASE("what is tracked is chosen, and so refitted, where its share of a label's cost pays") {
  const MotionModel scene_motion = Translation{{50, 20}}, object_motion = Translation{{-200, 90}};
  const Scene scene = object_before_scene(scene_motion, object_motion);
  PoolOptions options;
  options.candidates = {scene_motion};
  options.tracked = {{Translation{{-170, 120}}}};
  options.lambda_label = 255 * static_cast<double>(scene.size());  // more than all data
  options.tracked_share = 1;
  CHECK(models_of(whole_pool_of(scene, options), 0).size() == 2);
  options.tracked_share = 0;
  CHECK(models_of(whole_pool_of(scene, options), 0).size() > 2);
}

// Half of the view, going slowly, above two smaller parts with motions of their own.
Scene scene_above(const MotionModel& left, const MotionModel& right) {
  return moving_dots({{Translation{{20, 30}}, {0, 0, 160, 70}, 150, 12},
                      {left, {30, 75, 50, 40}, 60, 12},
                      {right, {100, 75, 40, 40}, 60, 12}},
                     frame, 0.05, 2);
}

// That the pool finds both motions, and with doubts the one still, the other no nearer than `gone` px.
void check_doubt(const MotionModel& left, const MotionModel& right, double label_share,
                 const DoubtOptions& doubt, const std::vector<EdgeDirection>& edges, std::size_t doubted,
                 double gone) {
  const Scene scene = scene_above(left, right);
  PoolOptions options;
  options.lambda_label = label_share * static_cast<double>(scene.size());
  const auto trusting = pool_of(scene, options);
  CHECK(nearest(trusting, left, scene, 1) < 1);
  CHECK(nearest(trusting, right, scene, 2) < 1);
  options.doubt = doubt;
  options.edges = edges;
  const auto doubting = pool_of(scene, options);
  CHECK(nearest(doubting, doubted == 1 ? right : left, scene, doubted == 1 ? 2 : 1) < 1);
  CHECK(nearest(doubting, doubted == 1 ? left : right, scene, doubted) > gone);
}

TEST_CASE("a motion along the edges of its blocks explains less") {
  const MotionModel along_rows = Translation{{300, 0}}, along_columns = Translation{{0, 300}};
  const std::size_t blocks = (160 / 8) * (120 / 8);
  const std::vector<EdgeDirection> rows(blocks, {1, 0}), columns(blocks, {0, 1});
  check_doubt(along_rows, along_columns, 0.2, {.edge = 255}, rows, 1, 1);
  check_doubt(along_rows, along_columns, 0.2, {.edge = 255}, columns, 2, 1);
}

TEST_CASE("a fast motion explains less") {
  check_doubt(Translation{{60, 40}}, Translation{{-420, 380}}, 0.1, {.speed = 100}, {}, 2, 3);
}
