import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_windows import patient, recorded, recorded_window

from emseg.reference import build_event_graph, delaunay_edges, graph_of_edges

pixels = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=30)
distinct_pixels = pixels.map(lambda points: np.unique(np.array(points), axis=0))


def cross(o, a, b) -> int:
    return int((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))


def segments_cross(a, b, c, d) -> bool:
    """Whether open segments ab and cd share a point that is not an end of both."""
    return cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0


def boundary_size(points) -> int:
    """Points on the boundary of the convex hull: those on a line through two with all others on one side."""
    on_boundary = set()
    for i, a in enumerate(points):
        for j, b in enumerate(points):
            if i != j and all(cross(a, b, c) >= 0 for c in points):
                on_boundary.update(k for k, c in enumerate(points) if cross(a, b, c) == 0)
    return len(on_boundary)


@patient
@given(distinct_pixels)
def test_delaunay_edges_are_a_triangulation(points):
    edges = delaunay_edges(points)
    collinear = all(cross(points[0], points[-1], c) == 0 for c in points)
    expected = (
        len(points) - 1 if collinear else 3 * len(points) - 3 - boundary_size(points)
    )  # Euler's formula
    assert len(edges) == expected
    for a, b in edges:
        for c, d in edges:
            assert not segments_cross(points[a], points[b], points[c], points[d])
        for k, c in enumerate(points):  # no pixel within an edge
            if k not in (a, b) and cross(points[a], points[b], c) == 0:
                assert (c - points[a]) @ (c - points[b]) > 0


@patient
@given(distinct_pixels)
def test_delaunay_edges_hold_every_pair_whose_circle_is_empty(points):
    """The Gabriel graph, closed circle empty, is part of every Delaunay triangulation."""
    edges = {tuple(sorted(edge)) for edge in delaunay_edges(points).tolist()}
    for i in range(len(points)):
        for j in range(i + 1, len(points)):
            others = np.delete(points, [i, j], axis=0)
            if all((c - points[i]) @ (c - points[j]) > 0 for c in others):
                assert (i, j) in edges


@patient
@given(distinct_pixels)
def test_delaunay_edges_have_an_empty_circle(points):
    """Each edge has a circle through its ends with no pixel inside: its centre lies on the bisector, at s."""
    for i, j in delaunay_edges(points):
        a, b = points[i], points[j]
        normal = np.array([a[1] - b[1], b[0] - a[0]])
        lowest, highest = -np.inf, np.inf
        for c in np.delete(points, [i, j], axis=0):
            height, inside = (c - a) @ normal, (c - a) @ (c - b)
            if height > 0:
                highest = min(highest, inside / height)
            elif height < 0:
                lowest = max(lowest, inside / height)
            else:
                assert inside > 0
        assert lowest <= highest + 1e-9


@pytest.mark.parametrize(
    ("points", "edge_count"),
    [
        (np.empty((0, 2), dtype=int), 0),
        (np.array([[3, 3]]), 0),
        (np.array([[3, 3], [9, 1]]), 1),
        (np.column_stack([np.arange(7)[::-1], 2 * np.arange(7)[::-1]]), 6),
        (np.argwhere(np.ones((12, 15))), 12 * 14 + 11 * 15 + 11 * 14),
    ],
    ids=["none", "one", "two", "line", "full grid"],
)
def test_degenerate_pixels(points, edge_count):
    assert len(delaunay_edges(points)) == edge_count


def edges_by_definition(pixel) -> set[tuple[int, int]]:
    """The graph as it is defined, event by event."""
    active = np.unique(pixel, axis=0)
    adjacent = {(tuple(active[a]), tuple(active[b])) for a, b in delaunay_edges(active)}
    adjacent |= {(b, a) for a, b in adjacent} | {(tuple(p), tuple(p)) for p in active}
    edges = set()
    for k, place in enumerate(pixel):
        for other_place in active:
            if (tuple(place), tuple(other_place)) in adjacent:
                there = np.flatnonzero((pixel == other_place).all(axis=1))
                before, after = there[there < k], there[there > k]
                edges |= {(int(before[-1]), k)} if len(before) else set()
                edges |= {(k, int(after[0]))} if len(after) else set()
    return edges


@patient
@given(pixels.map(np.array))
def test_graph_is_what_its_definition_says(pixel):
    graph = build_event_graph(pixel)
    assert {tuple(edge) for edge in graph.edges.tolist()} == edges_by_definition(pixel)
    assert graph.indptr[0] == 0
    assert graph.indptr[-1] == len(graph.indices)
    assert len(graph.indptr) == len(pixel) + 1


def test_graph_of_a_recorded_window_is_sorted_undirected_and_connected():
    window = recorded_window(recorded("240x180_15k"))
    graph = build_event_graph(window.pixel)
    edges = graph.edges
    assert (edges[:, 0] < edges[:, 1]).all()
    assert (np.diff(edges[:, 0] * len(window) + edges[:, 1]) > 0).all()
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    matrix = coo_array((np.ones(len(edges)), edges.T), shape=(len(window),) * 2)
    assert connected_components(matrix, directed=False)[0] == 1


def test_rows_drop_repeats_and_directions():
    graph = graph_of_edges(np.array([[2, 0], [0, 2], [1, 2], [0, 1], [0, 2]]), 4)
    assert graph.indptr.tolist() == [0, 2, 3, 3, 3]
    assert graph.indices.tolist() == [1, 2, 2]
