#include "emseg/alternation.hpp"

#include <algorithm>
#include <cassert>

namespace emseg {

Alternation::Alternation(const PointView& points, const EventGraph& graph, const WarpFrame& frame,
                         Region plane, std::vector<MotionModel> models, const AlternationOptions& options,
                         ThreadPool& pool, ExpansionWorkspace& expansion_workspace, StageClock& clock)
    : points_(points),
      graph_(graph),
      frame_(frame),
      plane_(plane),
      options_(options),
      pool_(pool),
      expansion_workspace_(expansion_workspace),
      clock_(clock),
      taps_(gaussian_taps(options.sigma)),
      support_workspaces_(static_cast<std::size_t>(pool.worker_count())),
      contrast_workspaces_(static_cast<std::size_t>(pool.worker_count())),
      models_(std::move(models)),
      supports_(models_.size()),
      label_costs_(models_.size(), options.label_cost) {
  assert(!models_.empty() && points_.size() > 0);
  pool_.for_each(models_.size(),
                 [&](std::size_t m, int worker) { evaluate(models_[m], worker, supports_[m]); });
  std::vector<const ModelSupport*> pointers;
  for (const ModelSupport& support : supports_) pointers.push_back(&support);
  reference_ = reference_sharpness(options_.term, pointers);
  set_costs();
  clock_.lap("data_term");
}

void Alternation::run() {
  label();
  drop_unused();
  for (int iteration = 0; iteration < options_.iterations; ++iteration) {
    const std::int64_t before = energy();
    if (!refit()) break;
    label();
    drop_unused();
    if (energy() >= before) break;
  }
}

void Alternation::add_free_model(const MotionModel& model) {
  models_.push_back(model);
  supports_.emplace_back();
  evaluate(model, 0, supports_.back());
  label_costs_.push_back(0);
  set_costs();
  label();
}

// Labels given models: alpha-expansion.
void Alternation::label() {
  const std::size_t n = points_.size();
  const std::size_t count = models_.size();
  std::vector<std::int32_t> unary(n * count);
  for (std::size_t m = 0; m < count; ++m) {
    for (std::size_t k = 0; k < n; ++k) unary[k * count + m] = costs_[m][k];
  }
  ExpansionOptions options;
  options.max_sweeps = options_.sweeps;
  ExpansionResult result = expansion(labeling(unary), labels_, options, expansion_workspace_);
  labels_ = std::move(result.labels);
  trace_.push_back(result.energy);
  clock_.lap("labels");
}

// Models that no event uses take no part in the published G_ref either; without them it can only fall, and
// the energy with it.
void Alternation::drop_unused() {
  std::vector<std::int32_t> position(models_.size(), -1);
  for (const std::int32_t label : labels_) position[static_cast<std::size_t>(label)] = 0;
  std::size_t kept = 0;
  for (std::size_t m = 0; m < models_.size(); ++m) {
    if (position[m] < 0) continue;
    position[m] = static_cast<std::int32_t>(kept);
    if (kept != m) {
      models_[kept] = models_[m];
      supports_[kept] = std::move(supports_[m]);
      costs_[kept] = std::move(costs_[m]);
      label_costs_[kept] = label_costs_[m];
    }
    ++kept;
  }
  if (kept == models_.size()) return;
  models_.resize(kept);
  supports_.resize(kept);
  costs_.resize(kept);
  label_costs_.resize(kept);
  for (std::int32_t& label : labels_) label = position[static_cast<std::size_t>(label)];
  const std::int64_t before = data_cost();
  reference_ = reference_with(0, supports_[0]);
  set_costs();
  trace_.push_back(energy() + data_cost() - before);
}

// Models given labels: every used model is refitted on its own events, as each kind on offer; a refit that
// lowers the energy takes the model's place.  True if one did.
bool Alternation::refit() {
  std::vector<Points> members(models_.size());
  for (std::size_t k = 0; k < labels_.size(); ++k)
    members[static_cast<std::size_t>(labels_[k])].push_back(points_, k);
  struct Refit {
    std::size_t label;
    MotionKind kind;
    MotionModel model;
    ModelSupport support;
  };
  std::vector<Refit> refits;
  for (std::size_t l = 0; l < models_.size(); ++l) {
    if (members[l].size() == 0) continue;
    for (const MotionKind kind : options_.kinds) refits.push_back({l, kind, {}, {}});
  }
  pool_.for_each(refits.size(), [&](std::size_t i, int worker) {
    Refit& refit = refits[i];
    const PointView own = members[refit.label].view();
    const MotionModel start = convert_motion(models_[refit.label], refit.kind, frame_, plane_);
    refit.model = refine_motion(own, start, frame_, fit_region(own, start, frame_, plane_), options_.refine,
                                contrast_workspaces_[static_cast<std::size_t>(worker)])
                      .model;
    evaluate(refit.model, worker, refit.support);
  });

  bool improved = false;
  std::int64_t current = data_cost();
  std::int64_t energy_now = energy();
  for (Refit& refit : refits) {
    const double reference = reference_with(refit.label, refit.support);
    const std::int64_t with = data_cost_with(refit.label, refit.support, reference);
    if (with >= current) continue;
    energy_now += with - current;
    current = with;
    reference_ = reference;
    models_[refit.label] = refit.model;
    supports_[refit.label] = std::move(refit.support);
    improved = true;
  }
  if (improved) {
    set_costs();
    trace_.push_back(energy_now);
  }
  clock_.lap("refit");
  return improved;
}

void Alternation::evaluate(const MotionModel& model, int worker, ModelSupport& support) {
  evaluate_support(points_, model, frame_, canvas_of(plane_), taps_,
                   support_workspaces_[static_cast<std::size_t>(worker)], support);
}

// G_ref with `support` in the place of a label's.
double Alternation::reference_with(std::size_t label, const ModelSupport& support) const {
  if (options_.term != DataTerm::published) return reference_;
  std::vector<const ModelSupport*> pointers;
  for (std::size_t m = 0; m < supports_.size(); ++m)
    pointers.push_back(m == label ? &support : &supports_[m]);
  return reference_sharpness(options_.term, pointers);
}

// Data cost of the labels with `support` in the place of a label's.
std::int64_t Alternation::data_cost_with(std::size_t label, const ModelSupport& support,
                                         double reference) const {
  std::int64_t total = 0;
  for (std::size_t k = 0; k < labels_.size(); ++k) {
    const auto l = static_cast<std::size_t>(labels_[k]);
    const float sharpness = l == label ? support.sharpness[k] : supports_[l].sharpness[k];
    total += integer_cost(options_.term, sharpness, reference, options_.lambda_data);
  }
  return total;
}

std::int64_t Alternation::data_cost() const { return data_cost_with(0, supports_[0], reference_); }

void Alternation::set_costs() {
  costs_.resize(models_.size());
  pool_.for_each(models_.size(), [&](std::size_t m, int) {
    costs_[m].resize(points_.size());
    integer_costs(options_.term, supports_[m].sharpness, reference_, options_.lambda_data, costs_[m]);
  });
}

LabelingProblem Alternation::labeling(std::span<const std::int32_t> unary) const {
  LabelingProblem problem;
  problem.label_count = static_cast<std::int32_t>(models_.size());
  problem.unary = unary;
  problem.indptr = graph_.indptr;
  problem.indices = graph_.indices;
  problem.weight = {&options_.smooth_cost, 1};
  problem.label_cost = label_costs_;
  return problem;
}

}  // namespace emseg
