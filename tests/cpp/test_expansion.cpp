#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <vector>

#include "../../cpp/src/expansion_move.hpp"
#include "../../cpp/src/grouped_problem.hpp"
#include "emseg/expansion.hpp"

using namespace emseg;

namespace {

template <typename Cost>
struct OwnedProblem {
  std::int32_t label_count = 0;
  std::vector<Cost> unary;
  std::vector<std::int64_t> indptr;
  std::vector<std::int32_t> indices;
  std::vector<Cost> weight;
  std::vector<std::int64_t> label_cost;

  BasicLabelingProblem<Cost> view() const {
    return {label_count, unary, indptr, indices, weight, label_cost};
  }
  std::size_t site_count() const { return indptr.size() - 1; }
};

struct Ranges {
  int sites = 8;
  int labels = 4;
  int unary = 20;
  int weight = 10;
  int label_cost = 40;
  double density = 0.3;
};

template <typename Cost>
OwnedProblem<Cost> random_problem(std::mt19937& random, const Ranges& ranges) {
  auto upto = [&random](int most) { return std::uniform_int_distribution<int>(0, most)(random); };
  OwnedProblem<Cost> problem;
  problem.label_count = ranges.labels;
  for (int k = 0; k < ranges.sites * ranges.labels; ++k)
    problem.unary.push_back(upto(ranges.unary) - ranges.unary / 3);
  problem.indptr.push_back(0);
  for (int i = 0; i < ranges.sites; ++i) {
    for (int j = 0; j < ranges.sites; ++j) {  // self loops and both directions of a pair occur
      if (std::bernoulli_distribution(ranges.density / 2)(random)) {
        problem.indices.push_back(j);
        problem.weight.push_back(upto(ranges.weight));
      }
    }
    problem.indptr.push_back(static_cast<std::int64_t>(problem.indices.size()));
  }
  if (upto(3) == 0) problem.weight.assign(1, upto(ranges.weight));
  for (int l = 0; l < ranges.labels; ++l)
    problem.label_cost.push_back(upto(2) == 0 ? 0 : upto(ranges.label_cost));
  return problem;
}

// The definition, term by term; shares nothing with the library.
template <typename Cost>
std::int64_t plain_energy(const OwnedProblem<Cost>& problem, const std::vector<std::int32_t>& labels) {
  std::int64_t energy = 0;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    energy +=
        problem
            .unary[i * static_cast<std::size_t>(problem.label_count) + static_cast<std::size_t>(labels[i])];
    for (auto e = problem.indptr[i]; e < problem.indptr[i + 1]; ++e) {
      const auto k = static_cast<std::size_t>(e);
      if (labels[static_cast<std::size_t>(problem.indices[k])] == labels[i]) continue;
      energy += problem.weight.size() == 1 ? problem.weight[0] : problem.weight[k];
    }
  }
  for (std::int32_t l = 0; l < problem.label_count; ++l) {
    for (const std::int32_t label : labels) {
      if (label == l) {
        energy += problem.label_cost[static_cast<std::size_t>(l)];
        break;
      }
    }
  }
  return energy;
}

using Allowed = std::vector<std::uint64_t>;  // per site: a bit for each label that it may take; empty: all

// The least energy over all 2^n expansions of alpha, less those that a site may not take part in.
template <typename Cost>
std::int64_t best_expansion(const OwnedProblem<Cost>& problem, const std::vector<std::int32_t>& labels,
                            std::int32_t alpha, const Allowed& allowed = {}) {
  std::int64_t best = std::numeric_limits<std::int64_t>::max();
  for (unsigned choice = 0; choice < (1U << labels.size()); ++choice) {
    std::vector<std::int32_t> moved = labels;
    for (std::size_t i = 0; i < moved.size(); ++i) {
      const bool may = allowed.empty() || ((allowed[i] >> alpha) & 1) != 0;
      if (may && ((choice >> i) & 1U)) moved[i] = alpha;
    }
    best = std::min(best, plain_energy(problem, moved));
  }
  return best;
}

struct MoveOutcome {
  int wiped = 0;  // labels that the move wiped out
  bool moved = false;
};

enum class Begin { anew, from_last_flow };

template <typename Capacity, typename Residual, typename Cost>
MoveOutcome check_move(const OwnedProblem<Cost>& problem, const std::vector<std::int32_t>& labels,
                       std::int32_t alpha, ExpansionMove<Capacity, Residual>& move, Begin begin = Begin::anew,
                       const Allowed& allowed = {}) {
  std::vector<std::int32_t> used(static_cast<std::size_t>(problem.label_count), 0);
  for (const std::int32_t label : labels) ++used[static_cast<std::size_t>(label)];
  const std::int64_t before = plain_energy(problem, labels);
  if (begin == Begin::anew) move.begin(problem.view(), allowed);
  const std::int64_t gain = move.find(problem.view(), labels, used, alpha);

  std::vector<std::int32_t> moved = labels;
  MoveOutcome outcome;
  for (const std::int32_t site : move.switched()) {
    auto& label = moved[static_cast<std::size_t>(site)];
    if (--used[static_cast<std::size_t>(label)] == 0) ++outcome.wiped;
    label = alpha;
  }
  outcome.moved = !move.switched().empty();
  REQUIRE(plain_energy(problem, moved) == before - gain);
  REQUIRE(before - gain == best_expansion(problem, labels, alpha, allowed));
  return outcome;
}

std::vector<std::int32_t> random_labels(std::mt19937& random, std::size_t sites, std::int32_t labels) {
  std::vector<std::int32_t> result(sites);
  for (auto& label : result) label = std::uniform_int_distribution<std::int32_t>(0, labels - 1)(random);
  return result;
}

}  // namespace

TEST_CASE("every expansion move is the best of all expansions") {
  std::mt19937 random(7);
  ExpansionMove<std::int32_t, std::int16_t> small;
  ExpansionMove<std::int32_t> narrow;
  ExpansionMove<std::int64_t> wide;
  int moves = 0;
  int wiped = 0;
  int several_wiped = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    Ranges ranges;
    ranges.sites = 1 + trial % 11;
    ranges.labels = 2 + trial % 5;
    ranges.label_cost = trial % 3 == 0 ? 12 : 60;
    ranges.weight = trial % 2 == 0 ? 10 : 3;
    ranges.density = trial % 7 == 0 ? 0.9 : 0.35;
    const auto problem = random_problem<std::int32_t>(random, ranges);
    const auto labels = random_labels(random, problem.site_count(), problem.label_count);
    const std::int32_t alpha = trial % problem.label_count;
    const MoveOutcome outcome = check_move(problem, labels, alpha, narrow);
    moves += outcome.moved ? 1 : 0;
    wiped += outcome.wiped > 0 ? 1 : 0;
    several_wiped += outcome.wiped > 1 ? 1 : 0;
    check_move(problem, labels, alpha, small);
    check_move(problem, labels, alpha, wide);
  }
  // The cases that the test is for did occur.
  CHECK(moves > 300);
  CHECK(wiped > 200);
  CHECK(several_wiped > 50);
}

TEST_CASE("a move that starts from the flow of an earlier one is as good") {
  std::mt19937 random(13);
  ExpansionMove<std::int32_t> move;
  int moves = 0;
  for (int trial = 0; trial < 150; ++trial) {
    Ranges ranges;
    ranges.sites = 9;
    ranges.labels = 3 + trial % 3;
    const auto problem = random_problem<std::int32_t>(random, ranges);
    move.begin(problem.view());
    for (int step = 0; step < 8; ++step) {
      const auto labels = random_labels(random, problem.site_count(), problem.label_count);
      moves += check_move(problem, labels, step % 2, move, Begin::from_last_flow).moved ? 1 : 0;
    }
  }
  CHECK(moves > 400);
}

// Few sites change between moves, as in a sweep, so that most of the flow is brought up to date.
TEST_CASE("moves among the labels that sites may take are the best of these") {
  std::mt19937 random(17);
  ExpansionMove<std::int32_t, std::int16_t> move;
  int moves = 0;
  int held_back = 0;
  for (int trial = 0; trial < 150; ++trial) {
    Ranges ranges;
    ranges.sites = 10;
    ranges.labels = 3 + trial % 3;
    const auto problem = random_problem<std::int32_t>(random, ranges);
    Allowed allowed(problem.site_count());
    for (auto& labels : allowed) labels = random();
    move.begin(problem.view(), allowed);
    std::vector<std::int32_t> labels = random_labels(random, problem.site_count(), problem.label_count);
    for (int step = 0; step < 8; ++step) {
      labels[random() % labels.size()] = static_cast<std::int32_t>(random() % 3);
      const std::int32_t alpha = step % 2;
      moves += check_move(problem, labels, alpha, move, Begin::from_last_flow, allowed).moved ? 1 : 0;
      held_back +=
          best_expansion(problem, labels, alpha) < best_expansion(problem, labels, alpha, allowed) ? 1 : 0;
    }
  }
  CHECK(moves > 300);
  CHECK(held_back > 300);
}

// Labels whose sites cling to each other: wiping out one pays only together with another, hubs take flow from
// sites of other labels, and give it back.
TEST_CASE("hubs that depend on each other are solved exactly") {
  std::mt19937 random(11);
  ExpansionMove<std::int32_t> move;
  int several_wiped = 0;
  int kept = 0;
  for (int trial = 0; trial < 1500; ++trial) {
    Ranges ranges;
    ranges.sites = 9;
    ranges.labels = 4 + trial % 3;
    ranges.unary = 4;
    ranges.weight = 6;
    ranges.density = 0.25 + 0.1 * (trial % 4);
    auto problem = random_problem<std::int32_t>(random, ranges);
    const int dear = 3 + trial % 20;
    for (auto& cost : problem.label_cost) cost = std::uniform_int_distribution<int>(1, dear)(random);
    for (std::size_t i = 0; i < problem.site_count(); ++i)
      problem.unary[i * problem.label_count] += 3 + trial % 3;
    std::vector<std::int32_t> labels = random_labels(random, problem.site_count(), problem.label_count - 1);
    for (auto& label : labels) ++label;  // alpha = 0 is not in use
    const MoveOutcome outcome = check_move(problem, labels, 0, move);
    several_wiped += outcome.wiped > 1 ? 1 : 0;
    kept += outcome.moved ? 0 : 1;
  }
  CHECK(several_wiped > 200);
  CHECK(kept > 200);
}

TEST_CASE_TEMPLATE("the energy never rises, and ends where no single expansion helps", Cost, std::int32_t,
                   std::int64_t) {
  std::mt19937 random(3);
  ExpansionWorkspace workspace;
  for (int trial = 0; trial < 200; ++trial) {
    Ranges ranges;
    ranges.sites = 1 + trial % 9;
    ranges.labels = 1 + trial % 5;
    auto problem = random_problem<Cost>(random, ranges);
    if constexpr (sizeof(Cost) == 8) {  // far beyond 32 bits
      for (auto& cost : problem.unary) cost *= 1'000'000'007;
      for (auto& weight : problem.weight) weight *= 1'000'000'007;
      for (auto& cost : problem.label_cost) cost *= 1'000'000'007;
    }
    const ExpansionResult result = expansion(problem.view(), {}, {.max_sweeps = 50}, workspace);
    CHECK(result.energy == plain_energy(problem, result.labels));
    CHECK(result.energy == labeling_energy(problem.view(), result.labels));
    CHECK(result.energy == result.energy_trace.back());
    for (std::size_t k = 1; k < result.energy_trace.size(); ++k) {
      CHECK(result.energy_trace[k] <= result.energy_trace[k - 1]);
    }
    for (std::int32_t alpha = 0; alpha < problem.label_count; ++alpha) {
      CHECK(best_expansion(problem, result.labels, alpha) == result.energy);
    }
    CHECK(expansion(problem.view(), result.labels).labels == result.labels);
  }
}

TEST_CASE("labels of groups have the energy of the sites that they spread to") {
  std::mt19937 random(19);
  bool some_full = false;
  for (int trial = 0; trial < 40; ++trial) {
    Ranges ranges;
    ranges.sites = 1 + 6 * trial;
    ranges.density = trial % 4 == 0 ? 0.3 : 2.0 / ranges.sites;
    const auto problem = random_problem<std::int32_t>(random, ranges);
    const GroupedProblem groups(problem.view());
    const WideLabelingProblem coarse = groups.view();
    const std::vector<std::int32_t> coarse_labels =
        random_labels(random, coarse.site_count(), problem.label_count);
    const std::vector<std::int32_t> labels = groups.spread(coarse_labels);
    CHECK(labeling_energy(coarse, coarse_labels) == plain_energy(problem, labels));

    std::vector<std::int32_t> names(coarse.site_count());
    std::iota(names.begin(), names.end(), 0);
    std::vector<std::size_t> sites(names.size(), 0);
    for (const std::int32_t group : groups.spread(names)) ++sites[static_cast<std::size_t>(group)];
    CHECK(*std::min_element(sites.begin(), sites.end()) >= 1);
    const std::size_t largest = *std::max_element(sites.begin(), sites.end());
    CHECK(largest <= GroupedProblem::kMostSites);
    some_full |= largest == GroupedProblem::kMostSites;
  }
  CHECK(some_full);
}

TEST_CASE_TEMPLATE("large problems that start on groups end no higher than they began", Cost, std::int32_t,
                   std::int64_t) {
  std::mt19937 random(23);
  ExpansionWorkspace workspace;
  for (int trial = 0; trial < 6; ++trial) {
    Ranges ranges;
    ranges.sites = 1200;
    ranges.density = 0.004;
    ranges.label_cost = 600;
    auto problem = random_problem<Cost>(random, ranges);
    if constexpr (sizeof(Cost) == 8) {
      for (auto& cost : problem.unary) cost *= 1'000'000'007;
    }
    const auto initial = random_labels(random, problem.site_count(), problem.label_count);
    const ExpansionResult found = expansion(problem.view(), initial, {.max_sweeps = 50}, workspace);
    CHECK(found.energy == plain_energy(problem, found.labels));
    CHECK(found.energy_trace.front() == plain_energy(problem, initial));
    CHECK(std::is_sorted(found.energy_trace.rbegin(), found.energy_trace.rend()));

    // No single expansion improves them.
    ExpansionMove<std::int64_t> move;
    std::vector<std::int32_t> used(static_cast<std::size_t>(problem.label_count), 0);
    for (const std::int32_t label : found.labels) ++used[static_cast<std::size_t>(label)];
    move.begin(problem.view());
    for (std::int32_t alpha = 0; alpha < problem.label_count; ++alpha) {
      CHECK(move.find(problem.view(), found.labels, used, alpha) == 0);
    }
    CHECK(expansion(problem.view(), found.labels).energy <= found.energy);
  }
}

TEST_CASE("no sweep leaves the labels as they are") {
  const OwnedProblem<std::int32_t> problem{2, {5, 0, 5, 0}, {0, 1, 1}, {1}, {1}, {0, 0}};
  const std::vector<std::int32_t> initial{0, 0};
  const ExpansionResult result = expansion(problem.view(), initial, {.max_sweeps = 0});
  CHECK(result.labels == initial);
  CHECK(result.energy == 10);
  CHECK(result.energy_trace == std::vector<std::int64_t>{10});
}

TEST_CASE("problems without sites or edges have their plain answer") {
  const OwnedProblem<std::int32_t> empty{3, {}, {0}, {}, {1}, {5}};
  CHECK(expansion(empty.view()).labels.empty());
  CHECK(expansion(empty.view()).energy == 0);
  const OwnedProblem<std::int32_t> loose{2, {3, 1, 4, 2}, {0, 0, 0}, {}, {}, {7, 7}};
  CHECK(expansion(loose.view()).labels == std::vector<std::int32_t>{1, 1});
  CHECK(expansion(loose.view()).energy == 10);
}

TEST_CASE("bad problems are refused") {
  const OwnedProblem<std::int32_t> good{2, {3, 1, 4, 2}, {0, 1, 1}, {1}, {5}, {7, 7}};
  CHECK_NOTHROW(expansion(good.view()));
  auto refuses = [&good](auto spoil) {
    OwnedProblem<std::int32_t> bad = good;
    spoil(bad);
    CHECK_THROWS_AS(expansion(bad.view()), std::invalid_argument);
    CHECK_THROWS_AS(labeling_energy(bad.view(), std::vector<std::int32_t>(2, 0)), std::invalid_argument);
  };
  refuses([](auto& p) { p.label_count = 0; });
  refuses([](auto& p) { p.unary.pop_back(); });
  refuses([](auto& p) { p.indptr = {0, 2, 1}; });
  refuses([](auto& p) { p.indptr = {1, 1, 1}; });
  refuses([](auto& p) { p.indptr = {0, 1, 2}; });
  refuses([](auto& p) { p.indices = {2}; });
  refuses([](auto& p) { p.indices = {-1}; });
  refuses([](auto& p) { p.weight = {-1}; });
  refuses([](auto& p) { p.weight = {1, 2, 3}; });
  refuses([](auto& p) { p.label_cost = {1, -2}; });
  refuses([](auto& p) { p.label_cost = {1, 2, 3}; });
  refuses([](auto& p) { p.label_cost = {std::int64_t{1} << 61, std::int64_t{1} << 62}; });
  CHECK_THROWS_AS(expansion(good.view(), std::vector<std::int32_t>{0}), std::invalid_argument);
  CHECK_THROWS_AS(expansion(good.view(), std::vector<std::int32_t>{0, 2}), std::invalid_argument);
  CHECK_THROWS_AS(expansion(good.view(), {}, {.max_sweeps = -1}), std::invalid_argument);

  OwnedProblem<std::int64_t> huge{2, {3, 1, 4, std::int64_t{1} << 62}, {0, 1, 1}, {1}, {5}, {7, 7}};
  CHECK_THROWS_AS(expansion(huge.view()), std::invalid_argument);
  huge.unary[3] = std::numeric_limits<std::int64_t>::min();
  CHECK_THROWS_AS(expansion(huge.view()), std::invalid_argument);
}
