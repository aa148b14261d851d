#include "emseg/segmenter.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "emseg/alternation.hpp"
#include "emseg/background.hpp"
#include "emseg/flicker.hpp"
#include "emseg/label_extension.hpp"
#include "emseg/motion_evidence.hpp"
#include "emseg/pixel_footprint.hpp"
#include "emseg/sampling.hpp"

namespace emseg {
namespace {

// Puts the background first and the objects after it, most events first; labels nobody uses go, the
// background stays.
void order_labels(std::int32_t background, const std::vector<MotionModel>& models,
                  const std::vector<std::int32_t>& labels, Segmentation& result) {
  std::vector<std::int64_t> events(models.size(), 0);
  for (const std::int32_t label : labels) ++events[static_cast<std::size_t>(label)];
  std::vector<std::int32_t> order(models.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) {
    if ((a == background) != (b == background)) return a == background;
    return events[static_cast<std::size_t>(a)] > events[static_cast<std::size_t>(b)];
  });
  std::vector<std::int32_t> position(models.size(), noise_label);
  for (const std::int32_t label : order) {
    if (label != background && events[static_cast<std::size_t>(label)] == 0) continue;
    position[static_cast<std::size_t>(label)] = static_cast<std::int32_t>(result.models.size());
    result.models.push_back(models[static_cast<std::size_t>(label)]);
  }
  result.labels.reserve(labels.size());
  for (const std::int32_t label : labels) result.labels.push_back(position[static_cast<std::size_t>(label)]);
}

std::int32_t rounded_cost(double cost, const char* name) {
  if (!(cost >= 0 && cost <= 1e9)) {
    throw std::invalid_argument(std::string(name) + " is " + std::to_string(cost) + ", expected 0..1e9");
  }
  return static_cast<std::int32_t>(std::lround(cost));
}

void require(bool valid, const std::string& what) {
  if (!valid) throw std::invalid_argument(what);
}

void require_finite(const std::vector<MotionModel>& models) {
  for (const MotionModel& model : models) make_motion(kind_of(model), params_of(model));
}

// The events that motions and labels are found on: no more than max_events, evenly in time.  Flicker is left
// out where the options say so, but for windows of nothing else: something has to be segmented.
std::vector<std::size_t> sample_of(const EventView& events, ImageSize size, const SegmenterOptions& options) {
  if (options.flicker == Flicker::kept) return even_sample(events.size(), options.max_events);
  const std::vector<std::uint8_t> flickers = find_flicker(events, size);
  std::vector<std::size_t> steady;
  steady.reserve(events.size());
  for (std::size_t k = 0; k < events.size(); ++k) {
    if (!flickers[k]) steady.push_back(k);
  }
  if (steady.empty()) return even_sample(events.size(), options.max_events);
  std::vector<std::size_t> sample = even_sample(steady.size(), options.max_events);
  for (std::size_t& k : sample) k = steady[k];
  return sample;
}

// The events of a window that motions and labels are found on: all of them, borrowed, or copies of some.
class EventSample {
 public:
  EventSample(const EventView& events, const Points& points, std::span<const std::size_t> sampled)
      : events_(events), points_(points.view()) {
    if (sampled.size() == events.size()) return;
    few_points_.reserve(sampled.size());
    for (const std::size_t k : sampled) {
      x_.push_back(events.x[k]);
      y_.push_back(events.y[k]);
      t_.push_back(events.t[k]);
      p_.push_back(events.p[k]);
      few_points_.push_back(points_, k);
    }
    events_ = {x_, y_, t_, p_};
    points_ = few_points_.view();
  }
  EventSample(const EventSample&) = delete;
  EventSample& operator=(const EventSample&) = delete;

  const EventView& events() const { return events_; }
  const PointView& points() const { return points_; }

 private:
  std::vector<std::uint16_t> x_, y_;
  std::vector<std::int64_t> t_;
  std::vector<std::uint8_t> p_;
  Points few_points_;
  EventView events_;
  PointView points_;
};

// The one of two choices that has this name.
template <typename Choice>
Choice either(const std::string& what, std::string_view name, Choice first, Choice second) {
  for (const Choice known : {first, second}) {
    if (name == name_of(known)) return known;
  }
  throw std::invalid_argument("unknown " + what + " '" + std::string(name) + "', expected " +
                              std::string(name_of(first)) + " or " + std::string(name_of(second)));
}

// Directions of edges by block, for the search of motions, which goes by whole blocks, and for the labels of
// single events, which do better without what is not plain.
struct Edges {
  std::vector<EdgeDirection> searched;
  std::vector<EdgeDirection> labelled;
};

Edges find_edges(const PointView& points, Region plane) {
  const BlockGrid grid = make_block_grid(points, plane, doubt_block);
  const std::vector<StructureTensor> tensors = structure_tensors(points, grid, edge_slices);
  return {edge_directions(tensors, grid, 0.3), edge_directions(tensors, grid, 2)};
}

// Images and cells are counted in ints, and a canvas has four times the sensor's pixels.
constexpr int max_sensor_side = 8192;

}  // namespace

std::string_view name_of(Polarity polarity) { return polarity == Polarity::ignored ? "ignored" : "opposed"; }
Polarity polarity(std::string_view name) {
  return either("polarity", name, Polarity::ignored, Polarity::opposed);
}

std::string_view name_of(Footprint footprint) {
  return footprint == Footprint::point ? "point" : "scattered";
}
Footprint footprint(std::string_view name) {
  return either("footprint", name, Footprint::point, Footprint::scattered);
}

std::string_view name_of(Flicker flicker) { return flicker == Flicker::kept ? "kept" : "left_out"; }
Flicker flicker(std::string_view name) { return either("flicker", name, Flicker::kept, Flicker::left_out); }

void SegmenterOptions::check() const {
  require(lambda_data >= 0 && lambda_data <= 1e6,
          "lambda_data is " + std::to_string(lambda_data) + ", expected 0..1e6");
  rounded_cost(lambda_smooth, "lambda_smooth");
  if (lambda_label) rounded_cost(*lambda_label, "lambda_label");
  require(lambda_label_per_event >= 0 && lambda_label_per_event <= 1e6,
          "lambda_label_per_event must be 0..1e6");
  require(tracked_share >= 0 && tracked_share <= 1,
          "tracked_share is " + std::to_string(tracked_share) + ", expected 0..1");
  rounded_cost(lambda_place, "lambda_place");
  require(lambda_speed >= 0 && lambda_speed <= 255,
          "lambda_speed is " + std::to_string(lambda_speed) + ", expected 0..255");
  require(lambda_edge >= 0 && lambda_edge <= 255,
          "lambda_edge is " + std::to_string(lambda_edge) + ", expected 0..255");
  require(bracket_row >= 1 && bracket_row <= 64,
          "bracket_row is " + std::to_string(bracket_row) + ", expected 1..64");
  require(bracket_col >= 1 && bracket_col <= 64,
          "bracket_col is " + std::to_string(bracket_col) + ", expected 1..64");
  require(bounds.speed > 0 && bounds.speed <= 1e7,
          "largest speed is " + std::to_string(bounds.speed) + " px/s, expected above 0, to 1e7");
  require(bounds.scale_rate >= 0 && bounds.angle_rate >= 0 && std::isfinite(bounds.scale_rate) &&
              std::isfinite(bounds.angle_rate),
          "scale and angle rates must be finite and not negative");
  require(!kinds.empty(), "no kind of motion model is allowed");
  require(num_iter_segmentation >= 0 && num_iter_segmentation <= 1000,
          "num_iter_segmentation is " + std::to_string(num_iter_segmentation) + ", expected 0..1000");
  require(num_iter_labeling >= 1 && num_iter_labeling <= 1000,
          "num_iter_labeling is " + std::to_string(num_iter_labeling) + ", expected 1..1000");
  gaussian_taps(sigma);
  require(max_events >= 1, "max_events is 0, expected 1 or more");
}

Segmenter::Segmenter(ImageSize size, const std::optional<Camera>& camera, const SegmenterOptions& options,
                     std::optional<UndistortionTable> undistortion)
    : size_(size),
      frame_(make_warp_frame(size, camera ? &*camera : nullptr)),
      options_(options),
      pool_(options.threads) {
  options_.check();
  check_events({}, size);
  require(size.width <= max_sensor_side && size.height <= max_sensor_side,
          "sensor size is " + std::to_string(size.width) + "x" + std::to_string(size.height) +
              ", expected up to " + std::to_string(max_sensor_side) + " each way");
  if (camera) {
    if (camera->size != size) {
      throw std::invalid_argument("the camera is " + std::to_string(camera->size.width) + "x" +
                                  std::to_string(camera->size.height) + ", the sensor " +
                                  std::to_string(size.width) + "x" + std::to_string(size.height));
    }
    if (camera->model != DistortionModel::none) {
      undistortion_ = undistortion ? std::move(*undistortion) : make_undistortion_table(*camera);
      const auto pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
      require(undistortion_->x.size() == pixels && undistortion_->y.size() == pixels,
              "the undistortion table has " + std::to_string(undistortion_->x.size()) + " and " +
                  std::to_string(undistortion_->y.size()) + " places, expected " + std::to_string(pixels));
    }
  }
  plane_ = image_plane(size_, undistortion_ ? &*undistortion_ : nullptr);
}

Segmentation Segmenter::segment(const EventView& events, const WindowPrior& prior) {
  const std::lock_guard turn(turn_);
  check_events(events, size_);
  require_finite(prior.pool);
  require_finite(prior.candidates);
  for (const TrackedObject& object : prior.tracked) {
    require_finite({object.model});
    require(std::isfinite(object.seen), "the time at which a tracked object was seen is not finite");
  }
  Segmentation result;
  StageClock clock(result.timings);
  const std::size_t n = events.size();
  result.t_ref = prior.t_ref ? *prior.t_ref : n ? std::midpoint(events.t.front(), events.t.back()) : 0;
  if (n == 0) {
    result.models = {Translation{}};
    return result;
  }

  // Events as points about t_ref, the sample of them that motions and labels are found on, and its space-time
  // graph.
  const Points all_points = points_of(events, result.t_ref);
  const std::vector<std::size_t> sampled = sample_of(events, size_, options_);
  const EventSample sample(events, all_points, sampled);
  const PointView points = sample.points();
  const PixelGraph graph = build_pixel_graph(sample.events(), size_);
  const Edges edges = options_.lambda_edge > 0 ? find_edges(points, plane_) : Edges{};
  clock.lap("graph");

  // Model pool.
  RefineOptions refine;
  refine.contrast = {ContrastMeasure::mean_square, options_.sigma};
  refine.bounds = options_.bounds;
  const auto share = static_cast<double>(sampled.size()) / static_cast<double>(n);
  const double label_cost =
      share * (options_.lambda_label ? *options_.lambda_label
                                     : options_.lambda_label_per_event * static_cast<double>(n));
  ModelPool models{prior.pool, std::vector<std::int32_t>(prior.pool.size(), no_object)};
  if (models.models.empty()) {
    PoolOptions pool;
    pool.bracket_row = options_.bracket_row;
    pool.bracket_col = options_.bracket_col;
    pool.kinds = options_.kinds;
    pool.search.max_speed = options_.bounds.speed;
    pool.refine = refine;
    pool.term = options_.data_term;
    pool.lambda_data = options_.lambda_data;
    pool.lambda_label = label_cost;
    pool.tracked_share = options_.tracked_share;
    pool.doubt = {options_.lambda_speed, options_.lambda_edge};
    pool.edges = edges.searched;
    pool.sigma = options_.sigma;
    pool.candidates = prior.candidates;
    pool.tracked = prior.tracked;
    models = make_model_pool(points, sample.events().p, frame_, plane_, pool, pool_);
  }
  clock.lap("model_pool");

  // Labels and models in turn, until the energy stops falling.
  AlternationOptions alternation_options;
  alternation_options.term = options_.data_term;
  alternation_options.lambda_data = options_.lambda_data;
  alternation_options.smooth_cost = rounded_cost(options_.lambda_smooth, "lambda_smooth");
  alternation_options.label_cost = std::llround(label_cost);
  for (const std::int32_t object : models.object) {
    alternation_options.label_costs.push_back(
        std::llround(object == no_object ? label_cost : options_.tracked_share * label_cost));
  }
  alternation_options.doubt = {options_.lambda_speed, options_.lambda_edge / 2};
  alternation_options.edges = edges.labelled;
  alternation_options.place_cost = rounded_cost(options_.lambda_place, "lambda_place");
  alternation_options.objects = models.object;
  for (const TrackedObject& object : prior.tracked)
    alternation_options.expected.push_back(where_expected(points, object, frame_, plane_));
  alternation_options.kinds = options_.kinds;
  alternation_options.refine = refine;
  alternation_options.sigma = options_.sigma;
  alternation_options.iterations = options_.num_iter_segmentation;
  alternation_options.sweeps = options_.num_iter_labeling;
  alternation_options.labelling = options_.labelling;
  Alternation alternation(points, graph, frame_, plane_, std::move(models.models), alternation_options, pool_,
                          expansion_workspace_, clock);
  alternation.run();

  // Background, noise, and the order of the labels.
  const auto extents = label_extents(points, alternation.labels(),
                                     static_cast<std::int32_t>(alternation.models().size()), plane_);
  std::int32_t background = background_label(extents);
  if (background < 0) {
    background = static_cast<std::int32_t>(alternation.models().size());
    alternation.add_free_model(Translation{});
  }
  order_labels(background, alternation.models(), alternation.labels(), result);
  clock.lap("background");

  // The labels of the others, and noise.
  if (sampled.size() < n) {
    result.labels = extend_labels(all_points.view(), sampled, result.labels, result.models, frame_, plane_,
                                  gaussian_taps(options_.sigma));
  }
  if (options_.mark_noise) {
    const auto lonely = find_lonely_events(all_points.view(), result.labels, result.models, frame_, plane_, 1,
                                           company_radius(n, plane_));
    for (std::size_t k = 0; k < n; ++k) {
      if (lonely[k]) result.labels[k] = noise_label;
    }
  }
  result.energy = alternation.energy();
  result.energy_trace = alternation.trace();
  result.reference_sharpness = alternation.reference();
  clock.lap("extension");
  result.thinned = n - sampled.size();
  return result;
}

// Events as motions see them: undistorted, scattered over their pixels, with the signs of their polarities.
Points Segmenter::points_of(const EventView& events, std::int64_t t_ref) const {
  Points points = make_points(events, t_ref, undistortion_ ? &*undistortion_ : nullptr);
  if (options_.footprint == Footprint::scattered) scatter_over_pixels(events, t_ref, points);
  if (options_.polarity == Polarity::opposed) {
    points.sign.reserve(events.size());
    for (const std::uint8_t positive : events.p) points.sign.push_back(positive != 0 ? 1.0f : -1.0f);
  }
  return points;
}

std::vector<double> Segmenter::motion_losses(const EventView& events, std::int64_t t_ref, double window,
                                             const MotionModel& own, const MotionModel& other,
                                             std::span<const Vec2f> offsets) const {
  constexpr std::size_t enough = 1000;
  check_events(events, size_);
  require_finite({own, other});
  require(window > 0 && std::isfinite(window),
          "window is " + std::to_string(window) + " s, expected above 0");
  const std::vector<std::size_t> sampled = even_sample(events.size(), enough);
  const Points all = points_of(events, t_ref);
  Points some;
  for (const std::size_t k : sampled) some.push_back(all.view(), k);
  return sharpness_losses(some.view(), own, other, offsets, window, frame_, canvas_of(plane_));
}

}  // namespace emseg
