"""expansion against brute force, against PyMaxflow with plain hub nodes, and against its own evaluator."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emseg import _core
from emseg.graph_cut import expansion, labeling_energy


class Problem(NamedTuple):
    unary: NDArray[np.int64]
    indptr: NDArray[np.int64]
    indices: NDArray[np.int64]
    weight: NDArray[np.int64]
    label_cost: NDArray[np.int64]


def plain_energy(problem: Problem, labels: NDArray[np.integer]) -> float:
    n = len(labels)
    row = np.repeat(np.arange(n), np.diff(problem.indptr))
    cut = labels[row] != labels[problem.indices]
    weight = np.broadcast_to(problem.weight, problem.indices.shape)
    data = problem.unary[np.arange(n), labels].sum()
    return (data + weight[cut].sum() + problem.label_cost[np.unique(labels)].sum()).item()


def random_problem(seed: int, n: int, label_count: int, density: float = 0.3) -> Problem:
    rng = np.random.default_rng(seed)
    joined = rng.random((n, n)) < density / 2  # self loops and both directions of a pair occur
    row, column = np.nonzero(joined)
    return Problem(
        unary=rng.integers(-5, 15, (n, label_count)),
        indptr=np.searchsorted(row, np.arange(n + 1)),
        indices=column,
        weight=rng.integers(0, 8, len(row)),
        label_cost=rng.integers(0, rng.choice([2, 20, 60]), label_count),
    )


problems = st.builds(
    random_problem,
    st.integers(0, 2**32),
    st.integers(1, 8),
    st.integers(1, 4),
    st.sampled_from([0.2, 0.5, 1.0]),
)


@settings(max_examples=150, deadline=None)
@given(problems, st.integers(0, 2**32))
def test_no_expansion_improves_the_result(problem: Problem, seed: int) -> None:
    n, label_count = problem.unary.shape
    init = np.random.default_rng(seed).integers(0, label_count, n)
    labels, energy = expansion(*problem, init)
    assert labels.dtype == np.int32
    assert isinstance(energy, int)
    assert energy == plain_energy(problem, labels) == labeling_energy(*problem, labels)
    assert energy <= plain_energy(problem, init)
    switch = np.array(list(itertools.product([False, True], repeat=n)))
    for alpha in range(label_count):
        assert energy == min(plain_energy(problem, np.where(choice, alpha, labels)) for choice in switch)


@settings(max_examples=60, deadline=None)
@given(problems)
def test_energy_never_rises_over_sweeps(problem: Problem) -> None:
    starting_from_cheapest = plain_energy(problem, problem.unary.argmin(axis=1))
    energies = [expansion(*problem, max_sweeps=sweeps)[1] for sweeps in range(4)]
    assert energies[0] == starting_from_cheapest
    assert energies == sorted(energies, reverse=True)


@settings(max_examples=60, deadline=None)
@given(problems, st.integers(0, 2**32))
def test_two_labels_reach_the_optimum_of_all_labelings(problem: Problem, seed: int) -> None:
    # With two labels and without label costs one expansion move is the whole problem.
    two = Problem(*random_problem(seed, len(problem.unary), 2)[:4], label_cost=np.zeros(2, int))
    best = min(
        plain_energy(two, np.array(choice)) for choice in itertools.product([0, 1], repeat=len(two.unary))
    )
    assert expansion(*two, np.zeros(len(two.unary), int))[1] == best


@settings(max_examples=100, deadline=None)
@given(problems, st.integers(0, 2**32))
def test_renaming_sites_renames_the_labels(problem: Problem, seed: int) -> None:
    # Of equally good moves the smallest is taken: the order of the sites does not matter.
    n, label_count = problem.unary.shape
    rng = np.random.default_rng(seed)
    name = rng.permutation(n)
    init = rng.integers(0, label_count, n)
    row = name[np.repeat(np.arange(n), np.diff(problem.indptr))]
    order = np.argsort(row, kind="stable")
    old = np.argsort(name)
    renamed = Problem(
        problem.unary[old], np.searchsorted(row[order], np.arange(n + 1)), name[problem.indices][order],
        problem.weight[order], problem.label_cost,
    )  # fmt: skip
    labels, energy = expansion(*problem, init)
    other_labels, other_energy = expansion(*renamed, init[old])
    assert other_energy == energy
    np.testing.assert_array_equal(other_labels[name], labels)


def grid_problem(seed: int, width: int, label_count: int) -> Problem:
    """Noisy unaries of a picture of rectangles on a grid, four neighbours."""
    rng = np.random.default_rng(seed)
    n = width * width
    truth = np.zeros((width, width), int)
    for label in range(1, label_count):
        x, y = rng.integers(0, width - 4, 2)
        truth[y : y + rng.integers(3, width // 2), x : x + rng.integers(3, width // 2)] = label
    unary = rng.integers(0, 100, (n, label_count)) + 60
    unary[np.arange(n), truth.ravel()] -= 60
    site = np.arange(n).reshape(width, width)
    edges = np.vstack([
        np.column_stack([site[:, :-1].ravel(), site[:, 1:].ravel()]),
        np.column_stack([site[:-1].ravel(), site[1:].ravel()]),
    ])  # fmt: skip
    edges = edges[np.argsort(edges[:, 0], kind="stable")]
    indptr = np.searchsorted(edges[:, 0], np.arange(n + 1))
    return Problem(unary, indptr, edges[:, 1], np.array(20), np.full(label_count, 900))


def expand_with_plain_hubs(problem: Problem, labels: NDArray[np.integer], alpha: int) -> NDArray[np.integer]:
    """One move by PyMaxflow: a hub node per label, with infinite arcs from all its sites."""
    maxflow = pytest.importorskip("maxflow")
    n = len(labels)
    graph = maxflow.Graph[int](n, 2 * len(problem.indices))
    node = np.atleast_1d(graph.add_nodes(n))
    infinite = 10**8
    keep = np.where(labels == alpha, infinite, problem.unary[np.arange(n), labels])
    row = np.repeat(np.arange(n), np.diff(problem.indptr))
    for i, j, w in zip(row, problem.indices, np.broadcast_to(problem.weight, row.shape), strict=True):
        if labels[i] == labels[j]:
            graph.add_edge(i, j, w, w)
        else:
            keep[i] += w
            graph.add_edge(i, j, 0, w)
    graph.add_grid_tedges(node, problem.unary[:, alpha], keep)
    for label in np.unique(labels):
        if label == alpha or problem.label_cost[label] == 0:
            continue
        hub = graph.add_nodes(1)[0]
        graph.add_tedge(hub, 0, problem.label_cost[label])
        for i in np.flatnonzero(labels == label):
            graph.add_edge(i, hub, infinite, 0)
    graph.maxflow()
    moved = np.where(graph.get_grid_segments(node), alpha, labels)
    return moved if plain_energy(problem, moved) < plain_energy(problem, labels) else labels


@pytest.mark.parametrize("seed", range(3))
def test_sweeps_equal_those_of_plain_hubs(seed: int) -> None:
    problem = grid_problem(seed, 20, 8)
    init = problem.unary.argmin(axis=1)
    expected = init
    for sweeps in (1, 2):
        for alpha in range(problem.unary.shape[1]):
            expected = expand_with_plain_hubs(problem, expected, alpha)
        labels, energy = expansion(*problem, init, max_sweeps=sweeps)
        assert energy == plain_energy(problem, expected)
        assert energy == plain_energy(problem, labels)
    assert len(np.unique(labels)) < len(np.unique(init))


@pytest.mark.parametrize("seed", range(2))
def test_start_on_groups_ends_where_no_plain_move_helps(seed: int) -> None:
    problem = grid_problem(seed, 36, 6)
    init = np.random.default_rng(seed).integers(0, 6, len(problem.unary))
    for start in (init, problem.unary.argmin(axis=1)):
        labels, energy = expansion(*problem, start)
        assert energy == plain_energy(problem, labels) < plain_energy(problem, start)
        for alpha in range(6):
            assert plain_energy(problem, expand_with_plain_hubs(problem, labels, alpha)) == energy
        np.testing.assert_array_equal(expansion(*problem, start)[0], labels)


def test_energy_trace_falls_on_a_grid() -> None:
    problem = grid_problem(5, 60, 10)
    _, energy, trace = _core.expansion(
        10, problem.unary.astype(np.int32), problem.indptr, problem.indices.astype(np.int32),
        np.array([20], np.int32), problem.label_cost, np.zeros(0, np.int32), 100,
    )  # fmt: skip
    assert 3 <= len(trace) < 100
    assert (np.diff(trace) <= 0).all()
    assert trace[0] == plain_energy(problem, problem.unary.argmin(axis=1))
    assert trace[-1] == energy < trace[0]


@settings(max_examples=50, deadline=None)
@given(problems)
def test_integers_beyond_32_bits_are_exact(problem: Problem) -> None:
    factor = 10**10 + 7
    labels, energy = expansion(*problem)
    wide = Problem(
        problem.unary * factor, *problem[1:3], problem.weight * factor, problem.label_cost * factor
    )
    wide_labels, wide_energy = expansion(*wide)
    assert wide_energy == factor * energy
    np.testing.assert_array_equal(wide_labels, labels)


@settings(max_examples=50, deadline=None)
@given(problems, st.sampled_from([1.0, 0.125, 2.0**-30, 1e12, 1e-9, 0.1]))
def test_floats_equal_integers_in_their_fixed_point(problem: Problem, unit: float) -> None:
    labels, energy = expansion(*problem)
    unary, weight, cost = (part * unit for part in (problem.unary, problem.weight, problem.label_cost))
    real_labels, real_energy = expansion(unary, *problem[1:3], weight, cost)
    assert isinstance(real_energy, float)
    assert real_energy == pytest.approx(labeling_energy(unary, *problem[1:3], weight, cost, real_labels))
    # Powers of two and whole numbers are exact; others are rounded, and ties between moves fall either way.
    if unit not in (0.1, 1e-9):
        assert real_energy == pytest.approx(energy * unit, rel=1e-12, abs=1e-12 * unit)
    assert labels.shape == real_labels.shape


def test_small_problems_have_their_plain_answer() -> None:
    labels, energy = expansion(np.zeros((0, 3)), [0], [], 1, 5)
    assert labels.shape == (0,)
    assert energy == 0
    labels, energy = expansion([[3, 1], [4, 2]], [0, 0, 0], [], 1, 7)
    np.testing.assert_array_equal(labels, [1, 1])
    assert energy == 10
    assert expansion([[5]], [0, 1], [0], 100, [2])[1] == 7


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unary": [1, 2, 3]}, "expected \\(sites, labels\\)"),
        ({"unary": [[1, np.nan], [0, 0]]}, r"unary\[0, 1\] is nan"),
        ({"unary": [[1, np.inf], [0, 0]]}, r"unary\[0, 1\] is inf"),
        ({"unary": [[1, 2**62], [0, 0]]}, "larger than 2\\^62"),
        ({"unary": [[1, 2], [1, 2], [1, 2]]}, "indptr has 3 entries, expected 4"),
        ({"indptr": [0, 2, 1]}, "expected"),
        ({"indptr": [0.0, 1.0, 1.0]}, "indptr is of type float64"),
        ({"indices": [2]}, r"indices\[0\] is 2, expected a site in 0..1"),
        ({"indices": [-1]}, r"indices\[0\] is -1"),
        ({"weight": -1}, r"weight\[0\] is -1, expected at least 0"),
        ({"weight": [1, 2]}, "expected 1"),
        ({"weight": np.nan}, "weight.* is nan"),
        ({"label_cost": [1, -1]}, r"label_cost\[1\] is -1"),
        ({"label_cost": [1, 2, 3]}, "expected 1 or 2"),
        ({"init": [0]}, "init has shape"),
        ({"init": [0, 2]}, r"labels\[1\] is 2, expected 0..1"),
        ({"init": [0.0, 1.0]}, "init is of type float64"),
        ({"max_sweeps": -1}, "max_sweeps is -1"),
    ],
)
def test_bad_problems_are_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "unary": [[3, 1], [4, 2]], "indptr": [0, 1, 1], "indices": [1], "weight": 1, "label_cost": 7,
    }  # fmt: skip
    assert expansion(**good)[1] == 10  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        expansion(**{**good, **change})  # type: ignore[arg-type]
