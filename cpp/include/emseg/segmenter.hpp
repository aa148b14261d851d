// The segmenter: one window of events in, a label per event and a motion model per label out.
#pragma once

#include <mutex>
#include <optional>
#include <vector>

#include "emseg/alternation.hpp"
#include "emseg/camera.hpp"
#include "emseg/model_pool.hpp"
#include "emseg/stage_clock.hpp"

namespace emseg {

// What the polarity of an event says of the images that it is part of.
enum class Polarity {
  ignored,  // nothing: all events count alike
  opposed,  // rises and falls take each other away: an edge that moves one way makes one of them
};

// What is known of the place of an event.
enum class Footprint {
  point,      // the middle of its pixel
  scattered,  // somewhere on its pixel (pixel_footprint.hpp)
};

// What becomes of bursts of events all over the sensor.
enum class Flicker {
  kept,
  left_out,  // motions and labels are found without them; they are labelled by what is near them
};

// As settings name them; the second of each throws std::invalid_argument that lists the known names.
std::string_view name_of(Polarity polarity);
Polarity polarity(std::string_view name);
std::string_view name_of(Footprint footprint);
Footprint footprint(std::string_view name);
std::string_view name_of(Flicker flicker);
Flicker flicker(std::string_view name);

struct SegmenterOptions {
  DataTerm data_term = DataTerm::logarithmic;
  double lambda_data = 1;              // weight of the data term
  double lambda_smooth = 24;           // Potts cost of an edge between two labels
  std::optional<double> lambda_label;  // cost of a used label; none: lambda_label_per_event times the events
  double lambda_label_per_event = 0.25;
  double tracked_share = 0.5;  // of the cost of a label, that a tracked object's costs (WindowPrior)
  double lambda_place = 20;  // cost of an event of a tracked object's elsewhere, or of another's in its place
  double lambda_speed = 15;  // cost of an event for every e-fold of its way (DoubtOptions::speed)
  double lambda_edge = 50;   // and of its way along edges (DoubtOptions::edge); half as much in the labels
  Polarity polarity = Polarity::opposed;
  Footprint footprint = Footprint::scattered;
  Flicker flicker = Flicker::left_out;
  int bracket_row = 6, bracket_col = 6;  // sub-volumes of the pool
  MotionBounds bounds;                   // Affine_trans2d_max, Affine_scale_max, Affine_theta_max
  std::vector<MotionKind> kinds{MotionKind::translation, MotionKind::similarity};  // HybridModelCombination
  int num_iter_segmentation = 5;                                                   // alternations at the most
  int num_iter_labeling = 2;                                                       // expansion sweeps of each
  Labelling labelling = Labelling::bands;
  double sigma = 0.7;  // blur of the images of warped events, px
  // Events of a window that motions and labels are found on; the others are given the labels of these.
  std::size_t max_events = 60'000;
  static constexpr std::size_t all_events = static_cast<std::size_t>(-1);
  bool mark_noise = true;  // label -1 for events that no other event of their motion is near
  int threads = 0;         // workers; 0: one per core

  // Throws std::invalid_argument that names the first option out of range.
  void check() const;
};

constexpr std::int32_t noise_label = -1;

struct Segmentation {
  std::vector<std::int32_t> labels;  // per event: 0 background, 1.. moving objects, largest first, -1 noise
  std::vector<MotionModel> models;   // per label
  std::int64_t t_ref = 0;            // us
  std::int64_t energy = 0;           // of the labels before noise was marked
  std::vector<std::int64_t> energy_trace;
  double reference_sharpness = 0;  // G_ref of the data term, fixed for the window
  std::size_t thinned = 0;         // events that were not among those that motions and labels were found on
  StageTimes timings;
};

// What a caller may know of a window beforehand.
struct WindowPrior {
  std::optional<std::int64_t> t_ref;    // us; none: the middle of the window
  std::vector<MotionModel> pool;        // the model pool; none: searched for
  std::vector<MotionModel> candidates;  // further candidates of the search, such as the last window's models
  std::vector<TrackedObject> tracked;   // objects that are known to be there
};

// Calls from several threads take turns.
class Segmenter {
 public:
  // The camera's undistortion table, where it is made already, saves making it.
  // Throws std::invalid_argument where the options, the size, the camera or its table do not fit.
  Segmenter(ImageSize size, const std::optional<Camera>& camera, const SegmenterOptions& options,
            std::optional<UndistortionTable> undistortion = std::nullopt);

  // Segments one window: space-time graph, model pool, then labels and models in turn while the energy falls.
  // Throws std::invalid_argument where the events are not valid (see check_events) or the prior does not fit.
  Segmentation segment(const EventView& events, const WindowPrior& prior = {});

  // See sharpness_losses; of a thousand events at the most, evenly in time.  Throws std::invalid_argument
  // where events, motions or the window's duration (s) are not valid.
  std::vector<double> motion_losses(const EventView& events, std::int64_t t_ref, double window,
                                    const MotionModel& own, const MotionModel& other,
                                    std::span<const Vec2f> offsets) const;

  const WarpFrame& frame() const { return frame_; }
  ImageSize size() const { return size_; }

 private:
  Points points_of(const EventView& events, std::int64_t t_ref) const;

  ImageSize size_;
  std::optional<UndistortionTable> undistortion_;
  Region plane_;  // of the undistorted pixels
  WarpFrame frame_;
  SegmenterOptions options_;
  ThreadPool pool_;
  ExpansionWorkspace expansion_workspace_;
  std::mutex turn_;  // of the caller whose window is being worked on
};

}  // namespace emseg
