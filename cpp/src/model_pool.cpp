#include "emseg/model_pool.hpp"

#include <algorithm>
#include <cmath>

#include "emseg/model_selection.hpp"

namespace emseg {

std::vector<Region> sub_volumes(Region plane, int bracket_row, int bracket_col) {
  std::vector<Region> regions;
  for (int h = 1; h <= std::max(bracket_row, bracket_col); ++h) {
    const int rows = std::min({h, bracket_row, plane.height});
    const int columns = std::min({h, bracket_col, plane.width});
    const int height = plane.height / rows;
    const int width = plane.width / columns;
    for (int j = 0; j < rows; ++j) {
      for (int i = 0; i < columns; ++i) {
        const int left = i * width;
        const int top = j * height;
        regions.push_back({plane.x0 + left, plane.y0 + top, i + 1 == columns ? plane.width - left : width,
                           j + 1 == rows ? plane.height - top : height});
      }
    }
  }
  return regions;
}

namespace {

// Candidates with what they make of the window.
class Candidates {
 public:
  Candidates(const PointView& points, const WarpFrame& frame, Region plane, const PoolOptions& options,
             ThreadPool& pool)
      : points_(points),
        frame_(frame),
        canvas_(canvas_of(plane)),
        options_(options),
        pool_(pool),
        taps_(gaussian_taps(options.sigma)),
        workspaces_(static_cast<std::size_t>(pool.worker_count())),
        sample_(thinned(points, 200)) {}

  // Takes models that differ from all there are; evaluates them.
  void add(std::vector<MotionModel> models) {
    const std::size_t before = models_.size();
    for (const MotionModel& model : models) {
      const bool known = std::any_of(models_.begin(), models_.end(), [&](const MotionModel& other) {
        return motion_distance(model, other, frame_, sample_.view()) < tolerance_;
      });
      if (!known) models_.push_back(model);
    }
    supports_.resize(models_.size());
    pool_.for_each(models_.size() - before, [&](std::size_t i, int worker) {
      evaluate_support(points_, models_[before + i], frame_, canvas_, taps_,
                       workspaces_[static_cast<std::size_t>(worker)], supports_[before + i]);
    });
  }

  // Chooses, keeps the chosen alone, and tells which block went to which.
  Selection choose(const BlockGrid& grid) {
    std::vector<const ModelSupport*> pointers;
    for (const ModelSupport& support : supports_) pointers.push_back(&support);
    const double reference = reference_sharpness(options_.term, pointers);
    std::vector<std::vector<float>> costs(models_.size());
    pool_.for_each(models_.size(), [&](std::size_t m, int) {
      costs[m] = block_costs(grid, supports_[m], options_.term, reference, options_.lambda_data);
    });
    Selection selection = select_models(costs, options_.lambda_label);
    std::vector<MotionModel> models;
    std::vector<ModelSupport> supports;
    for (std::size_t& m : selection.chosen) {
      models.push_back(models_[m]);
      supports.push_back(std::move(supports_[m]));
      m = models.size() - 1;
    }
    models_ = std::move(models);
    supports_ = std::move(supports);
    return selection;
  }

  void tell_apart(double tolerance) { tolerance_ = tolerance; }
  const std::vector<MotionModel>& models() const { return models_; }

 private:
  static Points thinned(const PointView& points, std::size_t count) {
    Points sample;
    const std::size_t stride = std::max<std::size_t>(1, points.size() / count);
    for (std::size_t k = 0; k < points.size(); k += stride) sample.push_back(points, k);
    return sample;
  }

  const PointView points_;
  const WarpFrame& frame_;
  Region canvas_;
  const PoolOptions& options_;
  ThreadPool& pool_;
  std::vector<float> taps_;
  std::vector<SupportWorkspace> workspaces_;
  Points sample_;
  double tolerance_ = 0;
  std::vector<MotionModel> models_;
  std::vector<ModelSupport> supports_;
};

// The richest kind on offer; poorer ones are special cases of it or compete later, on the labels.
MotionKind richest(const std::vector<MotionKind>& kinds) {
  return *std::max_element(kinds.begin(), kinds.end(),
                           [](MotionKind a, MotionKind b) { return dof_of(a) < dof_of(b); });
}

// Best velocities of the sub-volumes, strongest first, without near copies.
std::vector<MotionModel> propose_translations(const PointView& points, std::span<const std::uint8_t> positive,
                                              Region plane, const PoolOptions& options, ThreadPool& pool) {
  const auto regions = sub_volumes(plane, options.bracket_row, options.bracket_col);
  std::vector<VelocityScore> proposals;
  for (const auto& found : sweep_velocities(points, positive, regions, plane, options.sweep, pool)) {
    proposals.insert(proposals.end(), found.begin(), found.end());
  }
  std::stable_sort(proposals.begin(), proposals.end(),
                   [](const VelocityScore& a, const VelocityScore& b) { return a.score > b.score; });
  const double window = points.size() ? static_cast<double>(points.dt.back()) - points.dt.front() : 0;
  const double apart = options.same_motion / std::max(1e-9, window / std::sqrt(12.0));  // px/s for that many px rms
  std::vector<VelocityScore> kept{{0, 0, 0}};  // no motion is always a candidate
  for (const VelocityScore& proposal : proposals) {
    if (kept.size() >= options.max_candidates) break;
    if (std::all_of(kept.begin(), kept.end(), [&](const VelocityScore& other) {
          return std::hypot(other.vx - proposal.vx, other.vy - proposal.vy) > apart;
        })) {
      kept.push_back(proposal);
    }
  }
  std::vector<MotionModel> models;
  for (const VelocityScore& velocity : kept) models.push_back(Translation{{velocity.vx, velocity.vy}});
  return models;
}

// Each chosen model refitted on the events of its blocks, and each pair of them on both's.
std::vector<MotionModel> propose_refits(const PointView& points, const BlockGrid& grid, const Selection& selection,
                                        const std::vector<MotionModel>& models, const WarpFrame& frame,
                                        Region plane, const PoolOptions& options, ThreadPool& pool) {
  std::vector<Points> members(models.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    members[static_cast<std::size_t>(selection.of_block[static_cast<std::size_t>(grid.of_event[k])])].push_back(points,
                                                                                                              k);
  }
  struct Task {
    std::size_t start;   // model to start from
    std::size_t other;   // whose events are added; == start for none
  };
  std::vector<Task> tasks;
  for (std::size_t a = 0; a < models.size(); ++a) {
    for (std::size_t b = 0; b < models.size(); ++b) {
      // A pair starts from the one with more events.
      if (a == b || members[a].size() > members[b].size() || (members[a].size() == members[b].size() && a < b)) {
        tasks.push_back({a, b});
      }
    }
  }
  const MotionKind kind = richest(options.kinds);
  std::vector<MotionModel> refits(tasks.size());
  std::vector<ContrastWorkspace> workspaces(static_cast<std::size_t>(pool.worker_count()));
  pool.for_each(tasks.size(), [&](std::size_t i, int worker) {
    const Task& task = tasks[i];
    Points cluster = members[task.start];
    if (task.other != task.start) {
      const Points& other = members[task.other];
      cluster.x.insert(cluster.x.end(), other.x.begin(), other.x.end());
      cluster.y.insert(cluster.y.end(), other.y.begin(), other.y.end());
      cluster.dt.insert(cluster.dt.end(), other.dt.begin(), other.dt.end());
    }
    const MotionModel start = convert_motion(models[task.start], kind, frame, plane);
    refits[i] = refine_motion(cluster.view(), start, frame, fit_region(cluster.view(), start, frame, plane),
                              options.refine, workspaces[static_cast<std::size_t>(worker)])
                    .model;
  });
  return refits;
}

}  // namespace

std::vector<MotionModel> make_model_pool(const PointView& points, std::span<const std::uint8_t> positive,
                                         const WarpFrame& frame, Region plane, const PoolOptions& options,
                                         ThreadPool& pool) {
  if (points.size() == 0) return {convert_motion(Translation{}, richest(options.kinds), frame, plane)};
  const BlockGrid grid = make_block_grid(points, plane, options.block);
  Candidates candidates(points, frame, plane, options, pool);
  candidates.tell_apart(0);
  std::vector<MotionModel> proposals = options.candidates;
  for (const MotionModel& model : propose_translations(points, positive, plane, options, pool)) proposals.push_back(model);
  candidates.add(std::move(proposals));
  // Two rounds: the first fits are on blocks that coarse velocities chose, the second on those that good models chose.
  for (int round = 0; round < 2; ++round) {
    const Selection selection = candidates.choose(grid);
    candidates.tell_apart(0.02);
    candidates.add(propose_refits(points, grid, selection, candidates.models(), frame, plane, options, pool));
  }
  candidates.choose(grid);
  std::vector<MotionModel> models = candidates.models();
  const MotionKind kind = richest(options.kinds);
  for (MotionModel& model : models) model = convert_motion(model, kind, frame, plane);
  return models;
}

}  // namespace emseg
