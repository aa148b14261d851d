#include "emseg/model_pool.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "emseg/count_image.hpp"
#include "emseg/model_selection.hpp"
#include "emseg/sampling.hpp"

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

// Squares of `side` px that overlap by half: small objects fill one of them.
std::vector<Region> overlapping_tiles(Region plane, int side) {
  std::vector<Region> tiles;
  const int step = side / 2;
  for (int y = 0; y + step < plane.height; y += step) {
    for (int x = 0; x + step < plane.width; x += step) {
      tiles.push_back(
          {plane.x0 + x, plane.y0 + y, std::min(side, plane.width - x), std::min(side, plane.height - y)});
    }
  }
  return tiles;
}

// Best velocities of the regions, most significant first, without near copies.
std::vector<MotionModel> propose_translations(const PointView& points, std::span<const std::uint8_t> positive,
                                              std::span<const Region> regions, Region plane,
                                              const PoolOptions& options, ThreadPool& pool) {
  if (points.size() == 0) return {};
  std::vector<RegionVelocity> proposals;
  for (const auto& found : find_region_velocities(points, positive, regions, plane, options.search, pool)) {
    proposals.insert(proposals.end(), found.begin(), found.end());
  }
  if (proposals.empty()) return {};
  std::stable_sort(proposals.begin(), proposals.end(), [](const RegionVelocity& a, const RegionVelocity& b) {
    return a.significance > b.significance;
  });
  const double window = points.seconds();
  const double apart = options.same_motion / std::max(1e-9, window);  // px/s
  std::vector<RegionVelocity> kept;
  for (const RegionVelocity& proposal : proposals) {
    if (kept.size() >= options.max_candidates) break;
    if (std::all_of(kept.begin(), kept.end(), [&](const RegionVelocity& other) {
          return std::hypot(other.vx - proposal.vx, other.vy - proposal.vy) > apart;
        })) {
      kept.push_back(proposal);
    }
  }
  std::vector<MotionModel> models;
  for (const RegionVelocity& velocity : kept) models.push_back(Translation{{velocity.vx, velocity.vy}});
  return models;
}

struct Sample {
  Points points;
  std::vector<std::uint8_t> positive;

  void push_back(const PointView& from, std::span<const std::uint8_t> polarities, std::size_t k) {
    points.push_back(from, k);
    positive.push_back(polarities[k]);
  }
};

Sample thinned(const PointView& points, std::span<const std::uint8_t> positive, std::size_t most) {
  Sample sample;
  for (const std::size_t k : even_sample(points.size(), most)) sample.push_back(points, positive, k);
  return sample;
}

// No more than `most` of the points, evenly in time.
Points thinned(const PointView& points, std::size_t most) {
  Points few;
  for (const std::size_t k : even_sample(points.size(), most)) few.push_back(points, k);
  return few;
}

// Half the resolution: a quarter of the pixels, and peaks of contrast twice as wide.
WarpFrame halved(WarpFrame frame) {
  for (double* length : {&frame.cx, &frame.cy, &frame.f0, &frame.fx, &frame.fy, &frame.px, &frame.py})
    *length *= 0.5;
  return frame;
}

Region halved(Region region) {
  return {region.x0 / 2 - 1, region.y0 / 2 - 1, region.width / 2 + 2, region.height / 2 + 2};
}

void halve(Points& points) {
  for (float& x : points.x) x *= 0.5f;
  for (float& y : points.y) y *= 0.5f;
}

// The model in coordinates that are `scale` times as large, with the frame to match.
MotionModel scaled(const MotionModel& model, double scale) {
  MotionModel result = model;
  std::visit(
      [scale](auto& m) {
        if constexpr (!std::is_same_v<std::decay_t<decltype(m)>, Rotation>) {
          m.params[0] *= scale;
          m.params[1] *= scale;
        }
      },
      result);
  return result;
}

// The search for the cheapest set of models: candidates, what they cost every block, and the set chosen last.
// It sees the events thinned, counts whole votes, and refines at half the resolution: what it hands on is
// refined in full later.
class PoolSearch {
 public:
  PoolSearch(const PointView& points, std::span<const std::uint8_t> positive, const WarpFrame& frame,
             Region plane, const PoolOptions& options, ThreadPool& pool)
      : sample_(thinned(points, positive, options.max_events)),
        points_(sample_.points),
        frame_(frame),
        half_frame_(halved(frame)),
        plane_(plane),
        options_(options),
        pool_(pool),
        // In units of the data cost of a thinned event.
        label_cost_(std::llround(std::min(1e15, options.lambda_label / std::max(1e-9, options.lambda_data) *
                                                    static_cast<double>(points_.size()) /
                                                    static_cast<double>(points.size())))),
        grid_(make_block_grid(points_.view(), plane, options.block)),
        doubt_(grid_, points_.view().seconds(), options.doubt, options.edges),
        count_workspaces_(static_cast<std::size_t>(pool.worker_count())),
        contrast_workspaces_(static_cast<std::size_t>(pool.worker_count())) {}

  void add(const std::vector<MotionModel>& models) {
    add({models, std::vector<std::int32_t>(models.size(), no_object)});
  }
  // The motions of tracked objects as they were, and fitted to the events where the objects are expected.
  void add_tracked(const std::vector<TrackedObject>& objects) {
    constexpr std::size_t few = 20;  // events: their motion may be anything
    ModelPool known;
    known.models.resize(2 * objects.size());
    known.object.resize(2 * objects.size());
    pool_.for_each(objects.size(), [&](std::size_t i, int worker) {
      const std::vector<std::uint8_t> expected = where_expected(points_.view(), objects[i], frame_, plane_);
      Points own;
      for (std::size_t k = 0; k < expected.size(); ++k) {
        if (expected[k]) own.push_back(points_.view(), k);
      }
      known.models[2 * i] = known.models[2 * i + 1] = objects[i].model;
      known.object[2 * i] = known.object[2 * i + 1] = static_cast<std::int32_t>(i);
      if (own.size() < few) return;
      known.models[2 * i + 1] =
          refined(thinned(own.view(), options_.max_refit_events), objects[i].model, worker);
    });
    add(known);
  }
  void add(const ModelPool& candidates) {
    const auto& models = candidates.models;
    const std::size_t before = models_.size();
    models_.insert(models_.end(), models.begin(), models.end());
    objects_.insert(objects_.end(), candidates.object.begin(), candidates.object.end());
    for (const std::int32_t object : candidates.object) {
      label_costs_.push_back(object == no_object
                                 ? label_cost_
                                 : std::llround(options_.tracked_share * static_cast<double>(label_cost_)));
    }
    sharpness_.resize(models_.size());
    doubts_.resize(models_.size());
    pool_.for_each(models.size(), [&](std::size_t i, int worker) {
      std::vector<std::uint16_t>& sharpness = sharpness_[before + i];
      sharpness.resize(points_.size());
      count_sharpness(points_.view(), models_[before + i], frame_, canvas_of(plane_),
                      count_workspaces_[static_cast<std::size_t>(worker)], sharpness);
      doubts_[before + i] = doubt_.of(models_[before + i], frame_);
    });
  }

  // Chooses among all candidates.
  void choose() {
    std::vector<std::uint8_t> cost_of = event_costs(reference_of_chosen());
    // Costs stay as they are while the reference does.
    const std::size_t known = cost_of == cost_of_ ? costs_.size() : 0;
    cost_of_ = std::move(cost_of);
    costs_.resize(models_.size());
    pool_.for_each(models_.size() - known, [&](std::size_t i, int) {
      const std::size_t m = known + i;
      costs_[m] = block_costs(grid_, sharpness_[m], cost_of_, doubts_[m]);
    });
    selection_ = select_models(costs_, label_costs_);
  }

  // Events that no chosen model makes sharp: noise, and what moves in a way not thought of yet.
  Sample unexplained() const {
    constexpr std::uint8_t dear = 120;  // by the logarithmic term, less than a fifth of the reference
    Sample rest;
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const bool explained = std::any_of(selection_.chosen.begin(), selection_.chosen.end(),
                                         [&](std::size_t m) { return cost_of_[sharpness_[m][k]] < dear; });
      if (!explained) rest.push_back(points_.view(), sample_.positive, k);
    }
    return rest;
  }

  // Each chosen model refitted on the events of its blocks, and pairs that are nearly one motion on both's.
  ModelPool refits() {
    const auto& chosen = selection_.chosen;
    std::vector<Points> members(chosen.size());
    const PointView points = points_.view();
    for (std::size_t k = 0; k < points.size(); ++k) {
      members[chosen_for(grid_.of_event[k])].push_back(points, k);
    }
    for (Points& cluster : members) cluster = thinned(cluster.view(), options_.max_refit_events);
    struct Task {
      std::size_t start;  // whose model to start from, and whose events to fit
      std::size_t other;  // whose events to fit with them; == start for none
    };
    std::vector<Task> tasks;
    for (std::size_t a = 0; a < chosen.size(); ++a) {
      if (members[a].size() > 0 && !fitted_.contains({chosen[a], members[a].size()})) tasks.push_back({a, a});
      fitted_.insert({chosen[a], members[a].size()});
      for (std::size_t b = 0; b < chosen.size(); ++b) {
        const bool larger =
            members[a].size() > members[b].size() || (members[a].size() == members[b].size() && a < b);
        if (a == b || !larger || merging_loss(b, a) >= 6 * label_cost_) continue;
        if (paired_.insert({chosen[a], chosen[b]}).second) tasks.push_back({a, b});
      }
    }
    std::vector<MotionModel> models(tasks.size());
    std::vector<std::int32_t> objects;
    for (const Task& task : tasks) objects.push_back(objects_[chosen[task.start]]);
    std::vector<std::size_t> sizes;
    for (const auto& [start, other] : tasks)
      sizes.push_back(members[start].size() + (other == start ? 0 : members[other].size()));
    const std::vector<std::size_t> order = largest_first(sizes);
    pool_.for_each(tasks.size(), [&](std::size_t at, int worker) {
      const std::size_t i = order[at];
      const Task& task = tasks[i];
      Points cluster = members[task.start];
      if (task.other != task.start) append(cluster, members[task.other]);
      models[i] = refined(std::move(cluster), models_[chosen[task.start]], worker);
    });
    return {std::move(models), std::move(objects)};
  }

  std::size_t candidate_count() const { return models_.size(); }

  // Whether a candidate added after the first `count` was chosen.
  bool chosen_since(std::size_t count) const {
    return std::any_of(selection_.chosen.begin(), selection_.chosen.end(),
                       [&](std::size_t m) { return m >= count; });
  }

  // The models chosen last, and the tracked ones: whether their objects are still there is for the labels of
  // all events to say.
  ModelPool chosen_models() const {
    ModelPool pool;
    for (std::size_t m = 0; m < models_.size(); ++m) {
      const bool chosen = std::ranges::find(selection_.chosen, m) != selection_.chosen.end();
      // Standing still, the candidates given, and the tracked objects' motions were the first.
      const std::size_t first = 1 + options_.candidates.size() + 2 * options_.tracked.size();
      const bool given = objects_[m] != no_object && m < first;
      if (!chosen && !given) continue;
      pool.models.push_back(models_[m]);
      pool.object.push_back(objects_[m]);
    }
    return pool;
  }

 private:
  // A motion fitted to some points, at half the resolution.
  MotionModel refined(Points points, const MotionModel& from, int worker) {
    RefineOptions coarse = options_.refine;
    coarse.bounds.speed *= 0.5;
    coarse.max_iterations = 10;
    coarse.tolerance = 0.05;
    halve(points);
    const MotionModel start = scaled(convert_motion(from, richest(options_.kinds), frame_, plane_), 0.5);
    const Region region = fit_region(points.view(), start, half_frame_, halved(plane_));
    return scaled(refine_motion(points.view(), start, half_frame_, region, coarse,
                                contrast_workspaces_[static_cast<std::size_t>(worker)])
                      .model,
                  2);
  }

  std::size_t chosen_for(std::int32_t block) const {
    return static_cast<std::size_t>(selection_.of_block[static_cast<std::size_t>(block)]);
  }

  // The count that costs nothing, by the models chosen last, or by all before there is a choice: the largest
  // pixel for the published term, the 95 % quantile of the best of all models for ours (see data_term.hpp).
  int reference_of_chosen() const {
    std::vector<std::uint16_t> best(points_.size(), 0);
    const auto take = [&](const std::vector<std::uint16_t>& sharpness) {
      for (std::size_t k = 0; k < best.size(); ++k) best[k] = std::max(best[k], sharpness[k]);
    };
    if (selection_.chosen.empty()) {
      for (const auto& sharpness : sharpness_) take(sharpness);
    } else {
      for (const std::size_t m : selection_.chosen) take(sharpness_[m]);
    }
    if (options_.term == DataTerm::published) return *std::max_element(best.begin(), best.end());
    std::vector<std::uint32_t> histogram(count_levels, 0);
    for (const std::uint16_t count : best) ++histogram[count];
    std::size_t above = 0;
    int level = count_levels - 1;
    for (; level > 0; --level) {
      above += histogram[static_cast<std::size_t>(level)];
      if (20 * above >= best.size()) break;
    }
    return level;
  }

  std::vector<std::uint8_t> event_costs(int reference) const {
    std::vector<std::uint8_t> costs(count_levels);
    for (int count = 0; count < count_levels; ++count) {
      costs[static_cast<std::size_t>(count)] = static_cast<std::uint8_t>(
          std::lround(event_cost(options_.term, static_cast<float>(count), static_cast<float>(reference))));
    }
    return costs;
  }

  // What explaining the blocks of chosen model `from` by chosen model `to` would add to the data cost.
  std::int64_t merging_loss(std::size_t from, std::size_t to) const {
    std::int64_t loss = 0;
    for (std::size_t b = 0; b < grid_.count(); ++b) {
      if (chosen_for(static_cast<std::int32_t>(b)) != from) continue;
      loss += costs_[selection_.chosen[to]][b] - costs_[selection_.chosen[from]][b];
    }
    return loss;
  }

  static void append(Points& to, const Points& from) {
    to.x.insert(to.x.end(), from.x.begin(), from.x.end());
    to.y.insert(to.y.end(), from.y.begin(), from.y.end());
    to.dt.insert(to.dt.end(), from.dt.begin(), from.dt.end());
    to.sign.insert(to.sign.end(), from.sign.begin(), from.sign.end());
  }

  const Sample sample_;
  const Points& points_;
  const WarpFrame& frame_;
  const WarpFrame half_frame_;
  const Region plane_;
  const PoolOptions& options_;
  ThreadPool& pool_;
  const std::int64_t label_cost_;
  const BlockGrid grid_;
  const MotionDoubt doubt_;
  std::vector<CountWorkspace> count_workspaces_;
  std::vector<ContrastWorkspace> contrast_workspaces_;
  std::vector<MotionModel> models_;
  std::vector<std::int32_t> objects_;                  // per model
  std::vector<std::int64_t> label_costs_;              // per model
  std::vector<std::vector<std::uint16_t>> sharpness_;  // per model, per point
  std::vector<std::vector<std::int32_t>> doubts_;      // per model, per block
  std::vector<std::uint8_t> cost_of_;                  // an event, by its sharpness
  std::vector<std::vector<std::int32_t>> costs_;       // per model, per block
  Selection selection_;
  std::set<std::pair<std::size_t, std::size_t>>
      fitted_;  // candidates refitted, with the number of their events
  std::set<std::pair<std::size_t, std::size_t>> paired_;  // pairs of candidates fitted together
};

}  // namespace

ModelPool make_model_pool(const PointView& points, std::span<const std::uint8_t> positive,
                          const WarpFrame& frame, Region plane, const PoolOptions& options,
                          ThreadPool& pool) {
  if (points.size() == 0) return {{make_motion(richest(options.kinds))}, {no_object}};
  PoolSearch search(points, positive, frame, plane, options, pool);
  search.add(std::vector<MotionModel>{Translation{}});
  search.add(options.candidates);
  search.add_tracked(options.tracked);
  const auto tiles = overlapping_tiles(plane, options.tile);
  if (options.candidates.empty() && options.tracked.empty()) {
    auto regions = sub_volumes(plane, options.bracket_row, options.bracket_col);
    regions.insert(regions.end(), tiles.begin(), tiles.end());
    search.add(propose_translations(points, positive, regions, plane, options, pool));
  }
  search.choose();
  // What is small, or new since the last window, shows where the others are taken away.
  PoolOptions births = options;
  births.search.max_lags = 2;
  births.max_candidates = 24;
  const Sample rest = search.unexplained();
  auto small = overlapping_tiles(plane, options.tile / 2);
  small.insert(small.end(), tiles.begin(), tiles.end());
  search.add(propose_translations(rest.points.view(), rest.positive, small, plane, births, pool));
  search.choose();
  // Coarse candidates stay in the race: better models free blocks that others explain.
  for (int round = 0; round < options.max_rounds; ++round) {
    const std::size_t before = search.candidate_count();
    search.add(search.refits());
    search.choose();
    if (search.candidate_count() == before || !search.chosen_since(before)) break;
  }
  ModelPool chosen = search.chosen_models();
  const MotionKind kind = richest(options.kinds);
  for (MotionModel& model : chosen.models) model = convert_motion(model, kind, frame, plane);
  return chosen;
}

}  // namespace emseg
