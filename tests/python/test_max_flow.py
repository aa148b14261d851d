"""max_flow against PyMaxflow, and against the definition of a cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emseg.graph_cut import max_flow

maxflow = pytest.importorskip("maxflow", reason="PyMaxflow is the oracle of the flows")

Graph = tuple[
    int, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]
]


def peer(graph: Graph, kind: type = int) -> tuple[float, NDArray[np.bool_]]:
    n, edges, capacity, reverse, source, sink = graph
    peer_graph = maxflow.Graph[kind](n, len(edges))
    nodes = np.atleast_1d(peer_graph.add_nodes(n))
    proper = edges[:, 0] != edges[:, 1]
    peer_graph.add_edges(*edges[proper].T, capacity[proper], reverse[proper])
    peer_graph.add_grid_tedges(nodes, source, sink)
    return peer_graph.maxflow(), peer_graph.get_grid_segments(nodes)


def cut_value(graph: Graph, cut: NDArray[np.bool_]) -> float:
    _, edges, capacity, reverse, source, sink = graph
    tail, head = cut[edges[:, 0]], cut[edges[:, 1]]
    across = capacity[~tail & head].sum() + reverse[tail & ~head].sum()
    return (across + source[cut].sum() + sink[~cut].sum()).item()


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    n = draw(st.integers(1, 40))
    m = draw(st.integers(0, 4 * n))
    top = draw(st.sampled_from([1, 3, 50, 2**31, 2**40]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    edges = rng.integers(0, n, (m, 2))
    capacity, reverse = rng.integers(0, top + 1, (2, m)) * rng.integers(0, 2, (2, m))
    source, sink = rng.integers(0, top + 1, (2, n)) * (
        rng.random((2, n)) < draw(st.sampled_from([0.1, 0.5, 1]))
    )
    return n, edges, capacity, reverse, source, sink


@settings(max_examples=300, deadline=None)
@given(graphs())
def test_flow_and_cut_equal_pymaxflow(graph: Graph) -> None:
    # PyMaxflow's integers have 32 bits; doubles hold these sums exactly.
    expected_flow, expected_cut = peer(graph, float)
    flow, cut = max_flow(*graph)
    assert isinstance(flow, int)
    assert flow == expected_flow
    assert flow == cut_value(graph, cut)
    np.testing.assert_array_equal(cut, expected_cut)


@settings(max_examples=60, deadline=None)
@given(graphs(), st.integers(0, 2**32))
def test_renaming_nodes_and_turning_edges_renames_the_cut(graph: Graph, seed: int) -> None:
    n, edges, capacity, reverse, source, sink = graph
    rng = np.random.default_rng(seed)
    name, shuffled = rng.permutation(n), rng.permutation(len(edges))
    old = np.argsort(name)
    flow, cut = max_flow(*graph)
    other_flow, other_cut = max_flow(
        n, name[edges[shuffled, ::-1]], reverse[shuffled], capacity[shuffled], source[old], sink[old]
    )
    assert other_flow == flow
    np.testing.assert_array_equal(other_cut[name], cut)


def space_time_graph(n: int, seed: int, smooth: int, noise: float) -> Graph:
    """Events on a pixel grid, joined to the last and next event at the own and the four adjacent pixels."""
    rng = np.random.default_rng(seed)
    width = int(np.sqrt(n / 4)) + 2
    x, y = rng.integers(0, width, (2, n))
    key = (y * width + x) * n + np.arange(n)  # the index is the time
    order = np.argsort(key)
    pairs = []
    for dx, dy in ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)):
        inside = (x + dx >= 0) & (x + dx < width) & (y + dy >= 0) & (y + dy < width)
        event = np.flatnonzero(inside)
        pixel = (y[event] + dy) * width + x[event] + dx
        place = np.searchsorted(key[order], pixel * n + event, side="right")
        for found in (place, place - 1 - (dx == dy == 0)):
            valid = (found >= 0) & (found < n)
            other = order[found[valid]]
            same = key[other] // n == pixel[valid]
            pairs.append(np.column_stack([event[valid][same], other[same]]))
    edges = np.unique(np.sort(np.vstack(pairs), axis=1), axis=0)
    bias = np.where((x // 12 + y // 12) % 2 == 1, 30, -30) + np.round(rng.normal(0, noise, n)).astype(int)
    smoothness = np.full(len(edges), smooth)
    return n, edges, smoothness, smoothness, np.maximum(bias, 0), np.maximum(-bias, 0)


@pytest.mark.parametrize(("smooth", "noise"), [(30, 20), (30, 200), (60, 100)])
def test_space_time_graphs_equal_pymaxflow(smooth: int, noise: float) -> None:
    graph = space_time_graph(20000, 1, smooth, noise)
    assert 6 < 2 * len(graph[1]) / graph[0] < 11
    expected_flow, expected_cut = peer(graph)
    flow, cut = max_flow(*graph)
    assert flow == expected_flow
    np.testing.assert_array_equal(cut, expected_cut)
    assert 0.1 < cut.mean() < 0.9


def test_terminals_may_be_nodes() -> None:
    # 0 -> 1 -> 3 lets 3 through, 0 -> 2 -> 3 lets 2 through.
    edges = [[0, 1], [1, 3], [0, 2], [2, 3]]
    flow, cut = max_flow(4, edges, [3, 5, 4, 2], 0, 0, 3)
    assert flow == 5
    np.testing.assert_array_equal(cut, [False, True, False, True])
    assert max_flow(2, np.zeros((0, 2), int), [], [], 0, 1)[0] == 0


@settings(max_examples=100, deadline=None)
@given(graphs())
def test_terminal_nodes_equal_terminal_arrays(graph: Graph) -> None:
    n, edges, capacity, reverse, source, sink = graph
    node = np.arange(n)
    more = np.vstack(
        [edges, np.column_stack([np.full(n, n), node]), np.column_stack([node, np.full(n, n + 1)])]
    )
    along = np.concatenate([capacity, source, sink])
    against = np.concatenate([reverse, np.zeros(2 * n, int)])
    flow, cut = max_flow(n + 2, more, along, against, n, n + 1)
    expected_flow, expected_cut = max_flow(*graph)
    assert flow == expected_flow
    np.testing.assert_array_equal(cut[:n], expected_cut)


def test_floats_are_exact_to_their_fixed_point() -> None:
    rng = np.random.default_rng(4)
    n, m = 50, 200
    edges = rng.integers(0, n, (m, 2))
    parts = rng.random(m), rng.random(m), rng.random(n), rng.random(n)
    flow, cut = max_flow(n, edges, *parts)
    assert isinstance(flow, float)
    assert flow == pytest.approx(cut_value((n, edges, *parts), cut), rel=1e-12)
    assert flow == pytest.approx(peer((n, edges, *parts), float)[0], rel=1e-12)
    eighths = [np.round(part * 8).astype(int) for part in parts]
    assert max_flow(n, edges, *(part / 8 for part in eighths))[0] == max_flow(n, edges, *eighths)[0] / 8


def test_nothing_flows_in_an_empty_graph() -> None:
    flow, cut = max_flow(0, np.zeros((0, 2), int), [], [], [], [])
    assert flow == 0
    assert cut.shape == (0,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n": -1}, "n is -1"),
        ({"n": 2, "source": [9, 0], "sink": [0, 9]}, r"head\[1\] is 2, expected a node in 0..1"),
        ({"edges": [[0, 1, 2]]}, "expected \\(m, 2\\)"),
        ({"edges": [[0.5, 1]]}, "edges is of type float64"),
        ({"edges": [[0, 2**40]]}, "int32's range"),
        ({"edges": [[0, -1], [1, 2]]}, "expected a node in 0..2"),
        ({"capacity": [1, -1]}, r"capacity\[1\] is -1, expected at least 0"),
        ({"reverse": [1.0, np.nan]}, r"reverse\[1\] is nan"),
        ({"source": [1.0, np.inf, 0]}, r"source\[1\] is inf"),
        ({"sink": [1, 2]}, "sink has shape"),
        ({"capacity": [1, 2, 3]}, "capacity has shape"),
        ({"source": 0}, "two node numbers or two arrays"),
        ({"source": 0, "sink": 3}, "sink is node 3"),
        ({"source": 1, "sink": 1}, "two different nodes"),
        ({"capacity": [2**62, 2**62]}, "2\\*\\*62"),
        ({"sink": ["a", "b", "c"]}, "expected integers or floats"),
    ],
)
def test_bad_graphs_are_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "n": 3, "edges": [[0, 1], [1, 2]], "capacity": [3, 2], "reverse": [0, 0], "source": [9, 0, 0],
        "sink": [0, 0, 9],
    }  # fmt: skip
    assert max_flow(**good)[0] == 2  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        max_flow(**{**good, **change})  # type: ignore[arg-type]
