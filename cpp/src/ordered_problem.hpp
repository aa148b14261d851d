// A labelling problem with its sites in an order that the caches like.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "emseg/expansion.hpp"
#include "local_order.hpp"

namespace emseg {

// A copy of a checked problem: site k is the original's site order()[k], every edge stands in the row of its
// smaller end, and edges from a site to itself are left out.
template <typename Cost>
class OrderedProblem {
 public:
  explicit OrderedProblem(const BasicLabelingProblem<Cost>& original);

  BasicLabelingProblem<Cost> view() const {
    return {label_count_, unary_, indptr_, indices_, weight_, label_cost_};
  }
  std::span<const std::int32_t> order() const { return order_; }

  // Labels of the original's sites, in this problem's order and back.
  std::vector<std::int32_t> ordered(std::span<const std::int32_t> labels) const;
  std::vector<std::int32_t> original(std::span<const std::int32_t> labels) const;

 private:
  std::int32_t label_count_;
  std::span<const std::int64_t> label_cost_;
  std::vector<std::int32_t> order_;
  std::vector<Cost> unary_;
  std::vector<std::int64_t> indptr_;
  std::vector<std::int32_t> indices_;
  std::vector<Cost> weight_;
};

template <typename Cost>
OrderedProblem<Cost>::OrderedProblem(const BasicLabelingProblem<Cost>& original)
    : label_count_(original.label_count), label_cost_(original.label_cost) {
  const std::size_t site_count = original.site_count();
  const auto label_count = static_cast<std::size_t>(label_count_);
  std::vector<std::int32_t> tail(original.indices.size());
  for (std::size_t i = 0; i < site_count; ++i) {
    std::fill(tail.begin() + original.indptr[i], tail.begin() + original.indptr[i + 1],
              static_cast<std::int32_t>(i));
  }
  order_ = local_order(site_count, tail, original.indices);

  std::vector<std::int32_t> place(site_count);
  unary_.resize(original.unary.size());
  for (std::size_t k = 0; k < site_count; ++k) {
    const auto i = static_cast<std::size_t>(order_[k]);
    place[i] = static_cast<std::int32_t>(k);
    std::copy_n(original.unary.begin() + static_cast<std::ptrdiff_t>(i * label_count), label_count,
                unary_.begin() + static_cast<std::ptrdiff_t>(k * label_count));
  }

  // Rows are counted two places up, so that filling them leaves every row's begin in its own place.
  const bool one_weight = original.weight.size() == 1;
  indptr_.assign(site_count + 2, 0);
  auto ends = [&](std::size_t e) {
    return std::minmax(
        {place[static_cast<std::size_t>(tail[e])], place[static_cast<std::size_t>(original.indices[e])]});
  };
  for (std::size_t e = 0; e < tail.size(); ++e) {
    if (tail[e] != original.indices[e]) ++indptr_[static_cast<std::size_t>(ends(e).first) + 2];
  }
  for (std::size_t k = 2; k < indptr_.size(); ++k) indptr_[k] += indptr_[k - 1];
  indices_.resize(static_cast<std::size_t>(indptr_.back()));
  weight_.assign(one_weight ? 1 : indices_.size(), one_weight ? original.weight[0] : 0);
  for (std::size_t e = 0; e < tail.size(); ++e) {
    if (tail[e] == original.indices[e]) continue;
    const auto [low, high] = ends(e);
    const auto at = static_cast<std::size_t>(indptr_[static_cast<std::size_t>(low) + 1]++);
    indices_[at] = high;
    if (!one_weight) weight_[at] = original.weight[e];
  }
  indptr_.pop_back();
}

template <typename Cost>
std::vector<std::int32_t> OrderedProblem<Cost>::ordered(std::span<const std::int32_t> labels) const {
  std::vector<std::int32_t> result(labels.size());
  for (std::size_t k = 0; k < labels.size(); ++k) result[k] = labels[static_cast<std::size_t>(order_[k])];
  return result;
}

template <typename Cost>
std::vector<std::int32_t> OrderedProblem<Cost>::original(std::span<const std::int32_t> labels) const {
  std::vector<std::int32_t> result(labels.size());
  for (std::size_t k = 0; k < labels.size(); ++k) result[static_cast<std::size_t>(order_[k])] = labels[k];
  return result;
}

}  // namespace emseg
