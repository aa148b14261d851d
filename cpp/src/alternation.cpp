#include "emseg/alternation.hpp"

#include <algorithm>
#include <cassert>
#include <stdexcept>
#include <string>

#include "emseg/sampling.hpp"

namespace emseg {

std::string_view name_of(Labelling labelling) { return labelling == Labelling::bands ? "bands" : "exact"; }

Labelling labelling(std::string_view name) {
  for (const Labelling known : {Labelling::bands, Labelling::exact}) {
    if (name == name_of(known)) return known;
  }
  throw std::invalid_argument("unknown labelling '" + std::string(name) + "', expected bands or exact");
}

Alternation::Alternation(const PointView& points, const PixelGraph& graph, const WarpFrame& frame,
                         Region plane, std::vector<MotionModel> models, const AlternationOptions& options,
                         ThreadPool& pool, ExpansionWorkspace& expansion_workspace, StageClock& clock)
    : points_(points),
      graph_(graph),
      frame_(frame),
      plane_(plane),
      options_(options),
      pool_(pool),
      expansion_workspace_(expansion_workspace),
      bands_(graph, expansion_workspace, {.max_sweeps = options.sweeps}),
      clock_(clock),
      taps_(gaussian_taps(options.sigma)),
      support_workspaces_(static_cast<std::size_t>(pool.worker_count())),
      contrast_workspaces_(static_cast<std::size_t>(pool.worker_count())),
      models_(std::move(models)),
      supports_(models_.size()),
      label_costs_(options.label_costs) {
  objects_ = options.objects;
  if (objects_.empty()) objects_.assign(models_.size(), no_object);
  assert(objects_.size() == models_.size());
  if (options_.place_cost > 0) {
    for (const auto& expected : options_.expected) {
      if (expected.empty()) continue;
      anyones_.resize(points_.size(), 0);
      for (std::size_t k = 0; k < expected.size(); ++k) anyones_[k] |= expected[k];
    }
  }
  if (options_.doubt.speed > 0 || options_.doubt.edge > 0) {
    blocks_ = make_block_grid(points_, plane_, doubt_block);
    doubt_.emplace(*blocks_, points_.seconds(), options_.doubt, options_.edges);
  }
  if (label_costs_.empty()) label_costs_.assign(models_.size(), options.label_cost);
  assert(label_costs_.size() == models_.size());
  assert(!models_.empty() && points_.size() > 0);
  pool_.for_each(models_.size(),
                 [&](std::size_t m, int worker) { evaluate(models_[m], worker, supports_[m]); });
  std::vector<const ModelSupport*> pointers;
  for (const ModelSupport& support : supports_) pointers.push_back(&support);
  costs_.resize(models_.size());
  set_reference(reference_sharpness(options_.term, pointers));
  clock_.lap("data_term");
  if (options_.labelling == Labelling::exact) {
    event_graph_ = join_events(graph_);
    clock_.lap("graph");
  }
}

void Alternation::run() {
  label();
  drop_unused();
  const auto falls = [&](std::int64_t before, double tolerance) {
    return static_cast<double>(before - energy()) > tolerance * static_cast<double>(before);
  };
  for (int iteration = 0; iteration < options_.iterations; ++iteration) {
    const std::int64_t before = energy();
    // Where refits gain little, labels gain less; where labels hardly change, so do refits.
    if (!refit() || !falls(before, options_.step_tolerance)) break;
    const std::int64_t refitted = energy();
    label();
    drop_unused();
    if (!falls(refitted, options_.step_tolerance) || !falls(before, options_.tolerance)) break;
  }
}

void Alternation::add_free_model(const MotionModel& model) {
  models_.push_back(model);
  supports_.emplace_back();
  evaluate(model, 0, supports_.back());
  label_costs_.push_back(0);
  objects_.push_back(no_object);
  costs_.emplace_back();
  evaluate_costs(model, supports_.back(), no_object, costs_.back());
  label();
}

// Labels given models: alpha-expansion.
void Alternation::label() {
  std::vector<std::span<const std::int32_t>> unary(costs_.begin(), costs_.end());
  const WindowLabeling problem{unary, options_.smooth_cost, label_costs_};
  ExpansionResult result =
      options_.labelling == Labelling::exact ? exact_labels() : bands_.minimise(problem, labels_);
  labels_ = std::move(result.labels);
  trace_.push_back(result.energy);
  clock_.lap("labels");
}

ExpansionResult Alternation::exact_labels() {
  const std::size_t n = points_.size();
  const std::size_t count = models_.size();
  std::vector<std::int32_t> unary(n * count);
  for (std::size_t m = 0; m < count; ++m) {
    for (std::size_t k = 0; k < n; ++k) unary[k * count + m] = costs_[m][k];
  }
  LabelingProblem problem;
  problem.label_count = static_cast<std::int32_t>(count);
  problem.unary = unary;
  problem.indptr = event_graph_.indptr;
  problem.indices = event_graph_.indices;
  problem.weight = {&options_.smooth_cost, 1};
  problem.label_cost = label_costs_;
  return expansion(problem, labels_, {.max_sweeps = options_.sweeps}, expansion_workspace_);
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
      objects_[kept] = objects_[m];
    }
    ++kept;
  }
  if (kept == models_.size()) return;
  models_.resize(kept);
  supports_.resize(kept);
  costs_.resize(kept);
  label_costs_.resize(kept);
  objects_.resize(kept);
  for (std::int32_t& label : labels_) label = position[static_cast<std::size_t>(label)];
  for (std::int32_t& label : refitted_labels_) label = position[static_cast<std::size_t>(label)];
  const std::int64_t before = data_cost();
  if (options_.term == DataTerm::published) set_reference(reference_with(0, supports_[0]));
  trace_.push_back(energy() + data_cost() - before);
}

// Models given labels: every used model whose events have changed is refitted on them, as the richest kind on
// offer, which the others are cases of; a refit that lowers the energy takes the model's place.  True if one
// did.
bool Alternation::refit() {
  std::vector<std::vector<std::size_t>> members(models_.size());
  for (std::size_t k = 0; k < labels_.size(); ++k) members[static_cast<std::size_t>(labels_[k])].push_back(k);
  struct Refit {
    std::size_t label;
    MotionModel model;
    ModelSupport support;
    std::vector<std::int32_t> costs;
  };
  std::vector<Refit> refits;
  for (std::size_t l = 0; l < models_.size(); ++l) {
    if (!members[l].empty() && members_changed(l)) refits.push_back({l, {}, {}, {}});
  }
  const MotionKind kind = richest(options_.kinds);
  std::vector<std::size_t> sizes;
  for (const Refit& refit : refits) sizes.push_back(members[refit.label].size());
  const std::vector<std::size_t> order = largest_first(sizes);
  pool_.for_each(refits.size(), [&](std::size_t turn, int worker) {
    Refit& refit = refits[order[turn]];
    const std::vector<std::size_t>& all = members[refit.label];
    Points own;
    for (const std::size_t at : even_sample(all.size(), options_.max_refit_events))
      own.push_back(points_, all[at]);
    const MotionModel start = convert_motion(models_[refit.label], kind, frame_, plane_);
    refit.model = refine_motion(own.view(), start, frame_, fit_region(own.view(), start, frame_, plane_),
                                options_.refine, contrast_workspaces_[static_cast<std::size_t>(worker)])
                      .model;
    evaluate(refit.model, worker, refit.support);
    if (options_.term != DataTerm::published)
      evaluate_costs(refit.model, refit.support, objects_[refit.label], refit.costs);
  });
  refitted_labels_ = labels_;

  bool improved = false;
  std::int64_t current = data_cost();
  std::int64_t energy_now = energy();
  for (Refit& refit : refits) {
    const double before = reference_;
    std::swap(models_[refit.label], refit.model);
    std::swap(supports_[refit.label], refit.support);
    if (options_.term == DataTerm::published) {
      // A sharper image elsewhere makes every event dearer: all costs follow G_ref.
      set_reference(reference_with(refit.label, supports_[refit.label]));
    } else {
      std::swap(costs_[refit.label], refit.costs);
    }
    const std::int64_t with = data_cost();
    if (with < current) {
      energy_now += with - current;
      current = with;
      improved = true;
    } else {
      std::swap(models_[refit.label], refit.model);
      std::swap(supports_[refit.label], refit.support);
      if (options_.term == DataTerm::published) {
        set_reference(before);
      } else {
        std::swap(costs_[refit.label], refit.costs);
      }
    }
  }
  if (improved) trace_.push_back(energy_now);
  clock_.lap("refit");
  return improved;
}

// Since the last refit.
bool Alternation::members_changed(std::size_t label) const {
  const auto l = static_cast<std::int32_t>(label);
  for (std::size_t k = 0; k < refitted_labels_.size(); ++k) {
    if ((labels_[k] == l) != (refitted_labels_[k] == l)) return true;
  }
  return refitted_labels_.empty();
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

// Data cost of the labels.
std::int64_t Alternation::data_cost() const {
  std::int64_t total = 0;
  for (std::size_t k = 0; k < labels_.size(); ++k) total += costs_[static_cast<std::size_t>(labels_[k])][k];
  return total;
}

void Alternation::evaluate_costs(const MotionModel& model, const ModelSupport& support, std::int32_t object,
                                 std::vector<std::int32_t>& costs) const {
  const std::size_t n = points_.size();
  costs.resize(n);
  integer_costs(options_.term, support.sharpness, reference_, options_.lambda_data, costs);
  if (doubt_) {
    const std::vector<std::int32_t> doubts = doubt_->of(model, frame_);
    for (std::size_t k = 0; k < n; ++k) costs[k] += doubts[static_cast<std::size_t>(blocks_->of_event[k])];
  }
  if (anyones_.empty()) return;
  if (object == no_object) {
    for (std::size_t k = 0; k < n; ++k) costs[k] += anyones_[k] ? options_.place_cost : 0;
    return;
  }
  const std::vector<std::uint8_t>& expected = options_.expected[static_cast<std::size_t>(object)];
  for (std::size_t k = 0; k < expected.size(); ++k) costs[k] += expected[k] ? 0 : options_.place_cost;
}

void Alternation::set_reference(double reference) {
  reference_ = reference;
  pool_.for_each(models_.size(), [&](std::size_t m, int) {
    evaluate_costs(models_[m], supports_[m], objects_[m], costs_[m]);
  });
}

}  // namespace emseg
