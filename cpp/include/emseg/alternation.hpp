// The alternation: labels given models by graph cuts, models given labels by contrast maximisation, in turn.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "emseg/band_expansion.hpp"
#include "emseg/data_term.hpp"
#include "emseg/motion_doubt.hpp"
#include "emseg/motion_fit.hpp"
#include "emseg/stage_clock.hpp"
#include "emseg/tracked_object.hpp"

namespace emseg {

// How labels are found for given models.
enum class Labelling {
  bands,  // from coarse to fine (BandExpansion)
  exact,  // expansion moves on all events at once
};

std::string_view name_of(Labelling labelling);
// Throws std::invalid_argument that lists the known names.
Labelling labelling(std::string_view name);

struct AlternationOptions {
  DataTerm term = DataTerm::logarithmic;
  double lambda_data = 1;
  std::int32_t smooth_cost = 30;          // lambda_P
  std::int64_t label_cost = 8000;         // lambda_M
  std::vector<std::int64_t> label_costs;  // of each model given, where they differ
  DoubtOptions doubt;                     // of what an event costs more by its motion
  std::vector<EdgeDirection> edges;       // per block of doubt_block px, or none
  std::int32_t place_cost = 0;            // lambda_T, of an event
  std::vector<std::int32_t> objects;      // that move by each model given, or no_object; none: empty
  std::vector<std::vector<std::uint8_t>> expected;        // of each object, where_expected
  std::vector<MotionKind> kinds{MotionKind::similarity};  // that a label may have
  RefineOptions refine;
  double sigma = 1;              // blur of the data term's images, px
  int iterations = 5;            // labels and models in turn (NUM_ITER_SEGMENTATION)
  double tolerance = 1e-3;       // share of the energy: what falls less in a turn has stopped falling
  double step_tolerance = 3e-4;  // the same of labels alone, or of models alone
  int sweeps = 2;                // of expansion moves in each (NUM_ITER_LABELING)
  Labelling labelling = Labelling::bands;
  std::size_t max_refit_events = 6000;  // of a label's, evenly in time, that its motion is fitted to
};

// Labels and models of one window with their energy
//   E(L, M) = lambda_D sum_k D(e_k, M_L(k)) + lambda_P sum_(i,j) [L_i != L_j] + sum_(l used) lambda_M(l)
//             + lambda_V sum_k log(1 + way of M_L(k) at e_k / 10 px) + lambda_T sum_k [L_k is astray],
// lambda_M one for all labels or one for each.  The label of an object's motion is astray where that object
// is not expected, and that of no object's where any is.  A refit keeps the label cost and the object of the
// model that it takes the place of.  No step raises E.  G_ref, the sharpness that costs nothing, is part of
// the published energy and follows the models there (the largest pixel of any of them); the logarithmic
// term's is taken once, from the models given.
class Alternation {
 public:
  // What is passed by reference must outlive the alternation.  There is at least one model and one point.
  Alternation(const PointView& points, const PixelGraph& graph, const WarpFrame& frame, Region plane,
              std::vector<MotionModel> models, const AlternationOptions& options, ThreadPool& pool,
              ExpansionWorkspace& expansion_workspace, StageClock& clock);

  // Alternates until a step or a turn of two lowers the energy by no more than its tolerance.
  void run();

  // Finds the labels again with one more model, which is free of label cost and leaves G_ref as it is.
  void add_free_model(const MotionModel& model);

  const std::vector<MotionModel>& models() const { return models_; }
  const std::vector<std::int32_t>& labels() const { return labels_; }
  std::int64_t energy() const { return trace_.back(); }
  const std::vector<std::int64_t>& trace() const { return trace_; }  // after every step
  double reference() const { return reference_; }                    // G_ref

 private:
  void label();
  void drop_unused();
  bool refit();
  bool members_changed(std::size_t label) const;
  void evaluate(const MotionModel& model, int worker, ModelSupport& support);
  void evaluate_costs(const MotionModel& model, const ModelSupport& support, std::int32_t object,
                      std::vector<std::int32_t>& costs) const;
  double reference_with(std::size_t label, const ModelSupport& support) const;
  std::int64_t data_cost() const;
  void set_reference(double reference);
  ExpansionResult exact_labels();

  const PointView points_;
  const PixelGraph& graph_;
  const WarpFrame& frame_;
  const Region plane_;
  const AlternationOptions options_;
  ThreadPool& pool_;
  ExpansionWorkspace& expansion_workspace_;
  BandExpansion bands_;
  EventGraph event_graph_;  // for exact labels only
  StageClock& clock_;
  const std::vector<float> taps_;
  std::vector<IweWorkspace> support_workspaces_;
  std::vector<ContrastWorkspace> contrast_workspaces_;

  std::vector<MotionModel> models_;
  std::vector<ModelSupport> supports_;
  std::vector<std::int64_t> label_costs_;
  std::vector<std::int32_t> objects_;  // per model
  std::vector<std::uint8_t> anyones_;  // per event: where some object is expected; empty: no place costs
  std::optional<BlockGrid> blocks_;    // whose events share the cost of speed
  std::optional<MotionDoubt> doubt_;
  double reference_ = 0;
  std::vector<std::vector<std::int32_t>> costs_;  // per model, per event
  std::vector<std::int32_t> labels_;
  std::vector<std::int32_t> refitted_labels_;  // that the last refit saw
  std::vector<std::int64_t> trace_;
};

}  // namespace emseg
