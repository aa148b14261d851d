#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "emseg/alternation.hpp"
#include "emseg/model_selection.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

constexpr ImageSize sensor{160, 120};
constexpr Region plane{0, 0, 160, 120};
const WarpFrame frame = make_warp_frame(sensor);
const MotionModel scene_motion = Similarity{{110, 45, 0.2, -0.1}};
const MotionModel object_motion = Similarity{{-180, 90, 0, 0}};

struct Window {
  RecordedEvents events;
  Points points;
  PixelGraph graph;

  explicit Window(std::uint32_t seed)
      : events(recorded(moving_dots({{scene_motion, {-10, -10, 180, 45}, 150, 12},
                                     {scene_motion, {-10, 85, 180, 45}, 150, 12},
                                     {scene_motion, {-10, 30, 66, 60}, 80, 12},
                                     {scene_motion, {104, 30, 66, 60}, 80, 12},
                                     {object_motion, {60, 40, 40, 40}, 110, 12}},
                                    frame, 0.04, seed),
                        sensor, 7'000'000)),
        points(make_points(events.view(), 7'000'000)),
        graph(build_pixel_graph(events.view(), sensor)) {}

  std::size_t size() const { return events.size(); }
};

const Window& window() {
  static const Window made(1);
  return made;
}

// A pixel or two off over the window, and one model too many.
const std::vector<MotionModel> near_truth{Similarity{{150, 20, 0, 0}}, Similarity{{-150, 120, 0, 0}},
                                          Similarity{{0, 400, 0, 0}}};

// What an alternation of its own ends with.
struct Outcome {
  std::vector<MotionModel> models;
  std::vector<std::int32_t> labels;
  std::vector<std::int64_t> trace;
  double reference = 0;

  std::int64_t energy() const { return trace.back(); }
};

Outcome alternated(const std::vector<MotionModel>& models, const AlternationOptions& options, int threads = 2,
                   const std::vector<MotionModel>& free_models = {}) {
  ThreadPool pool(threads);
  ExpansionWorkspace workspace;
  StageTimes timings;
  StageClock clock(timings);
  Alternation alternation(window().points.view(), window().graph, frame, plane, models, options, pool,
                          workspace, clock);
  alternation.run();
  for (const MotionModel& model : free_models) alternation.add_free_model(model);
  CHECK(alternation.energy() == alternation.trace().back());
  return {alternation.models(), alternation.labels(), alternation.trace(), alternation.reference()};
}

// What doubt and place add to the cost of an event by a model, by the definition; blocks are of 8 px.
std::int64_t prior_cost(std::size_t k, const std::vector<std::int32_t>& doubts, std::int32_t object,
                        const AlternationOptions& options) {
  const int column = std::clamp(static_cast<int>(window().points.x[k]) / 8, 0, 160 / 8 - 1);
  const int row = std::clamp(static_cast<int>(window().points.y[k]) / 8, 0, 120 / 8 - 1);
  bool astray = false;
  if (object == no_object) {
    for (const auto& expected : options.expected) astray = astray || (!expected.empty() && expected[k]);
  } else {
    const auto& expected = options.expected[static_cast<std::size_t>(object)];
    astray = !expected.empty() && !expected[k];
  }
  return doubts[static_cast<std::size_t>(row * (160 / 8) + column)] + (astray ? options.place_cost : 0);
}

// The definition: data, doubt, place, edges of the event graph, used labels; those from `first_free` on are
// free.  `objects` move by the models of the outcome; none where it is short.
std::int64_t defined_energy(const Outcome& outcome, const AlternationOptions& options,
                            std::size_t first_free = 1000, const std::vector<std::int32_t>& objects = {}) {
  IweWorkspace workspace;
  const BlockGrid grid = make_block_grid(Points{}.view(), plane, 8);
  const MotionDoubt doubt(grid, window().points.view().seconds(), options.doubt, options.edges);
  std::int64_t energy = 0;
  for (std::size_t l = 0; l < outcome.models.size(); ++l) {
    ModelSupport support;
    evaluate_support(window().points.view(), outcome.models[l], frame, canvas_of(plane),
                     gaussian_taps(options.sigma), workspace, support);
    std::vector<std::int32_t> costs(window().size());
    integer_costs(options.term, support.sharpness, outcome.reference, options.lambda_data, costs);
    const std::vector<std::int32_t> doubts = doubt.of(outcome.models[l], frame);
    const std::int32_t object = l < objects.size() ? objects[l] : no_object;
    bool used = false;
    for (std::size_t k = 0; k < window().size(); ++k) {
      if (outcome.labels[k] != static_cast<std::int32_t>(l)) continue;
      energy += costs[k] + prior_cost(k, doubts, object, options);
      used = true;
    }
    if (used && l < first_free) energy += options.label_cost;
  }
  const EventGraph graph = join_events(window().graph);
  for (std::size_t i = 0; i < graph.site_count(); ++i) {
    for (std::int64_t e = graph.indptr[i]; e < graph.indptr[i + 1]; ++e) {
      const auto j = static_cast<std::size_t>(graph.indices[static_cast<std::size_t>(e)]);
      if (outcome.labels[i] != outcome.labels[j]) energy += options.smooth_cost;
    }
  }
  return energy;
}

AlternationOptions options_of(DataTerm term, Labelling labelling) {
  AlternationOptions options;
  options.term = term;
  options.labelling = labelling;
  options.label_cost = 1500;
  return options;
}

double accuracy(const Outcome& outcome) {
  double right = 0;
  for (std::size_t k = 0; k < window().size(); ++k)
    right += outcome.labels[k] == (window().events.source[k] == 4 ? 1 : 0);
  return right / static_cast<double>(window().size());
}

constexpr std::array terms{DataTerm::published, DataTerm::logarithmic};
constexpr std::array labellings{Labelling::bands, Labelling::exact};

}  // namespace

TEST_CASE("the energy is that of its definition and never rises, whatever the term and the labelling") {
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      CAPTURE(name_of(term));
      CAPTURE(name_of(labelling));
      const AlternationOptions options = options_of(term, labelling);
      const Outcome outcome = alternated(near_truth, options);
      CHECK(outcome.trace.size() > 2);
      CHECK(std::is_sorted(outcome.trace.rbegin(), outcome.trace.rend()));
      CHECK(outcome.energy() < outcome.trace.front());
      CHECK(outcome.energy() == defined_energy(outcome, options));
      // The motion of nobody is dropped, and those of two are found.
      REQUIRE(outcome.models.size() == 2);
      CHECK(accuracy(outcome) > 0.95);
      CHECK(motion_distance(outcome.models[0], scene_motion, frame, window().points.view()) < 0.5);
      // The published reference is of the models that are left.
      if (term == DataTerm::published) {
        float peak = 0;
        for (const MotionModel& model : outcome.models) {
          IweWorkspace workspace;
          ModelSupport support;
          evaluate_support(window().points.view(), model, frame, canvas_of(plane),
                           gaussian_taps(options.sigma), workspace, support);
          peak = std::max(peak, support.peak);
        }
        CHECK(outcome.reference == peak);
      }
    }
  }
}

TEST_CASE("bands find labels of nearly the energy of exact ones") {
  for (const DataTerm term : terms) {
    CAPTURE(name_of(term));
    AlternationOptions exact_options = options_of(term, Labelling::exact);
    AlternationOptions band_options = options_of(term, Labelling::bands);
    exact_options.iterations = band_options.iterations = 0;  // the labels of the models given
    const Outcome exact = alternated(near_truth, exact_options);
    const Outcome bands = alternated(near_truth, band_options);
    const auto gap =
        static_cast<double>(bands.energy() - exact.energy()) / static_cast<double>(exact.energy());
    CHECK(gap < 2e-4);
    std::size_t different = 0;
    REQUIRE(bands.models.size() == exact.models.size());
    for (std::size_t k = 0; k < window().size(); ++k) different += bands.labels[k] != exact.labels[k];
    CHECK(static_cast<double>(different) < 0.005 * static_cast<double>(window().size()));
  }
}

TEST_CASE("motions fitted to samples of their events are nearly as good as fitted to all") {
  for (const DataTerm term : terms) {
    CAPTURE(name_of(term));
    AlternationOptions options = options_of(term, Labelling::bands);
    options.max_refit_events = window().size();
    const Outcome all = alternated(near_truth, options);
    for (const std::size_t few : {std::size_t{2000}, std::size_t{1500}}) {
      CAPTURE(few);
      options.max_refit_events = few;
      const Outcome outcome = alternated(near_truth, options);
      CHECK(std::is_sorted(outcome.trace.rbegin(), outcome.trace.rend()));
      CHECK(outcome.energy() == defined_energy(outcome, options));  // of all events, though
      REQUIRE(outcome.models.size() == all.models.size());
      for (std::size_t m = 0; m < all.models.size(); ++m)
        CHECK(motion_distance(outcome.models[m], all.models[m], frame, window().points.view()) < 0.5);
      CHECK(static_cast<double>(outcome.energy()) < 1.05 * static_cast<double>(all.energy()));
    }
    // One event fits anything: what does not lower the energy is not taken.
    options.max_refit_events = 1;
    const Outcome one = alternated(near_truth, options);
    CHECK(std::is_sorted(one.trace.rbegin(), one.trace.rend()));
    CHECK(one.energy() == defined_energy(one, options));
  }
}

TEST_CASE("the same for any number of workers") {
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      const AlternationOptions options = options_of(term, labelling);
      const Outcome alone = alternated(near_truth, options, 1);
      for (const int threads : {2, 5}) {
        const Outcome outcome = alternated(near_truth, options, threads);
        CHECK(outcome.labels == alone.labels);
        CHECK(outcome.trace == alone.trace);
        for (std::size_t m = 0; m < alone.models.size(); ++m)
          CHECK(std::ranges::equal(params_of(outcome.models[m]), params_of(alone.models[m])));
      }
    }
  }
}

TEST_CASE("a free model costs nothing, leaves the reference and can only lower the energy") {
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      CAPTURE(name_of(term));
      CAPTURE(name_of(labelling));
      const AlternationOptions options = options_of(term, labelling);
      const std::vector<MotionModel> scene_alone{scene_motion};
      const Outcome without = alternated(scene_alone, options);
      REQUIRE(without.models.size() == 1);
      const Outcome with = alternated(scene_alone, options, 2, {object_motion});
      REQUIRE(with.models.size() == 2);
      CHECK(with.reference == without.reference);
      CHECK(with.energy() < without.energy());
      CHECK(with.energy() == defined_energy(with, options, 1));
      CHECK(accuracy(with) > 0.95);
    }
  }
}

TEST_CASE("every model has a label cost of its own, where they are given, which follows it") {
  const std::vector<MotionModel> models{near_truth[2], near_truth[0], near_truth[1]};
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      CAPTURE(name_of(term));
      CAPTURE(name_of(labelling));
      AlternationOptions options = options_of(term, labelling);
      options.label_costs = {1500, 2500, 700};
      const Outcome outcome = alternated(models, options);
      CHECK(std::is_sorted(outcome.trace.rbegin(), outcome.trace.rend()));
      // The first goes, and its cost with it.
      REQUIRE(outcome.models.size() == 2);
      CHECK(accuracy(outcome) > 0.95);
      AlternationOptions without = options;
      without.label_cost = 0;
      CHECK(outcome.energy() == defined_energy(outcome, without) + 2500 + 700);
      // All the same is the same as none given.
      options.label_costs.assign(3, options.label_cost);
      const Outcome alike = alternated(models, options);
      options.label_costs.clear();
      CHECK(alike.trace == alternated(models, options).trace);
      // What is cheap is used where it would not pay its way.
      options.label_costs = {10'000'000, 0, 10'000'000};
      CHECK(alternated(models, options).models.size() == 1);
      options.label_costs.back() = 0;
      CHECK(accuracy(alternated(models, options)) > 0.95);
    }
  }
}

namespace {

// Whether each event is a thing's that moves by object_motion.
std::vector<std::uint8_t> of_object() {
  std::vector<std::uint8_t> flags;
  for (const std::int32_t source : window().events.source) flags.push_back(source == 4);
  return flags;
}

std::vector<std::uint8_t> left_half() {
  std::vector<std::uint8_t> flags;
  for (const float x : window().points.x) flags.push_back(x < 80);
  return flags;
}

// One way in the left half; to the right of it there is no telling.
std::vector<EdgeDirection> edges_in_left_half(EdgeDirection direction) {
  std::vector<EdgeDirection> edges;
  for (int row = 0; row < 120 / 8; ++row) {
    for (int column = 0; column < 160 / 8; ++column)
      edges.push_back(column < 10 ? direction : EdgeDirection{});
  }
  return edges;
}

}  // namespace

TEST_CASE("speed, edges and places are part of the energy, of the labels, the refits and what is free") {
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      CAPTURE(name_of(term));
      CAPTURE(name_of(labelling));
      AlternationOptions options = options_of(term, labelling);
      const std::vector<MotionModel> models{near_truth[2], near_truth[0], near_truth[1]};
      options.doubt = {.speed = 21, .edge = 13};
      options.edges = edges_in_left_half({0, 1});
      options.place_cost = 20;
      options.objects = {2, no_object, 1};
      // One that is nowhere, the one that is there, one that may be anywhere.
      options.expected = {std::vector<std::uint8_t>(window().size(), 0), of_object(), {}};
      const Outcome outcome = alternated(models, options);
      CHECK(std::is_sorted(outcome.trace.rbegin(), outcome.trace.rend()));
      CHECK(outcome.trace.size() > 2);
      REQUIRE(outcome.models.size() == 2);  // the first goes, and its object with it
      const std::vector<std::int32_t> left{no_object, 1};
      CHECK(outcome.energy() == defined_energy(outcome, options, 1000, left));
      CHECK(accuracy(outcome) > 0.95);
      // Refits of the object's motion are its own too: dear astray, they would not be taken.
      if (term == DataTerm::logarithmic) {
        const auto off = [](const MotionModel& model) {
          return motion_distance(model, object_motion, frame, window().points.view());
        };
        CHECK(off(outcome.models[1]) < 0.5 * off(near_truth[1]));
      }
      // Each of the three terms says something.
      AlternationOptions without = options;
      without.doubt.speed = 0;
      CHECK(outcome.energy() > defined_energy(outcome, without, 1000, left));
      without = options;
      without.edges.clear();
      CHECK(outcome.energy() > defined_energy(outcome, without, 1000, left));
      without = options;
      without.place_cost = 0;
      CHECK(outcome.energy() > defined_energy(outcome, without, 1000, left));
      // A free model has its doubt, and is no object's.
      options.objects = {no_object};
      const Outcome with = alternated({scene_motion}, options, 2, {object_motion});
      REQUIRE(with.models.size() == 2);
      CHECK(with.energy() == defined_energy(with, options, 1));
      // The same for any number of workers.
      options.objects = {2, no_object, 1};
      for (const int threads : {1, 7}) {
        const Outcome again = alternated(models, options, threads);
        CHECK(again.labels == outcome.labels);
        CHECK(again.trace == outcome.trace);
      }
    }
  }
}

TEST_CASE("what is dear astray is not: an object has its place, and no other") {
  for (const DataTerm term : terms) {
    for (const Labelling labelling : labellings) {
      CAPTURE(name_of(term));
      CAPTURE(name_of(labelling));
      AlternationOptions options = options_of(term, labelling);
      options.smooth_cost = 0;
      options.label_cost = 0;
      options.iterations = 0;
      options.place_cost = 1000;  // more than all data of an event
      const std::vector<MotionModel> models{scene_motion, object_motion};
      options.objects = {no_object, 0};
      options.expected = {left_half()};
      const Outcome outcome = alternated(models, options);
      REQUIRE(outcome.models.size() == 2);
      for (std::size_t k = 0; k < window().size(); ++k) REQUIRE(outcome.labels[k] == options.expected[0][k]);
      // Two that are expected at one place share it.
      options.objects = {0, 1};
      options.expected = {left_half(), left_half()};
      const Outcome shared = alternated(models, options);
      // Nothing is expected: places say nothing.
      options.expected = {{}, {}};
      const Outcome anywhere = alternated(models, options);
      options.place_cost = 0;
      CHECK(anywhere.trace == alternated(models, options).trace);
      std::int64_t elsewhere = 0;
      for (std::size_t k = 0; k < window().size(); ++k) elsewhere += window().points.x[k] >= 80;
      CHECK(shared.energy() == anywhere.energy() + 1000 * elsewhere);
    }
  }
}

TEST_CASE("the faster of two motions that are as good is dearer") {
  AlternationOptions options = options_of(DataTerm::logarithmic, Labelling::bands);
  options.iterations = 0;
  // Each explains its own as well as ever; the object's is the faster.
  const auto events_of_object = [&](double speed) {
    options.doubt.speed = speed;
    const Outcome outcome = alternated({scene_motion, object_motion}, options);
    CHECK(outcome.energy() == defined_energy(outcome, options));
    return std::ranges::count(outcome.labels, 1);
  };
  const auto fair = events_of_object(0);
  const auto doubted = events_of_object(255);
  CHECK(fair > 0);
  CHECK(doubted < fair);
}

TEST_CASE("where edges run its way, a motion is dearer, and there alone") {
  AlternationOptions options = options_of(DataTerm::logarithmic, Labelling::bands);
  options.iterations = 0;
  const auto events_of_object = [&](double edge, const std::vector<EdgeDirection>& edges) {
    options.doubt.edge = edge;
    options.edges = edges;
    const Outcome outcome = alternated({scene_motion, object_motion}, options);
    CHECK(outcome.energy() == defined_energy(outcome, options));
    std::array<std::int64_t, 2> events{};  // in the left half, in the right
    for (std::size_t k = 0; k < window().size(); ++k) {
      if (outcome.labels[k] == 1) ++events[window().points.x[k] >= 80];
    }
    return events;
  };
  // Across the scene's motion, the object's goes 6 px along them.
  const auto edges = edges_in_left_half({-0.38f, 0.925f});
  const auto fair = events_of_object(0, edges);
  const auto unclear = events_of_object(255, {});
  const auto doubted = events_of_object(255, edges);
  CHECK(fair[0] > 100);
  CHECK(unclear == fair);
  CHECK(doubted[0] < fair[0] / 2);
  CHECK(doubted[1] > 0.9 * static_cast<double>(fair[1]));
}

TEST_CASE("labellings have names") {
  for (const Labelling known : labellings) CHECK(labelling(name_of(known)) == known);
  CHECK_THROWS_WITH_AS(labelling("fast"), "unknown labelling 'fast', expected bands or exact",
                       std::invalid_argument);
}
