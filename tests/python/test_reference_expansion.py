from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from reference_windows import patient

from emseg.reference import expansion, expansion_move, graph_of_edges, labeling_energy


@st.composite
def problems(draw, max_sites=8, max_labels=4):
    """Unary, graph, Potts weight, label costs and initial labels, small enough for brute force."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sites, labels = draw(st.integers(1, max_sites)), draw(st.integers(1, max_labels))
    unary = rng.integers(-20, 60, (sites, labels))
    pairs = rng.integers(0, sites, (2 * sites, 2))
    graph = graph_of_edges(pairs[pairs[:, 0] != pairs[:, 1]], sites)
    return {
        "unary": unary,
        "graph": graph,
        "lambda_smooth": draw(st.integers(0, 25)),
        "label_cost": rng.integers(0, 80, labels) * rng.integers(0, 2, labels),
        "labels": rng.integers(0, labels, sites),
    }


def energy_of(problem, labels) -> int:
    """The energy summed term by term."""
    total = sum(int(problem["unary"][k, label]) for k, label in enumerate(labels))
    total += problem["lambda_smooth"] * sum(1 for i, j in problem["graph"].edges if labels[i] != labels[j])
    return total + sum(int(problem["label_cost"][label]) for label in set(labels))


def moves(labels, alpha):
    """Every labelling in which each site keeps its label or takes alpha."""
    return product(*[sorted({int(label), alpha}) for label in labels])


@patient
@given(problems())
def test_energy_is_the_sum_of_its_terms(problem):
    labels = problem.pop("labels")
    assert labeling_energy(labels, **problem) == energy_of(problem, labels.tolist())


@settings(patient, max_examples=300)
@given(problems(), st.data())
def test_a_move_is_the_best_of_all_moves(problem, data):
    alpha = data.draw(st.integers(0, problem["unary"].shape[1] - 1))
    labels = problem.pop("labels")
    moved = expansion_move(labels, alpha, **problem)
    assert ((moved == labels) | (moved == alpha)).all()
    problem["label_cost"] = problem["label_cost"].copy()
    problem["label_cost"][alpha] = 0  # a move's cut leaves alpha's own cost to the sweep
    assert energy_of(problem, moved.tolist()) == min(
        energy_of(problem, move) for move in moves(labels, alpha)
    )


@settings(patient, max_examples=150)
@given(problems(max_sites=7))
def test_expansion_ends_where_no_move_helps(problem):
    initial = problem.pop("labels")
    result = expansion(**problem, initial=initial, max_sweeps=50)
    assert result.energy == energy_of(problem, result.labels.tolist())
    assert result.energy_trace[0] == energy_of(problem, initial.tolist())
    assert all(
        after <= before for before, after in zip(result.energy_trace, result.energy_trace[1:], strict=False)
    )
    for alpha in range(problem["unary"].shape[1]):
        assert result.energy <= min(energy_of(problem, move) for move in moves(result.labels, alpha))


@patient
@given(problems(), st.integers(0, 2**32 - 1))
def test_energy_does_not_depend_on_the_labels_names(problem, seed):
    labels = problem.pop("labels")
    renamed = np.random.default_rng(seed).permutation(problem["unary"].shape[1])
    inverse = np.argsort(renamed)
    other = {**problem, "unary": problem["unary"][:, inverse], "label_cost": problem["label_cost"][inverse]}
    assert labeling_energy(renamed[labels], **other) == labeling_energy(labels, **problem)


def test_label_cost_is_counted_once_and_only_if_used():
    graph = graph_of_edges(np.empty((0, 2), dtype=np.int64), 3)
    unary = np.array([[0, 3, 9], [0, 3, 9], [5, 0, 9]])
    free = expansion(unary, graph, lambda_smooth=0, label_cost=[0, 0, 0])
    assert (free.labels.tolist(), free.energy) == ([0, 0, 1], 0)
    dear = expansion(unary, graph, lambda_smooth=0, label_cost=[10, 10, 10])
    assert (dear.labels.tolist(), dear.energy) == ([0, 0, 0], 15)


def test_without_initial_labels_each_site_starts_with_its_cheapest():
    graph = graph_of_edges(np.array([[0, 1]]), 2)
    result = expansion(np.array([[4, 1], [0, 2]]), graph, lambda_smooth=1, label_cost=[0, 0], max_sweeps=0)
    assert result.labels.tolist() == [1, 0]
    assert result.energy_trace == [2]
