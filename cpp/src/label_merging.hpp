// Labels in each other's place, whole: what near copies of one motion come to, at the price of a few sums.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "emseg/expansion.hpp"

namespace emseg {

// Sums over a labelling, from which the energy of every merger follows: all sites of a label take another
// one, which other sites may have already or none.
class LabelTotals {
 public:
  explicit LabelTotals(std::vector<std::int64_t> label_cost)
      : label_cost_(std::move(label_cost)),
        sites_(label_cost_.size(), 0),
        data_(label_cost_.size() * label_cost_.size(), 0),
        cut_(data_.size(), 0) {}

  void add_site(std::int32_t label) { ++sites_[static_cast<std::size_t>(label)]; }
  // What sites that have one label cost by any, the same included.
  void add_data(std::int32_t own, std::int32_t by, std::int64_t cost) { data_[at(own, by)] += cost; }
  // Of edges between sites of two labels.
  void add_cut(std::int32_t a, std::int32_t b, std::int64_t weight) {
    cut_[at(a, b)] += weight;
    cut_[at(b, a)] += weight;
  }

  std::int64_t energy() const {
    std::int64_t sum = 0;
    for (std::int32_t l = 0; l < count(); ++l) {
      if (is_used(l)) sum += data_[at(l, l)] + cost_of(l);
      for (std::int32_t m = 0; m < l; ++m) sum += cut_[at(l, m)];
    }
    return sum;
  }

  struct Mergers {
    std::vector<std::int32_t> becomes;  // per label
    std::int64_t gain = 0;
  };

  // The merger of near copies that gains most, again and again until none gains anything.
  Mergers merge() {
    Mergers mergers;
    for (std::int32_t l = 0; l < count(); ++l) mergers.becomes.push_back(l);
    while (true) {
      std::int64_t most = 0;
      std::int32_t from = 0, to = 0;
      for (std::int32_t l = 0; l < count(); ++l) {
        for (std::int32_t m = 0; is_used(l) && m < count(); ++m) {
          const std::int64_t gain = m == l || !is_near_copy(l, m) ? 0 : gain_of(l, m);
          if (gain > most) most = gain, from = l, to = m;
        }
      }
      if (most == 0) return mergers;
      mergers.gain += most;
      put_in_place(from, to);
      for (std::int32_t& label : mergers.becomes) label = label == from ? to : label;
    }
  }

 private:
  std::int32_t count() const { return static_cast<std::int32_t>(label_cost_.size()); }
  std::size_t at(std::int32_t row, std::int32_t column) const {
    return static_cast<std::size_t>(row) * label_cost_.size() + static_cast<std::size_t>(column);
  }
  bool is_used(std::int32_t label) const { return sites_[static_cast<std::size_t>(label)] > 0; }
  std::int64_t cost_of(std::int32_t label) const { return label_cost_[static_cast<std::size_t>(label)]; }

  // Its sites are fitted by their label, and by the other for little more than a label's price: what a merger
  // of others gains is the boundaries of labels that are not settled yet, and cuts place them better.
  bool is_near_copy(std::int32_t label, std::int32_t other) const {
    const std::int64_t loss = data_[at(label, other)] - data_[at(label, label)];
    return loss >= 0 && loss <= 2 * cost_of(label);
  }

  std::int64_t gain_of(std::int32_t from, std::int32_t to) const {
    return data_[at(from, from)] - data_[at(from, to)] + cut_[at(from, to)] + cost_of(from) -
           (is_used(to) ? 0 : cost_of(to));
  }

  void put_in_place(std::int32_t from, std::int32_t to) {
    sites_[static_cast<std::size_t>(to)] += std::exchange(sites_[static_cast<std::size_t>(from)], 0);
    cut_[at(from, to)] = cut_[at(to, from)] = 0;
    for (std::int32_t l = 0; l < count(); ++l) {
      data_[at(to, l)] += std::exchange(data_[at(from, l)], 0);
      cut_[at(to, l)] += std::exchange(cut_[at(from, l)], 0);
      cut_[at(l, to)] += std::exchange(cut_[at(l, from)], 0);
    }
  }

  std::vector<std::int64_t> label_cost_;  // per label
  std::vector<std::int64_t> sites_;       // per label
  std::vector<std::int64_t> data_;        // rows: labels that sites have; columns: by which they cost that
  std::vector<std::int64_t> cut_;         // between two labels, symmetric
};

// Merges near copies among the labels of a problem's sites as long as that lowers the energy.  Returns by how
// much it did.
template <typename Cost>
std::int64_t merge_labels(const BasicLabelingProblem<Cost>& problem, std::vector<std::int32_t>& labels) {
  std::vector<std::int64_t> label_cost;
  for (std::int32_t l = 0; l < problem.label_count; ++l) label_cost.push_back(problem.cost_of_label(l));
  LabelTotals totals(std::move(label_cost));
  for (std::size_t v = 0; v < labels.size(); ++v) {
    const std::int32_t own = labels[v];
    totals.add_site(own);
    const Cost* row = problem.unary.data() + v * static_cast<std::size_t>(problem.label_count);
    for (std::int32_t l = 0; l < problem.label_count; ++l) totals.add_data(own, l, row[l]);
    for (std::int64_t e = problem.indptr[v]; e < problem.indptr[v + 1]; ++e) {
      const std::int32_t other = labels[static_cast<std::size_t>(problem.indices[e])];
      if (other != own) totals.add_cut(own, other, problem.weight[problem.weight.size() == 1 ? 0 : e]);
    }
  }
  const auto [becomes, gain] = totals.merge();
  if (gain > 0) {
    for (std::int32_t& label : labels) label = becomes[static_cast<std::size_t>(label)];
  }
  return gain;
}

}  // namespace emseg
