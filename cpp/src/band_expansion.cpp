#include "emseg/band_expansion.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "block_labels.hpp"
#include "expansion_moves.hpp"
#include "pixel_blocks.hpp"
#include "window_labeling.hpp"

namespace emseg {
namespace {

// Edges {u, v} by their ends u, in compressed rows.
template <typename Cost>
void set_rows(std::span<const std::pair<std::int32_t, std::int32_t>> edges, Part<Cost>& part) {
  part.indptr.assign(part.labels.size() + 2,
                     0);  // filled one place late, so that scattering leaves the starts
  for (const auto& [u, v] : edges) ++part.indptr[u + 2];
  for (std::size_t k = 2; k < part.indptr.size(); ++k) part.indptr[k] += part.indptr[k - 1];
  part.indices.resize(edges.size());
  for (const auto& [u, v] : edges) part.indices[part.indptr[u + 1]++] = v;
  part.indptr.pop_back();
}

void require_at_least(const char* name, double value, double least) {
  if (!(value >= least)) {
    throw std::invalid_argument(std::string(name) + " is " + std::to_string(value) + ", expected at least " +
                                std::to_string(static_cast<int>(least)));
  }
}

const BandOptions& checked(const BandOptions& options) {
  require_at_least("block_side", options.block_side, 1);
  require_at_least("hops", options.hops, 1);
  require_at_least("max_sweeps", options.max_sweeps, 0);
  require_at_least("least_gain", options.least_gain, 0);
  require_at_least("max_bands", options.max_bands, 0);
  require_at_least("lenient_smoothness", options.lenient_smoothness, 0);
  return options;
}

}  // namespace

class BandExpansion::Levels {
 public:
  Levels(const PixelGraph& graph, ExpansionWorkspace& workspace, const BandOptions& options)
      : graph_(graph),
        workspace_(workspace),
        options_(checked(options)),
        blocks_(make_pixel_blocks(graph, options_.block_side)),
        node_(graph.pixels.size(), kFixed) {}

  ExpansionResult checked_minimise(const WindowLabeling& problem, std::span<const std::int32_t> initial) {
    widest_ = check_window_labeling(graph_, problem);
    if (!initial.empty()) check_window_labels(graph_, problem, initial);
    return widest_ <= std::numeric_limits<std::int32_t>::max() ? minimise<std::int32_t>(problem, initial)
                                                               : minimise<std::int64_t>(problem, initial);
  }

 private:
  template <typename Cost>
  ExpansionResult minimise(const WindowLabeling& problem, std::span<const std::int32_t> initial);
  void choose_candidates(const WindowLabeling& problem, const BlockLabels& coarse,
                         std::span<const std::int32_t> initial);
  std::vector<std::int32_t> as_candidates(std::span<const std::int32_t> labels) const;
  std::vector<std::int32_t> original_labels() const;
  void begin_labels(std::span<const std::int32_t> block_label);
  void begin_labels_from(std::span<const std::int32_t> initial);
  void mark_block_rims(std::span<const std::int32_t> block_label, std::vector<std::uint8_t>& marked) const;
  void add_blocks_to_band(const std::vector<std::uint8_t>& marked);
  void band_of_boundaries();
  bool band_of_changes();
  void widen_band(int hops);
  template <typename Cost>
  std::int64_t solve(Part<Cost>& part, std::int64_t least_gain);
  template <typename Cost>
  std::int64_t solve_pixels(const WindowLabeling& problem, std::int64_t least_gain);
  template <typename Cost>
  std::int64_t solve_events(const WindowLabeling& problem, std::int64_t least_gain);
  template <typename Cost>
  void set_label_costs(const WindowLabeling& problem, Part<Cost>& part) const;
  bool is_boundary(std::int32_t pixel) const;
  void allow_labels_of_blocks(std::span<const std::int32_t> before, std::span<const std::int32_t> after);
  void allow_labels_nearby(std::span<const std::int32_t> of_block);

  static constexpr std::size_t kMaskBits = 64;
  static std::uint64_t bit(std::int32_t label) { return std::uint64_t{1} << label; }

  static constexpr std::int32_t kFixed = -1;  // no node of the part
  static constexpr std::int32_t kMixed = -1;  // no one label

  const PixelGraph& graph_;
  ExpansionWorkspace& workspace_;
  const BandOptions options_;
  const PixelBlocks blocks_;

  std::int64_t widest_ = 0;                // capacity that a move can meet
  std::vector<std::int32_t> candidates_;   // labels that take part below the blocks
  std::vector<std::int32_t> position_;     // of every label in candidates_
  std::vector<std::int32_t> labels_;       // events: positions in candidates_
  std::vector<std::int32_t> pixel_label_;  // that all events of a pixel have, or kMixed
  std::vector<std::int64_t> used_;         // per candidate: its events
  std::vector<std::uint64_t> allowed_;     // per pixel: the labels to be tried; empty: all
  std::vector<std::int32_t> node_;         // per pixel: its first node in the part, or kFixed
  std::vector<std::int32_t> band_;         // pixels of the part, ascending
  std::vector<std::int32_t> changed_;      // pixels of the band that the last part changed
};

// ---- labels and bands

void BandExpansion::Levels::mark_block_rims(std::span<const std::int32_t> block_label,
                                            std::vector<std::uint8_t>& marked) const {
  for (std::int32_t b = 0; b < blocks_.count; ++b) {
    for (std::int64_t e = blocks_.indptr[b]; e < blocks_.indptr[b + 1]; ++e) {
      const std::int32_t c = blocks_.indices[e];
      if (block_label[b] != block_label[c]) marked[b] = marked[c] = 1;
    }
  }
}

void BandExpansion::Levels::begin_labels(std::span<const std::int32_t> block_label) {
  pixel_label_.resize(graph_.pixels.size());
  labels_.resize(graph_.event_count());
  for (std::size_t p = 0; p < pixel_label_.size(); ++p) pixel_label_[p] = block_label[blocks_.of_pixel[p]];
  for (std::size_t k = 0; k < labels_.size(); ++k) labels_[k] = block_label[blocks_.of_event[k]];
}

void BandExpansion::Levels::begin_labels_from(std::span<const std::int32_t> initial) {
  labels_.assign(initial.begin(), initial.end());
  pixel_label_.resize(graph_.pixels.size());
  for (std::int32_t p = 0; p < graph_.pixel_count(); ++p) {
    const auto own = graph_.events_of(p);
    const std::int32_t label = labels_[own.front()];
    const bool uniform =
        std::all_of(own.begin(), own.end(), [&](std::int32_t k) { return labels_[k] == label; });
    pixel_label_[p] = uniform ? label : kMixed;
  }
}

void BandExpansion::Levels::add_blocks_to_band(const std::vector<std::uint8_t>& marked) {
  std::vector<std::uint8_t> inside(graph_.pixels.size(), 0);
  for (const std::int32_t p : band_) inside[p] = 1;
  for (std::int32_t p = 0; p < graph_.pixel_count(); ++p) {
    if (inside[p] == 0 && marked[blocks_.of_pixel[p]] != 0) band_.push_back(p);
  }
  std::sort(band_.begin(), band_.end());
}

bool BandExpansion::Levels::is_boundary(std::int32_t pixel) const {
  const std::int32_t label = pixel_label_[pixel];
  if (label == kMixed) return true;
  const auto neighbours = graph_.neighbours_of(pixel);
  return std::any_of(neighbours.begin(), neighbours.end(),
                     [&](std::int32_t q) { return pixel_label_[q] != label; });
}

void BandExpansion::Levels::band_of_boundaries() {
  band_.clear();
  for (std::int32_t p = 0; p < graph_.pixel_count(); ++p) {
    if (is_boundary(p)) band_.push_back(p);
  }
  widen_band(options_.hops - 1);
}

// Around what the last part changed at the end of its band; false if it changed nothing there.
bool BandExpansion::Levels::band_of_changes() {
  std::vector<std::uint8_t> inside(graph_.pixels.size(), 0);
  for (const std::int32_t p : band_) inside[p] = 1;
  band_.clear();
  for (const std::int32_t p : changed_) {
    const auto neighbours = graph_.neighbours_of(p);
    if (std::any_of(neighbours.begin(), neighbours.end(), [&](std::int32_t q) { return inside[q] == 0; })) {
      band_.push_back(p);
    }
  }
  widen_band(options_.hops);
  return !band_.empty();
}

void BandExpansion::Levels::widen_band(int hops) {
  std::vector<std::uint8_t> inside(graph_.pixels.size(), 0);
  for (const std::int32_t p : band_) inside[p] = 1;
  std::size_t next = 0;
  for (int hop = 0; hop < hops; ++hop) {
    for (const std::size_t end = band_.size(); next < end; ++next) {
      for (const std::int32_t q : graph_.neighbours_of(band_[next])) {
        if (std::exchange(inside[q], 1) == 0) band_.push_back(q);
      }
    }
  }
  std::sort(band_.begin(), band_.end());
}

// Those of the pixel's block and of the blocks around it.
void BandExpansion::Levels::allow_labels_of_blocks(std::span<const std::int32_t> before,
                                                   std::span<const std::int32_t> after) {
  allowed_.clear();
  if (candidates_.size() > kMaskBits) return;
  std::vector<std::uint64_t> own(blocks_.count), wide;
  for (std::size_t b = 0; b < own.size(); ++b) own[b] = bit(before[b]) | bit(after[b]);
  wide = own;
  for (std::int32_t b = 0; b < blocks_.count; ++b) {
    for (std::int64_t e = blocks_.indptr[b]; e < blocks_.indptr[b + 1]; ++e) {
      const std::int32_t c = blocks_.indices[e];
      wide[b] |= own[c];
      wide[c] |= own[b];
    }
  }
  allowed_.resize(graph_.pixels.size());
  for (const std::int32_t p : band_) allowed_[p] = wide[blocks_.of_pixel[p]];
}

// Those of the events as far away as the band is wide, and, if given, that of the pixel's block.
void BandExpansion::Levels::allow_labels_nearby(std::span<const std::int32_t> of_block) {
  allowed_.clear();
  if (candidates_.size() > kMaskBits) return;
  allowed_.resize(graph_.pixels.size());
  for (std::int32_t p = 0; p < graph_.pixel_count(); ++p) {
    if (pixel_label_[p] != kMixed) {
      allowed_[p] = bit(pixel_label_[p]);
    } else {
      allowed_[p] = 0;
      for (const std::int32_t k : graph_.events_of(p)) allowed_[p] |= bit(labels_[k]);
    }
  }
  std::vector<std::uint64_t> wide(band_.size());
  for (int hop = 0; hop < options_.hops; ++hop) {
    for (std::size_t v = 0; v < band_.size(); ++v) {
      wide[v] = allowed_[band_[v]];
      for (const std::int32_t q : graph_.neighbours_of(band_[v])) wide[v] |= allowed_[q];
    }
    for (std::size_t v = 0; v < band_.size(); ++v) allowed_[band_[v]] = wide[v];
  }
  if (of_block.empty()) return;
  for (const std::int32_t p : band_) allowed_[p] |= bit(of_block[blocks_.of_pixel[p]]);
}

// ---- parts

template <typename Cost>
std::int64_t BandExpansion::Levels::solve(Part<Cost>& part, std::int64_t least_gain) {
  std::int64_t gain = 0;
  for (const std::int64_t of_sweep : expand_in_turn(part.view(), options_.max_sweeps, widest_, workspace_,
                                                    part.labels, part.allowed, Expanded::all, least_gain)) {
    gain += of_sweep;
  }
  return gain;
}

// used_ counts the events outside the part.
template <typename Cost>
void BandExpansion::Levels::set_label_costs(const WindowLabeling& problem, Part<Cost>& part) const {
  for (std::size_t l = 0; l < candidates_.size(); ++l) {
    part.label_cost.push_back(used_[l] > 0 ? 0
                                           : problem.cost_of_label(static_cast<std::size_t>(candidates_[l])));
  }
}

// Every pixel of the band is a node; there are no mixed pixels.
template <typename Cost>
std::int64_t BandExpansion::Levels::solve_pixels(const WindowLabeling& problem, std::int64_t least_gain) {
  const std::size_t label_count = candidates_.size();
  Part<Cost> part;
  part.unary.resize(band_.size() * label_count);
  for (std::size_t v = 0; v < band_.size(); ++v) node_[band_[v]] = static_cast<std::int32_t>(v);
  part.indptr.push_back(0);
  for (std::size_t v = 0; v < band_.size(); ++v) {
    const std::int32_t p = band_[v];
    const auto own = graph_.events_of(p);
    part.labels.push_back(pixel_label_[p]);
    if (!allowed_.empty()) part.allowed.push_back(allowed_[p]);
    used_[pixel_label_[p]] -= static_cast<std::int64_t>(own.size());
    Cost* row = part.unary.data() + v * label_count;
    for (std::size_t l = 0; l < label_count; ++l) {
      const std::span<const std::int32_t> costs = problem.unary[candidates_[l]];
      for (const std::int32_t k : own) row[l] += costs[k];
    }
    for (const std::int32_t q : graph_.neighbours_of(p)) {
      if (node_[q] != kFixed && q < p) continue;
      const Cost weight =
          static_cast<Cost>(problem.smooth_cost) * count_event_edges(own, graph_.events_of(q));
      if (node_[q] == kFixed) {
        row[pixel_label_[q]] -= weight;
      } else {
        part.indices.push_back(node_[q]);
        part.weight.push_back(weight);
      }
    }
    part.indptr.push_back(static_cast<std::int64_t>(part.indices.size()));
  }
  set_label_costs(problem, part);
  const std::int64_t gain = solve(part, least_gain);

  changed_.clear();
  for (std::size_t v = 0; v < band_.size(); ++v) {
    const std::int32_t p = band_[v];
    const auto own = graph_.events_of(p);
    node_[p] = kFixed;
    used_[part.labels[v]] += static_cast<std::int64_t>(own.size());
    if (pixel_label_[p] == part.labels[v]) continue;
    changed_.push_back(p);
    pixel_label_[p] = part.labels[v];
    for (const std::int32_t k : own) labels_[k] = part.labels[v];
  }
  return gain;
}

// Every event of the band is a node.
template <typename Cost>
std::int64_t BandExpansion::Levels::solve_events(const WindowLabeling& problem, std::int64_t least_gain) {
  const std::size_t label_count = candidates_.size();
  std::int32_t count = 0;
  for (const std::int32_t p : band_) {
    node_[p] = count;
    count += static_cast<std::int32_t>(graph_.events_of(p).size());
  }
  Part<Cost> part;
  part.unary.resize(static_cast<std::size_t>(count) * label_count);
  part.labels.reserve(count);
  part.weight.assign(1, problem.smooth_cost);
  std::vector<std::pair<std::int32_t, std::int32_t>> edges;
  for (const std::int32_t p : band_) {
    const auto own = graph_.events_of(p);
    const std::int32_t first = node_[p];
    Cost* rows = part.unary.data() + static_cast<std::size_t>(first) * label_count;
    for (std::size_t i = 0; i < own.size(); ++i) {
      const std::int32_t k = own[i];
      part.labels.push_back(labels_[k]);
      if (!allowed_.empty()) part.allowed.push_back(allowed_[p]);
      --used_[labels_[k]];
      if (i > 0) edges.emplace_back(first + i - 1, first + i);
    }
    for (std::size_t l = 0; l < label_count; ++l) {
      const std::span<const std::int32_t> costs = problem.unary[candidates_[l]];
      for (std::size_t i = 0; i < own.size(); ++i) rows[i * label_count + l] += costs[own[i]];
    }
    for (const std::int32_t q : graph_.neighbours_of(p)) {
      const auto other = graph_.events_of(q);
      if (node_[q] == kFixed) {
        visit_event_edges(own, other, [&](std::size_t i, std::size_t j) {
          rows[i * label_count + labels_[other[j]]] -= problem.smooth_cost;
        });
      } else if (q > p) {
        visit_event_edges(own, other,
                          [&](std::size_t i, std::size_t j) { edges.emplace_back(first + i, node_[q] + j); });
      }
    }
  }
  set_rows(edges, part);
  set_label_costs(problem, part);
  const std::int64_t gain = solve(part, least_gain);

  changed_.clear();
  for (const std::int32_t p : band_) {
    const auto own = graph_.events_of(p);
    const auto found = part.labels.begin() + std::exchange(node_[p], kFixed);
    bool changed = false;
    bool uniform = true;
    for (std::size_t i = 0; i < own.size(); ++i) {
      const std::int32_t label = found[static_cast<std::ptrdiff_t>(i)];
      ++used_[label];
      changed |= std::exchange(labels_[own[i]], label) != label;
      uniform &= label == *found;
    }
    pixel_label_[p] = uniform ? *found : kMixed;
    if (changed) changed_.push_back(p);
  }
  return gain;
}

// ---- all levels

// Labels that some block or event has.
void BandExpansion::Levels::choose_candidates(const WindowLabeling& problem, const BlockLabels& coarse,
                                              std::span<const std::int32_t> initial) {
  candidates_.clear();
  position_.assign(problem.label_count(), -1);
  for (const std::span<const std::int32_t> labels :
       {std::span(coarse.first), std::span(coarse.second), initial}) {
    for (const std::int32_t label : labels) position_[label] = 0;
  }
  for (std::size_t l = 0; l < position_.size(); ++l) {
    if (position_[l] != 0) continue;
    position_[l] = static_cast<std::int32_t>(candidates_.size());
    candidates_.push_back(static_cast<std::int32_t>(l));
  }
}

std::vector<std::int32_t> BandExpansion::Levels::as_candidates(std::span<const std::int32_t> labels) const {
  std::vector<std::int32_t> result(labels.size());
  for (std::size_t k = 0; k < labels.size(); ++k) result[k] = position_[labels[k]];
  return result;
}

std::vector<std::int32_t> BandExpansion::Levels::original_labels() const {
  std::vector<std::int32_t> result(labels_.size());
  for (std::size_t k = 0; k < labels_.size(); ++k) result[k] = candidates_[labels_[k]];
  return result;
}

template <typename Cost>
ExpansionResult BandExpansion::Levels::minimise(const WindowLabeling& problem,
                                                std::span<const std::int32_t> initial) {
  const bool cold = initial.empty();
  MergedLabels start;
  if (!cold) start = merge_window_labels(graph_, problem, initial);
  const BlockLabels coarse =
      label_blocks<Cost>(blocks_, problem, start.labels, options_, widest_, workspace_);
  choose_candidates(problem, coarse, start.labels);
  const std::vector<std::int32_t> first = as_candidates(coarse.first);
  const std::vector<std::int32_t> second = as_candidates(coarse.second);
  std::vector<std::uint8_t> marked(first.size());  // blocks at which finer levels look
  for (std::size_t b = 0; b < marked.size(); ++b) marked[b] = first[b] != second[b] ? 1 : 0;

  if (cold) {
    begin_labels(second);
  } else {
    begin_labels_from(as_candidates(start.labels));
  }
  used_.assign(candidates_.size(), 0);
  for (const std::int32_t label : labels_) ++used_[label];
  ExpansionResult result;
  result.energy = cold ? evaluate_window(graph_, problem, original_labels()) : start.energy;
  result.energy_trace.push_back(result.energy);
  result.energy -= start.gain;
  const auto least_gain =
      static_cast<std::int64_t>(options_.least_gain * std::abs(static_cast<double>(result.energy)));

  if (cold) {
    mark_block_rims(first, marked);
    mark_block_rims(second, marked);
    band_.clear();
    add_blocks_to_band(marked);
    allow_labels_of_blocks(first, second);
    result.energy -= solve_pixels<Cost>(problem, least_gain);
    band_of_boundaries();
    allow_labels_nearby({});
  } else {
    band_of_boundaries();
    add_blocks_to_band(marked);
    allow_labels_nearby(second);
  }
  for (int k = 0; k < options_.max_bands && !band_.empty(); ++k) {
    result.energy -= solve_events<Cost>(problem, least_gain);
    if (!band_of_changes()) break;
    allow_labels_nearby({});
  }
  result.labels = original_labels();
  result.energy_trace.push_back(result.energy);
  assert(result.energy == evaluate_window(graph_, problem, result.labels));
  return result;
}

BandExpansion::BandExpansion(const PixelGraph& graph, ExpansionWorkspace& workspace,
                             const BandOptions& options)
    : levels_(std::make_unique<Levels>(graph, workspace, options)) {}
BandExpansion::~BandExpansion() = default;
BandExpansion::BandExpansion(BandExpansion&&) noexcept = default;
BandExpansion& BandExpansion::operator=(BandExpansion&&) noexcept = default;

ExpansionResult BandExpansion::minimise(const WindowLabeling& problem,
                                        std::span<const std::int32_t> initial) {
  return levels_->checked_minimise(problem, initial);
}

}  // namespace emseg
