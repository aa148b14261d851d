#include "labeling_problem.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "checked_sum.hpp"

namespace emseg {
namespace {

[[noreturn]] void fail(const std::string& what) { throw std::invalid_argument(what); }

// "name[index] is value", the beginning of every message about one entry.
template <typename Index, typename Value>
std::string entry(const char* name, Index index, Value value) {
  return std::string(name) + "[" + std::to_string(index) + "] is " + std::to_string(value);
}

template <typename Cost>
void check_shapes(const BasicLabelingProblem<Cost>& problem) {
  constexpr auto kMax32 = static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max());
  if (problem.label_count < 1) {
    fail("the problem has " + std::to_string(problem.label_count) + " labels, expected at least 1");
  }
  const std::size_t sites = problem.site_count();
  const std::size_t edges = problem.indices.size();
  const auto labels = static_cast<std::size_t>(problem.label_count);
  if (sites + labels > kMax32 || edges > kMax32 / 2) {
    fail("the problem has " + std::to_string(sites) + " sites and " + std::to_string(edges) +
         " edges, expected less than 2^31 sites and labels and less than 2^30 edges");
  }
  if (problem.unary.size() != sites * labels) {
    fail("unary has " + std::to_string(problem.unary.size()) + " entries, expected " +
         std::to_string(sites * labels) + " for " + std::to_string(sites) + " sites and " +
         std::to_string(labels) + " labels");
  }
  if (problem.weight.size() != 1 && problem.weight.size() != edges) {
    fail("weight has " + std::to_string(problem.weight.size()) + " entries, expected 1 or " +
         std::to_string(edges) + ", one per edge");
  }
  if (problem.label_cost.size() != 1 && problem.label_cost.size() != labels) {
    fail("label_cost has " + std::to_string(problem.label_cost.size()) + " entries, expected 1 or " +
         std::to_string(labels) + ", one per label");
  }
}

template <typename Cost>
void check_rows(const BasicLabelingProblem<Cost>& problem) {
  const std::size_t sites = problem.site_count();
  const auto edges = static_cast<std::int64_t>(problem.indices.size());
  if (sites == 0) {
    if (edges != 0) fail("there are " + std::to_string(edges) + " edges but no sites");
    return;
  }
  if (problem.indptr[0] != 0) fail(entry("indptr", 0, problem.indptr[0]) + ", expected 0");
  if (problem.indptr[sites] != edges) {
    fail(entry("indptr", sites, problem.indptr[sites]) + ", expected the number of edges, " +
         std::to_string(edges));
  }
  for (std::size_t i = 0; i < sites; ++i) {
    if (problem.indptr[i + 1] < problem.indptr[i]) {
      fail(entry("indptr", i + 1, problem.indptr[i + 1]) + ", expected at least its predecessor's " +
           std::to_string(problem.indptr[i]));
    }
  }
  for (std::size_t e = 0; e < problem.indices.size(); ++e) {
    if (problem.indices[e] < 0 || static_cast<std::size_t>(problem.indices[e]) >= sites) {
      fail(entry("indices", e, problem.indices[e]) + ", expected a site in 0.." + std::to_string(sites - 1));
    }
  }
}

template <typename Values>
void check_not_negative(const char* name, const Values& values) {
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (values[k] < 0) fail(entry(name, k, values[k]) + ", expected at least 0");
  }
}

}  // namespace

template <typename Cost>
std::int64_t check_problem(const BasicLabelingProblem<Cost>& problem) {
  check_shapes(problem);
  check_rows(problem);
  check_not_negative("weight", problem.weight);
  check_not_negative("label_cost", problem.label_cost);

  // The energy's parts, each at its largest: no labelling exceeds the total, in either sign.
  CheckedSum total("the largest energy of the problem");
  Cost least = 0;
  Cost most = 0;
  for (const Cost cost : problem.unary) {
    least = std::min(least, cost);
    most = std::max(most, cost);
  }
  if (least == std::numeric_limits<std::int64_t>::min())
    fail("unary holds -2^63, expected at most 2^62 in magnitude");
  const std::int64_t sites = static_cast<std::int64_t>(problem.site_count());
  CheckedSum range("the range of the data costs");
  range.add(most);
  range.add(-static_cast<std::int64_t>(least));
  total.add_product(sites, range.total());

  std::vector<std::int64_t> weight_at(problem.site_count(), 0);
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  if (stride == 0) {
    total.add_product(static_cast<std::int64_t>(problem.indices.size()), problem.weight[0]);
  } else {
    for (const Cost weight : problem.weight) total.add(weight);
  }
  for (std::size_t i = 0; i < problem.site_count(); ++i) {
    for (auto e = static_cast<std::size_t>(problem.indptr[i]);
         e < static_cast<std::size_t>(problem.indptr[i + 1]); ++e) {
      const auto j = static_cast<std::size_t>(problem.indices[e]);
      if (i == j) continue;
      weight_at[i] += problem.weight[e * stride];
      weight_at[j] += problem.weight[e * stride];
    }
  }
  if (problem.label_cost.size() == 1) {
    total.add_product(problem.label_count, problem.label_cost[0]);
  } else {
    for (const std::int64_t cost : problem.label_cost) total.add(cost);
  }

  CheckedSum widest("the largest capacity of a move");
  widest.add(range.total());
  widest.add_product(2, weight_at.empty() ? 0 : *std::max_element(weight_at.begin(), weight_at.end()));
  return widest.total();
}

template <typename Cost>
void check_labels(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels) {
  if (labels.size() != problem.site_count()) {
    fail("labels have " + std::to_string(labels.size()) + " entries, expected " +
         std::to_string(problem.site_count()) + ", one per site");
  }
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] < 0 || labels[i] >= problem.label_count) {
      fail(entry("labels", i, labels[i]) + ", expected 0.." + std::to_string(problem.label_count - 1));
    }
  }
}

template <typename Cost>
std::int64_t evaluate(const BasicLabelingProblem<Cost>& problem, std::span<const std::int32_t> labels) {
  const auto label_count = static_cast<std::size_t>(problem.label_count);
  const std::size_t stride = problem.weight.size() == 1 ? 0 : 1;
  std::vector<bool> used(label_count, false);
  std::int64_t energy = 0;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const auto own = static_cast<std::size_t>(labels[i]);
    used[own] = true;
    energy += problem.unary[i * label_count + own];
    for (auto e = static_cast<std::size_t>(problem.indptr[i]);
         e < static_cast<std::size_t>(problem.indptr[i + 1]); ++e) {
      if (labels[static_cast<std::size_t>(problem.indices[e])] != labels[i])
        energy += problem.weight[e * stride];
    }
  }
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    if (used[static_cast<std::size_t>(l)]) energy += problem.cost_of_label(l);
  }
  return energy;
}

template std::int64_t check_problem(const LabelingProblem&);
template std::int64_t check_problem(const WideLabelingProblem&);
template void check_labels(const LabelingProblem&, std::span<const std::int32_t>);
template void check_labels(const WideLabelingProblem&, std::span<const std::int32_t>);
template std::int64_t evaluate(const LabelingProblem&, std::span<const std::int32_t>);
template std::int64_t evaluate(const WideLabelingProblem&, std::span<const std::int32_t>);

}  // namespace emseg
