#include <doctest/doctest.h>

#include <cmath>
#include <functional>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "emseg/model_pool.hpp"
#include "emseg/sampling.hpp"
#include "segmenter_windows.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

// The images of the published method: all events alike, each in the middle of its pixel.
SegmenterOptions published_images(SegmenterOptions options) {
  options.polarity = Polarity::ignored;
  options.footprint = Footprint::point;
  options.flicker = Flicker::kept;
  options.lambda_speed = 0;
  options.lambda_edge = 0;
  options.sigma = 1;
  return options;
}

double accuracy(const Segmentation& result, const RecordedEvents& events) {
  double right = 0;
  for (std::size_t k = 0; k < events.size(); ++k) right += result.labels[k] == events.source[k];
  return right / static_cast<double>(events.size());
}

bool same(const Segmentation& a, const Segmentation& b) {
  if (a.labels != b.labels || a.models.size() != b.models.size() || a.energy_trace != b.energy_trace)
    return false;
  for (std::size_t m = 0; m < a.models.size(); ++m) {
    if (kind_of(a.models[m]) != kind_of(b.models[m])) return false;
    if (!std::equal(params_of(a.models[m]).begin(), params_of(a.models[m]).end(),
                    params_of(b.models[m]).begin()))
      return false;
  }
  return a.t_ref == b.t_ref && a.reference_sharpness == b.reference_sharpness;
}

std::vector<EdgeDirection> edges_of(const Points& points, double plain) {
  const BlockGrid grid = make_block_grid(points.view(), plane, doubt_block);
  return edge_directions(structure_tensors(points.view(), grid, edge_slices), grid, plain);
}

// Edges all down the view that drift with the scene, and an object that goes nearly along them before them.
const RecordedEvents& behind_bars() {
  static const RecordedEvents made = [] {
    std::vector<Dots> dots;
    for (int x = 12; x < 160; x += 24) dots.push_back({scene_motion, {x, -10, 2, 140}, 300, 12});
    dots.push_back({Translation{{-40, 300}}, {60, 40, 40, 40}, 110, 12});
    RecordedEvents events = object_before_scene(dots, 3);
    std::ranges::fill(events.p, std::uint8_t{1});  // brighter all along
    return events;
  }();
  return made;
}

}  // namespace

TEST_CASE("a scene and an object before it are told apart") {
  const RecordedEvents& events = two_motions();
  const WarpFrame frame = make_warp_frame(sensor);
  for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
    SegmenterOptions options = quiet_options();
    options.data_term = term;
    const Segmentation result = segmented(events, options);
    check_sound(result, events.size());
    REQUIRE(result.models.size() == 2);
    CHECK(accuracy(result, events) > 0.95);
    const Points points = make_points(events.view(), result.t_ref);
    CHECK(motion_distance(result.models[0], scene_motion, frame, points.view()) < 0.5);
    CHECK(std::abs(result.t_ref - t_middle) < 200);
  }
}

TEST_CASE("the energy is that of its definition, and never rose") {
  const RecordedEvents& events = two_motions();
  for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
    for (const bool rich : {false, true}) {
      SegmenterOptions options = quiet_options();
      options.data_term = term;
      options.labelling = rich ? Labelling::exact : Labelling::bands;
      options.lambda_smooth = 17.6;
      if (rich) {
        options.lambda_data = 2.5;
        options.lambda_label = 400.4;
        options.kinds = {MotionKind::translation, MotionKind::rotation, MotionKind::similarity,
                         MotionKind::affine, MotionKind::homography};
      }
      const Segmentation result = segmented(events, options);
      check_sound(result, events.size());
      // No free still model was added: the scene spans the view.
      CHECK(result.energy == written_out_energy(result, events, options));
    }
  }
}

TEST_CASE("the energy is that of its definition where edges are plain") {
  const RecordedEvents& events = behind_bars();
  WindowPrior prior;
  prior.pool = {scene_motion, Translation{{-40, 300}}};
  for (const Labelling labelling : {Labelling::bands, Labelling::exact}) {
    for (const Polarity polarity : {Polarity::opposed, Polarity::ignored}) {
      SegmenterOptions options = quiet_options();
      options.labelling = labelling;
      options.polarity = polarity;
      const Segmentation result = segmented(events, options, prior);
      check_sound(result, events.size());
      CHECK(result.energy == written_out_energy(result, events, options));
      SegmenterOptions without = options;
      without.lambda_edge = 0;
      CHECK(result.energy > written_out_energy(result, events, without));
      const Segmentation trusting = segmented(events, without, prior);
      CHECK(trusting.energy == written_out_energy(trusting, events, without));
    }
  }
}

TEST_CASE("large windows are estimated on an even sample and extended to all events") {
  const RecordedEvents& events = two_motions();
  const WarpFrame frame = make_warp_frame(sensor);
  const Points points = make_points(events.view(), t_middle);
  for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
    for (const bool noise : {false, true}) {
      // How many events no other of the sample is near depends on the images.
      SegmenterOptions options = published_images(quiet_options());
      options.data_term = term;
      options.lambda_label = 1500;
      const Segmentation full = segmented(events, options);
      CHECK(full.thinned == 0);
      options.max_events = events.size() / 2;
      // Events that no other of the sample is near are noise in any case.
      options.mark_noise = noise;
      const Segmentation thinned = segmented(events, options);
      check_sound(thinned, events.size());
      CHECK(thinned.thinned == events.size() - events.size() / 2);
      CHECK(thinned.t_ref == full.t_ref);
      REQUIRE(thinned.models.size() == full.models.size());
      for (std::size_t m = 0; m < full.models.size(); ++m)
        CHECK(motion_distance(thinned.models[m], full.models[m], frame, points.view()) < 0.5);
      CHECK(accuracy(thinned, events) > accuracy(full, events) - 0.02);
    }
  }
}

TEST_CASE("a thinned window is its sample's, and the sample keeps its labels") {
  const RecordedEvents& events = two_motions();
  SegmenterOptions options = quiet_options();
  options.max_events = events.size() / 3;
  options.lambda_label = 900;
  WindowPrior prior;
  prior.t_ref = t_middle;
  const Segmentation thinned = segmented(events, options, prior);
  RecordedEvents sample;
  const auto sampled = even_sample(events.size(), options.max_events);
  for (const std::size_t k : sampled)
    sample.add(events.x[k], events.y[k], events.t[k], events.p[k], events.source[k]);
  // A label costs as much, as a share of the data.
  options.lambda_label = 900 * static_cast<double>(sample.size()) / static_cast<double>(events.size());
  const Segmentation own = segmented(sample, options, prior);
  CHECK(own.thinned == 0);
  CHECK(thinned.energy_trace == own.energy_trace);
  CHECK(thinned.reference_sharpness == own.reference_sharpness);
  for (std::size_t i = 0; i < sampled.size(); ++i) REQUIRE(thinned.labels[sampled[i]] == own.labels[i]);
  CHECK(own.energy == written_out_energy(own, sample, options));
}

TEST_CASE("as many events as are allowed are all taken") {
  const RecordedEvents& events = two_motions();
  SegmenterOptions options;
  options.max_events = SegmenterOptions::all_events;
  const Segmentation all = segmented(events, options);
  options.max_events = events.size();
  CHECK(same(segmented(events, options), all));
  CHECK(all.thinned == 0);
  options.max_events = events.size() - 1;
  CHECK(segmented(events, options).thinned == 1);
  for (const std::size_t few : {1u, 2u, 30u}) {
    options.max_events = few;
    const Segmentation result = segmented(events, options);
    check_sound(result, events.size());
    CHECK(result.thinned == events.size() - few);
  }
}

TEST_CASE("labels are ordered: background, then objects by their events; none is without") {
  SegmenterOptions options = quiet_options();
  options.lambda_label = 0;
  const RecordedEvents& events = two_motions();
  const Segmentation result = segmented(events, options);
  check_sound(result, events.size());
  std::vector<int> counts(result.models.size(), 0);
  for (const std::int32_t label : result.labels) ++counts[static_cast<std::size_t>(label)];
  for (std::size_t l = 1; l < counts.size(); ++l) {
    CHECK(counts[l] > 0);
    if (l > 1) CHECK(counts[l] <= counts[l - 1]);
  }
}

TEST_CASE("the same for 1, 2 and 7 threads, and for a segmenter used before") {
  const RecordedEvents& events = two_motions();
  SegmenterOptions options;
  options.threads = 1;
  const Segmentation alone = segmented(events, options);
  for (const int threads : {2, 7}) {
    options.threads = threads;
    Segmenter segmenter(sensor, std::nullopt, options);
    segmenter.segment(events.view().slice(0, events.size() / 3));
    CHECK(same(segmenter.segment(events.view()), alone));
  }
  options.max_events = events.size() / 3;
  options.threads = 1;
  const Segmentation thinned = segmented(events, options);
  for (const int threads : {2, 7}) {
    options.threads = threads;
    CHECK(same(segmented(events, options), thinned));
  }
}

TEST_CASE("one segmenter serves two callers in turn") {
  const RecordedEvents& events = two_motions();
  Segmenter segmenter(sensor, std::nullopt, quiet_options());
  const Segmentation alone = segmenter.segment(events.view());
  Segmentation other;
  std::thread caller([&] { other = segmenter.segment(events.view()); });
  const Segmentation own = segmenter.segment(events.view());
  caller.join();
  CHECK(same(own, alone));
  CHECK(same(other, alone));
}

TEST_CASE("later times make no difference") {
  RecordedEvents events = two_motions();
  // Where on its pixel an event lies hangs on its time.
  SegmenterOptions options = quiet_options();
  options.footprint = Footprint::point;
  const Segmentation early = segmented(events, options);
  constexpr std::int64_t shift = 1'700'000'000'000'000;  // today
  for (std::int64_t& t : events.t) t += shift;
  Segmentation late = segmented(events, options);
  CHECK(late.t_ref == early.t_ref + shift);
  late.t_ref = early.t_ref;
  CHECK(same(late, early));
}

TEST_CASE("a given pool takes the place of the search, a given time that of the middle") {
  const RecordedEvents& events = two_motions();
  SegmenterOptions options = quiet_options();
  options.num_iter_segmentation = 0;  // labels alone
  WindowPrior prior;
  prior.pool = {object_motion, scene_motion, Similarity{{2000, 0, 0, 0}}};
  prior.t_ref = t_middle - 12'345;
  const Segmentation result = segmented(events, options, prior);
  check_sound(result, events.size());
  CHECK(result.t_ref == t_middle - 12'345);
  CHECK(accuracy(result, events) > 0.95);
  REQUIRE(result.models.size() == 2);
  CHECK(params_of(result.models[0])[0] == 110);
  CHECK(params_of(result.models[1])[0] == -180);
  CHECK(result.energy == written_out_energy(result, events, options));
}

// That labels of the pool searched for are those of one made by hand, and others where it is made otherwise.
void check_search(const RecordedEvents& events, double speed, double edge,
                  const std::function<void(PoolOptions&)>& otherwise) {
  SegmenterOptions options = published_images(quiet_options());
  options.lambda_data = 1.5;
  options.lambda_label = 900;
  options.bracket_row = 3;
  options.lambda_speed = speed;
  options.lambda_edge = edge;
  PoolOptions by_hand;
  by_hand.bracket_row = options.bracket_row;
  by_hand.bracket_col = options.bracket_col;
  by_hand.kinds = options.kinds;
  by_hand.search.max_speed = options.bounds.speed;
  by_hand.refine.bounds = options.bounds;
  by_hand.refine.contrast = {ContrastMeasure::mean_square, options.sigma};
  by_hand.lambda_data = options.lambda_data;
  by_hand.lambda_label = *options.lambda_label;
  by_hand.doubt = {.speed = options.lambda_speed, .edge = options.lambda_edge};
  by_hand.sigma = options.sigma;
  const Points points = make_points(events.view(), t_middle);
  by_hand.edges = edges_of(points, 0.3);
  ThreadPool threads(2);
  WindowPrior prior;
  prior.t_ref = t_middle;
  const auto of_pool_by_hand = [&] {
    WindowPrior given = prior;
    given.pool =
        make_model_pool(points.view(), events.p, make_warp_frame(sensor), plane, by_hand, threads).models;
    return segmented(events, options, given);
  };
  const Segmentation searched = segmented(events, options, prior);
  CHECK(same(searched, of_pool_by_hand()));
  otherwise(by_hand);
  CHECK(!same(searched, of_pool_by_hand()));
}

TEST_CASE("the pool is searched with the segmenter's own settings") {
  // Speed and edges make a difference to what is searched, not to the labels alone.
  check_search(two_motions(), 255, 40, [](PoolOptions& options) { options.doubt.speed = 0; });
  check_search(behind_bars(), 15, 255, [](PoolOptions& options) { options.doubt.edge = 0; });
}

TEST_CASE("noise is marked where asked, and nothing else changes") {
  RecordedEvents events;
  const RecordedEvents& clean = two_motions();
  std::mt19937 random(9);
  for (std::size_t k = 0; k < clean.size(); ++k) {
    events.add(clean.x[k], clean.y[k], clean.t[k], clean.p[k], clean.source[k]);
    if (k % 20 == 0) {
      events.add(static_cast<int>(uniform(random, 0, 160)), static_cast<int>(uniform(random, 0, 120)),
                 clean.t[k], 1, -1);
    }
  }
  SegmenterOptions options = quiet_options();
  const Segmentation all = segmented(events, options);
  options.mark_noise = true;
  const Segmentation marked = segmented(events, options);
  CHECK(marked.energy == all.energy);
  int noise = 0, true_noise = 0;
  for (std::size_t k = 0; k < events.size(); ++k) {
    if (marked.labels[k] != noise_label) {
      REQUIRE(marked.labels[k] == all.labels[k]);
      continue;
    }
    ++noise;
    true_noise += events.source[k] == -1;
  }
  CHECK(noise > 20);
  CHECK(true_noise > 0.7 * noise);
}

TEST_CASE("which sign an edge has makes no difference") {
  RecordedEvents events = two_motions();
  for (const DataTerm term : {DataTerm::logarithmic, DataTerm::published}) {
    SegmenterOptions options = quiet_options();
    options.data_term = term;
    const Segmentation as_seen = segmented(events, options);
    for (std::uint8_t& p : events.p) p = !p;
    CHECK(same(segmented(events, options), as_seen));
  }
  // Not even where all have the same.
  std::fill(events.p.begin(), events.p.end(), std::uint8_t{1});
  SegmenterOptions options = quiet_options();
  options.data_term = DataTerm::published;
  const Segmentation rises = segmented(events, options);
  std::fill(events.p.begin(), events.p.end(), std::uint8_t{0});
  const Segmentation falls = segmented(events, options);
  CHECK(same(falls, rises));
  CHECK(falls.reference_sharpness > 0);
  options.polarity = Polarity::ignored;
  CHECK(same(segmented(events, options), rises));
}

TEST_CASE("flicker is left out of the search and labelled by what is near it") {
  const RecordedEvents& scene = two_motions();
  std::mt19937 random(11);
  RecordedEvents events;
  std::size_t bursts = 0;
  const auto burst = [&](std::int64_t t) { return t >= t_middle - 3000 && t < t_middle - 2400; };
  const auto flash = [&](std::int64_t t) {
    for (int k = 0; k < 2000; ++k, ++bursts)
      events.add(static_cast<int>(random() % 160), static_cast<int>(random() % 120), t + k * 600 / 2000, 1,
                 -1);
  };
  for (std::size_t k = 0; k < scene.size(); ++k) {
    if (burst(scene.t[k])) continue;  // so that times do not decrease
    if (scene.t[k] >= t_middle - 2400 && bursts == 0) flash(t_middle - 3000);
    events.add(scene.x[k], scene.y[k], scene.t[k], scene.p[k], scene.source[k]);
  }
  SegmenterOptions options = quiet_options();
  const Segmentation result = segmented(events, options);
  check_sound(result, events.size());
  CHECK(result.thinned >= bursts);
  // The bins that the burst begins and ends in are its neighbours' as well.
  CHECK(static_cast<double>(result.thinned) <
        static_cast<double>(bursts) + 0.03 * static_cast<double>(scene.size()));
  REQUIRE(result.models.size() == 2);
  options.flicker = Flicker::kept;
  CHECK(segmented(events, options).thinned == 0);
  // Where there is but flicker, it is all that there is to segment.
  RecordedEvents nothing_else;
  for (int k = 0; k < 3000; ++k) nothing_else.add(k * 7 % 160, k * 11 % 120, 3 * k);
  options.flicker = Flicker::left_out;
  check_sound(segmented(nothing_else, options), nothing_else.size());
}

TEST_CASE("motions lose against the true ones, by the segmenter's own images") {
  const RecordedEvents& events = two_motions();
  RecordedEvents object;
  for (std::size_t k = 0; k < events.size(); ++k) {
    if (events.source[k] == 1) object.add(events.x[k], events.y[k], events.t[k], events.p[k], 1);
  }
  const std::vector<Vec2f> offsets{{0, 0}, {6, 0}};
  const Segmenter segmenter(sensor, std::nullopt, quiet_options());
  const auto own =
      segmenter.motion_losses(object.view(), t_middle, 0.04, object_motion, object_motion, offsets);
  REQUIRE(own.size() == 2);
  CHECK(own[0] == 0);
  CHECK(own[1] > 0.2);
  const auto other =
      segmenter.motion_losses(object.view(), t_middle, 0.04, object_motion, scene_motion, offsets);
  CHECK(other[0] > 0.2);
  CHECK(segmenter.motion_losses({}, 0, 0.04, object_motion, scene_motion, offsets).empty());
  CHECK_THROWS_AS(segmenter.motion_losses(object.view(), 0, 0, object_motion, scene_motion, offsets),
                  std::invalid_argument);
  CHECK_THROWS_AS(segmenter.motion_losses(object.view(), 0, 1, Translation{{NAN, 0}}, scene_motion, offsets),
                  std::invalid_argument);
}

TEST_CASE("choices have names") {
  for (const Polarity choice : {Polarity::ignored, Polarity::opposed})
    CHECK(polarity(name_of(choice)) == choice);
  for (const Footprint choice : {Footprint::point, Footprint::scattered})
    CHECK(footprint(name_of(choice)) == choice);
  for (const Flicker choice : {Flicker::kept, Flicker::left_out}) CHECK(flicker(name_of(choice)) == choice);
  CHECK_THROWS_WITH_AS(polarity("both"), "unknown polarity 'both', expected ignored or opposed",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(footprint(""), "unknown footprint '', expected point or scattered",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(flicker("left"), "unknown flicker 'left', expected kept or left_out",
                       std::invalid_argument);
}

TEST_CASE("where only an object moves, the background is still and free") {
  const WarpFrame frame = make_warp_frame(sensor);
  const RecordedEvents events =
      recorded(moving_dots({{object_motion, {68, 50, 24, 24}, 80, 12}}, frame, 0.04, 1), sensor, t_middle);
  const Segmentation result = segmented(events, quiet_options());
  check_sound(result, events.size());
  REQUIRE(result.models.size() == 2);
  for (const double param : params_of(result.models[0])) CHECK(param == 0);
  CHECK(std::count(result.labels.begin(), result.labels.end(), 1) > 0.9 * static_cast<double>(events.size()));
}
