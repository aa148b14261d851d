// A labelling problem with neighbouring sites merged into groups that take one label each.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "emseg/expansion.hpp"

namespace emseg {

// Its energy is that of the labellings that are constant in every group: minimising it first, where a move is
// an order cheaper, leaves only the groups' rims and the proof to the sites.  Edges stand in the row of their
// smaller end, as in an OrderedProblem.
class GroupedProblem {
 public:
  // Measured on windows of 30,000 events: 16 is as fast, 8 a fifth slower.
  static constexpr std::size_t kMostSites = 32;  // in a group

  template <typename Cost>
  explicit GroupedProblem(const BasicLabelingProblem<Cost>& problem);

  WideLabelingProblem view() const { return {label_count_, unary_, indptr_, indices_, weight_, label_cost_}; }

  // Labels of the sites, from those of the groups.
  std::vector<std::int32_t> spread(std::span<const std::int32_t> labels) const;

 private:
  template <typename Cost>
  void group_sites(const BasicLabelingProblem<Cost>& problem);
  template <typename Cost>
  void add_up_costs(const BasicLabelingProblem<Cost>& problem);
  template <typename Cost>
  void add_up_edges(const BasicLabelingProblem<Cost>& problem);
  std::size_t group_count() const { return site_begin_.size() - 1; }
  std::span<const std::int32_t> sites_of(std::size_t group) const {
    return std::span(sites_).subspan(site_begin_[group], site_begin_[group + 1] - site_begin_[group]);
  }

  std::int32_t label_count_;
  std::span<const std::int64_t> label_cost_;
  std::vector<std::int32_t> group_;      // of every site
  std::vector<std::int32_t> sites_;      // group by group
  std::vector<std::size_t> site_begin_;  // groups + 1: rows of sites_
  std::vector<std::int64_t> unary_;
  std::vector<std::int64_t> indptr_;
  std::vector<std::int32_t> indices_;
  std::vector<std::int64_t> weight_;
};

template <typename Cost>
GroupedProblem::GroupedProblem(const BasicLabelingProblem<Cost>& problem)
    : label_count_(problem.label_count), label_cost_(problem.label_cost) {
  group_sites(problem);
  add_up_costs(problem);
  add_up_edges(problem);
}

// Every group is grown, breadth first, from the first site that has none yet.
template <typename Cost>
void GroupedProblem::group_sites(const BasicLabelingProblem<Cost>& problem) {
  constexpr std::int32_t kNone = -1;
  const auto site_count = static_cast<std::int32_t>(problem.site_count());
  group_.assign(problem.site_count(), kNone);
  sites_.reserve(problem.site_count());
  site_begin_.assign(1, 0);
  for (std::int32_t seed = 0; seed < site_count; ++seed) {
    if (group_[seed] != kNone) continue;
    const auto group = static_cast<std::int32_t>(group_count());
    const std::size_t full = sites_.size() + kMostSites;
    group_[seed] = group;
    sites_.push_back(seed);
    for (std::size_t k = site_begin_.back(); k < sites_.size(); ++k) {
      const std::int32_t site = sites_[k];
      for (std::int64_t e = problem.indptr[site]; e < problem.indptr[site + 1] && sites_.size() < full; ++e) {
        const std::int32_t neighbour = problem.indices[e];
        if (group_[neighbour] != kNone) continue;
        group_[neighbour] = group;
        sites_.push_back(neighbour);
      }
    }
    site_begin_.push_back(sites_.size());
  }
}

template <typename Cost>
void GroupedProblem::add_up_costs(const BasicLabelingProblem<Cost>& problem) {
  const auto label_count = static_cast<std::size_t>(label_count_);
  unary_.assign(group_count() * label_count, 0);
  for (std::size_t site = 0; site < group_.size(); ++site) {
    const Cost* costs = problem.unary.data() + site * label_count;
    std::int64_t* sums = unary_.data() + static_cast<std::size_t>(group_[site]) * label_count;
    for (std::size_t l = 0; l < label_count; ++l) sums[l] += costs[l];
  }
}

template <typename Cost>
void GroupedProblem::add_up_edges(const BasicLabelingProblem<Cost>& problem) {
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  std::vector<std::size_t> last_edge(group_count(), 0);  // to a group, + 1; older ones are of other rows
  indptr_.assign(1, 0);
  // Sites are in an order in which a group's first site comes before the next group's, but not all its sites,
  // so that an edge can lead to an earlier group: it stays in the row at which it was found.
  for (std::size_t group = 0; group < group_count(); ++group) {
    const std::size_t row = indices_.size();
    for (const std::int32_t site : sites_of(group)) {
      for (std::int64_t e = problem.indptr[site]; e < problem.indptr[site + 1]; ++e) {
        const std::int32_t other = group_[problem.indices[e]];
        if (other == static_cast<std::int32_t>(group)) continue;
        const std::int64_t weight = problem.weight[static_cast<std::size_t>(e) * stride];
        if (last_edge[other] > row) {
          weight_[last_edge[other] - 1] += weight;
        } else {
          indices_.push_back(other);
          weight_.push_back(weight);
          last_edge[other] = indices_.size();
        }
      }
    }
    indptr_.push_back(static_cast<std::int64_t>(indices_.size()));
  }
}

inline std::vector<std::int32_t> GroupedProblem::spread(std::span<const std::int32_t> labels) const {
  std::vector<std::int32_t> result(group_.size());
  for (std::size_t site = 0; site < result.size(); ++site) result[site] = labels[group_[site]];
  return result;
}

}  // namespace emseg
