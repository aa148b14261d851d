// The coarsest level: expansion on blocks of pixels.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "emseg/band_expansion.hpp"
#include "expansion_moves.hpp"
#include "label_merging.hpp"
#include "pixel_blocks.hpp"

namespace emseg {

// A labelling problem over nodes that stand for groups of events, while all other events keep their labels:
// edges to those are part of the data costs, and labels that they use cost nothing.
template <typename Cost>
struct Part {
  std::vector<Cost> unary;  // nodes * labels
  std::vector<std::int64_t> indptr;
  std::vector<std::int32_t> indices;
  std::vector<Cost> weight;  // edges, or one for all
  std::vector<std::int64_t> label_cost;
  std::vector<std::int32_t> labels;    // nodes
  std::vector<std::uint64_t> allowed;  // nodes: a bit for each label that it may take; empty: any

  BasicLabelingProblem<Cost> view() const {
    return {static_cast<std::int32_t>(label_cost.size()), unary, indptr, indices, weight, label_cost};
  }
};

// Two labellings of the blocks: where they differ, finer levels decide.
struct BlockLabels {
  std::vector<std::int32_t> first;
  std::vector<std::int32_t> second;
};

template <typename Cost>
Part<Cost> block_problem(const PixelBlocks& blocks, const WindowLabeling& problem) {
  const std::size_t label_count = problem.label_count();
  const auto block_count = static_cast<std::size_t>(blocks.count);
  Part<Cost> part;
  part.unary.resize(block_count * label_count);
  std::vector<Cost> sum(block_count);
  for (std::size_t l = 0; l < label_count; ++l) {
    std::fill(sum.begin(), sum.end(), 0);
    const std::span<const std::int32_t> costs = problem.unary[l];
    for (std::size_t k = 0; k < costs.size(); ++k) sum[blocks.of_event[k]] += costs[k];
    for (std::size_t b = 0; b < block_count; ++b) part.unary[b * label_count + l] = sum[b];
    part.label_cost.push_back(problem.cost_of_label(l));
  }
  part.indptr = blocks.indptr;
  part.indices = blocks.indices;
  return part;
}

template <typename Cost>
void set_block_weights(const PixelBlocks& blocks, double unit, Part<Cost>& part) {
  part.weight.resize(part.indices.size());
  for (std::size_t e = 0; e < part.weight.size(); ++e) {
    part.weight[e] = static_cast<Cost>(unit * blocks.edge_count[e]);
  }
}

// The label of most events of each block; of equals, the first.
inline std::vector<std::int32_t> block_majorities(const PixelBlocks& blocks,
                                                  std::span<const std::int32_t> labels, std::size_t count) {
  std::vector<std::int32_t> votes(static_cast<std::size_t>(blocks.count) * count, 0);
  for (std::size_t k = 0; k < labels.size(); ++k) ++votes[blocks.of_event[k] * count + labels[k]];
  std::vector<std::int32_t> majority(blocks.count);
  for (std::size_t b = 0; b < majority.size(); ++b) {
    const auto row = votes.begin() + static_cast<std::ptrdiff_t>(b * count);
    majority[b] =
        static_cast<std::int32_t>(std::max_element(row, row + static_cast<std::ptrdiff_t>(count)) - row);
  }
  return majority;
}

// Without initial labels, those of lenient and of full smoothness; else the initial labels' majorities, and
// what lenient smoothness makes of them.
template <typename Cost>
BlockLabels label_blocks(const PixelBlocks& blocks, const WindowLabeling& problem,
                         std::span<const std::int32_t> initial, const BandOptions& options,
                         std::int64_t widest, ExpansionWorkspace& workspace) {
  const std::size_t label_count = problem.label_count();
  Part<Cost> part = block_problem<Cost>(blocks, problem);
  const auto solve = [&](double share, Expanded expanded) {
    set_block_weights(blocks, share * problem.smooth_cost, part);
    merge_labels(part.view(), part.labels);
    expand_in_turn(part.view(), options.max_sweeps, widest, workspace, part.labels, {}, expanded);
  };
  if (!initial.empty()) {
    part.labels = block_majorities(blocks, initial, label_count);
    BlockLabels result{part.labels, {}};
    solve(options.lenient_smoothness, Expanded::all);
    result.second = std::move(part.labels);
    return result;
  }
  part.labels = cheapest_labels(part.view());
  solve(options.lenient_smoothness, Expanded::all);
  BlockLabels result{part.labels, {}};
  solve(1, Expanded::used);  // smoother labels are fewer
  result.second = std::move(part.labels);
  return result;
}

}  // namespace emseg
