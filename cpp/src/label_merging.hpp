// Whole labels in each other's place: what near copies of one motion come to, at the price of a few sums.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "emseg/expansion.hpp"

namespace emseg {

// Sums over a labelling, from which the energy of every merger follows: sites of one label all taking another,
// whether some site has that one already or none does.
class LabelTotals {
 public:
  explicit LabelTotals(std::size_t label_count)
      : count_(label_count),
        sites_(label_count, 0),
        data_(label_count * label_count, 0),
        cut_(label_count * label_count, 0) {}

  void add_site(std::int32_t own) { ++sites_[at(own)]; }
  // What sites of label `own` would cost by `other`; their own costs are those by `own`.
  void add_data(std::int32_t own, std::int32_t other, std::int64_t cost) { data_[at(own, other)] += cost; }
  // Of an edge between two labels.
  void add_cut(std::int32_t a, std::int32_t b, std::int64_t weight) {
    cut_[at(a, b)] += weight;
    cut_[at(b, a)] += weight;
  }

  // Of the labels as they were added.
  std::int64_t energy(const std::function<std::int64_t(std::size_t)>& cost_of_label) const {
    std::int64_t twice_cut = 0, sum = 0;
    for (std::size_t l = 0; l < count_; ++l) {
      if (sites_[l] > 0) sum += data_[l * count_ + l] + cost_of_label(l);
      for (std::size_t m = 0; m < count_; ++m) twice_cut += cut_[l * count_ + m];
    }
    return sum + twice_cut / 2;
  }

  struct Mergers {
    std::vector<std::int32_t> becomes;  // per label
    std::int64_t gain = 0;
  };

  // The merger that lowers the energy most, again and again until none does.
  Mergers merge(const std::function<std::int64_t(std::size_t)>& cost_of_label) {
    Mergers mergers;
    for (std::size_t l = 0; l < count_; ++l) mergers.becomes.push_back(static_cast<std::int32_t>(l));
    while (true) {
      std::int64_t most = 0;
      std::size_t from = 0, to = 0;
      for (std::size_t l = 0; l < count_; ++l) {
        if (sites_[l] == 0) continue;
        for (std::size_t m = 0; m < count_; ++m) {
          if (m == l) continue;
          const std::int64_t gain = data_[l * count_ + l] - data_[l * count_ + m] + cut_[l * count_ + m] +
                                    cost_of_label(l) - (sites_[m] > 0 ? 0 : cost_of_label(m));
          if (gain > most) most = gain, from = l, to = m;
        }
      }
      if (most == 0) return mergers;
      mergers.gain += most;
      put_in_place(from, to);
      for (std::int32_t& label : mergers.becomes) {
        if (at(label) == from) label = static_cast<std::int32_t>(to);
      }
    }
  }

 private:
  static std::size_t at(std::int32_t label) { return static_cast<std::size_t>(label); }
  std::size_t at(std::int32_t own, std::int32_t other) const { return at(own) * count_ + at(other); }

  void put_in_place(std::size_t from, std::size_t to) {
    sites_[to] += sites_[from];
    sites_[from] = 0;
    for (std::size_t m = 0; m < count_; ++m) {
      data_[to * count_ + m] += data_[from * count_ + m];
      data_[from * count_ + m] = 0;
      for (const auto& [old, now] : {std::pair{from * count_ + m, to * count_ + m},
                                     std::pair{m * count_ + from, m * count_ + to}}) {
        cut_[now] += cut_[old];
        cut_[old] = 0;
      }
    }
    cut_[to * count_ + to] = 0;
  }

  std::size_t count_;
  std::vector<std::int64_t> sites_;  // per label
  std::vector<std::int64_t> data_;   // row by row: of the sites of the row's label by the column's
  std::vector<std::int64_t> cut_;    // between two labels, symmetric
};

// Merges labels of a problem's sites as long as that lowers the energy.  Returns by how much it did.
template <typename Cost>
std::int64_t merge_labels(const BasicLabelingProblem<Cost>& problem, std::vector<std::int32_t>& labels) {
  LabelTotals totals(static_cast<std::size_t>(problem.label_count));
  const auto count = static_cast<std::size_t>(problem.label_count);
  for (std::size_t v = 0; v < labels.size(); ++v) {
    const std::int32_t own = labels[v];
    totals.add_site(own);
    const Cost* row = problem.unary.data() + v * count;
    for (std::int32_t l = 0; l < problem.label_count; ++l) totals.add_data(own, l, row[l]);
    for (std::int64_t e = problem.indptr[v]; e < problem.indptr[v + 1]; ++e) {
      const auto i = static_cast<std::size_t>(e);
      const std::int32_t other = labels[static_cast<std::size_t>(problem.indices[i])];
      if (other != own) totals.add_cut(own, other, problem.weight[problem.weight.size() == 1 ? 0 : i]);
    }
  }
  const auto [becomes, gain] =
      totals.merge([&](std::size_t l) { return problem.cost_of_label(static_cast<std::int32_t>(l)); });
  if (gain > 0) {
    for (std::int32_t& label : labels) label = becomes[static_cast<std::size_t>(label)];
  }
  return gain;
}

}  // namespace emseg
