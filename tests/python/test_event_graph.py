"""The event graph against a plain reading of its definition, and its triangulation against SciPy's."""

from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial import Delaunay

from emseg import _core
from emseg.event_graph import event_graph

REFERENCE = Path(__file__).parents[3] / "shared/data/reference"


def make_events(xy: np.ndarray, width: int, height: int, t: np.ndarray | None = None) -> SimpleNamespace:
    n = len(xy)
    return SimpleNamespace(
        x=xy[:, 0].astype(np.uint16),
        y=xy[:, 1].astype(np.uint16),
        t=np.arange(n) if t is None else t,
        p=np.zeros(n, np.uint8),
        width=width,
        height=height,
    )


def edge_set(indptr: np.ndarray, indices: np.ndarray) -> set[tuple[int, int]]:
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return set(zip(rows.tolist(), indices.tolist(), strict=True))


def graph_by_definition(xy: np.ndarray) -> set[tuple[int, int]]:
    """Every event looks up its neighbours: at its own pixel and at the Delaunay neighbours of that pixel."""
    events_at: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (x, y) in enumerate(xy.tolist()):
        events_at[y, x].append(k)
    sites = sorted(events_at)  # raster order
    pixels = np.array([(x, y) for y, x in sites], np.int32).reshape(-1, 2)
    neighbours = {site: {site} for site in sites}
    for a, b in _core.delaunay_edges(pixels).tolist():
        neighbours[sites[a]].add(sites[b])
        neighbours[sites[b]].add(sites[a])
    edges = set()
    for site in sites:
        for k in events_at[site]:
            for other in neighbours[site]:
                before = [m for m in events_at[other] if m < k]
                after = [m for m in events_at[other] if m > k]
                if before:
                    edges.add((before[-1], k))
                if after:
                    edges.add((k, after[0]))
    return edges


def pixel_sets(side: int, max_size: int) -> st.SearchStrategy[np.ndarray]:
    """Distinct pixels, int32 (n, 2), n >= 3."""
    pixel = st.tuples(st.integers(0, side - 1), st.integers(0, side - 1))
    return st.lists(pixel, min_size=3, max_size=max_size, unique=True).map(
        lambda pixels: np.array(pixels, np.int32)
    )


def in_circle(a: list[int], b: list[int], c: list[int], d: list[int]) -> int:
    """Exact, up to the orientation of a, b, c: zero where the four are cocircular or a, b, c collinear."""
    (ax, ay), (bx, by), (cx, cy) = ((p[0] - d[0], p[1] - d[1]) for p in (a, b, c))
    az, bz, cz = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    return az * (bx * cy - by * cx) - bz * (ax * cy - ay * cx) + cz * (ax * by - ay * bx)


def scipy_edges(pixels: np.ndarray) -> set[tuple[int, int]]:
    edges = set()
    for triangle in Delaunay(pixels.astype(np.float64)).simplices:
        a, b, c = sorted(triangle.tolist())
        edges |= {(a, b), (b, c), (a, c)}
    return edges


def triangles(edges: set[tuple[int, int]], pixels: list[list[int]]) -> list[tuple[int, int, int]]:
    """Faces of a triangulation: its 3-cycles that hold no other pixel."""

    def side(a: int, b: int, c: int) -> int:
        (ax, ay), (bx, by), (cx, cy) = pixels[a], pixels[b], pixels[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def holds(a: int, b: int, c: int, d: int) -> bool:
        signs = [side(a, b, d), side(b, c, d), side(c, a, d)]
        return all(s >= 0 for s in signs) or all(s <= 0 for s in signs)

    neighbours = defaultdict(set)
    for a, b in edges:
        neighbours[a].add(b)
    faces = []
    for a, b in sorted(edges):
        for c in sorted(neighbours[a] & neighbours[b]):
            others = (d for d in range(len(pixels)) if d not in (a, b, c))
            if side(a, b, c) != 0 and not any(holds(a, b, c, d) for d in others):
                faces.append((a, b, c) if side(a, b, c) > 0 else (a, c, b))
    return faces


@given(pixel_sets(side=7, max_size=30))
def test_circumcircles_are_empty_and_faces_satisfy_euler(pixels: np.ndarray) -> None:
    edges = set(map(tuple, _core.delaunay_edges(pixels).tolist()))
    points = pixels.tolist()
    assume(np.linalg.matrix_rank(pixels - pixels[0]) == 2)
    faces = triangles(edges, points)
    assert len(points) - len(edges) + len(faces) + 1 == 2
    for a, b, c in faces:
        assert all(in_circle(points[a], points[b], points[c], d) <= 0 for d in points)


@given(pixel_sets(side=200, max_size=14))
@settings(max_examples=60)
def test_equals_scipy_in_general_position(pixels: np.ndarray) -> None:
    points = pixels.tolist()
    n = len(points)
    quadruples = ((a, b, c, d) for a in range(n) for b in range(a) for c in range(b) for d in range(c))
    assume(all(in_circle(*(points[k] for k in quadruple)) != 0 for quadruple in quadruples))
    assume(np.linalg.matrix_rank(pixels - pixels[0]) == 2)
    assert set(map(tuple, _core.delaunay_edges(pixels).tolist())) == scipy_edges(pixels)


@pytest.mark.parametrize("side", [10**3, 2**13, 2**16])
def test_equals_scipy_on_many_random_pixels(side: int) -> None:
    """Edges whose two triangles are cocircular are a matter of taste; the others are not."""
    pixels = np.unique(np.random.default_rng(side).integers(0, side, (3000, 2), dtype=np.int32), axis=0)
    points = pixels.tolist()
    ours = set(map(tuple, _core.delaunay_edges(pixels).tolist()))
    theirs = scipy_edges(pixels)
    neighbours = defaultdict(set)
    for a, b in ours | theirs:
        neighbours[a].add(b)
        neighbours[b].add(a)
    assert len(ours) == len(theirs)
    for a, b in ours ^ theirs:
        shared = sorted(neighbours[a] & neighbours[b])
        ring = [(c, d) for c in shared for d in shared if c < d]
        assert any(in_circle(points[a], points[b], points[c], points[d]) == 0 for c, d in ring)


@given(st.permutations(range(12)), pixel_sets(side=50, max_size=12))
def test_number_of_edges_does_not_depend_on_the_order(order: list[int], pixels: np.ndarray) -> None:
    shuffled = pixels[[k for k in order if k < len(pixels)]]
    assert len(_core.delaunay_edges(shuffled)) == len(_core.delaunay_edges(pixels))


def test_coincident_pixels_are_refused() -> None:
    with pytest.raises(ValueError, match=r"pixel \(4, 7\) appears twice"):
        _core.delaunay_edges(np.array([[4, 7], [0, 0], [4, 7]], np.int32))
    with pytest.raises(ValueError, match=r"shape \(n, 2\)"):
        _core.delaunay_edges(np.zeros((2, 3), np.int32))


@st.composite
def small_windows(draw: st.DrawFn) -> SimpleNamespace:
    width, height = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    n = draw(st.integers(0, 60))
    x = draw(hnp.arrays(np.int64, n, elements=st.integers(0, width - 1)))
    y = draw(hnp.arrays(np.int64, n, elements=st.integers(0, height - 1)))
    t = np.sort(draw(hnp.arrays(np.int64, n, elements=st.integers(0, 5))))  # many ties
    return make_events(np.stack([x, y], axis=1), width, height, t)


@given(small_windows())
def test_equals_the_definition(events: SimpleNamespace) -> None:
    indptr, indices = event_graph(events)
    assert indptr.dtype == np.int64
    assert indices.dtype == np.int32
    assert len(indptr) == len(events.x) + 1
    assert edge_set(indptr, indices) == graph_by_definition(np.stack([events.x, events.y], axis=1))


@given(small_windows())
def test_rows_are_sorted_and_hold_each_edge_once(events: SimpleNamespace) -> None:
    graph = event_graph(events)
    for i in range(len(events.x)):
        row = graph.indices[graph.indptr[i] : graph.indptr[i + 1]].tolist()
        assert row == sorted(set(row))
        assert all(i < j < len(events.x) for j in row)


@given(small_windows(), st.integers(-(2**40), 2**40))
def test_times_and_polarities_play_no_part(events: SimpleNamespace, shift: int) -> None:
    before = event_graph(events)
    events.t = events.t + shift
    events.p = 1 - events.p
    after = event_graph(events)
    assert np.array_equal(before.indptr, after.indptr)
    assert np.array_equal(before.indices, after.indices)


def test_many_events_on_two_pixels() -> None:
    xy = np.zeros((400, 2), np.int64)
    xy[:, 0] = np.random.default_rng(0).integers(0, 2, 400)
    assert edge_set(*event_graph(make_events(xy, 2, 1))) == graph_by_definition(xy)


def test_every_event_has_at_most_two_neighbours_per_neighbouring_pixel() -> None:
    """2 + 2N: counted on a full grid with three events a pixel, where N is at most 8."""
    yx = np.stack(np.meshgrid(np.arange(20), np.arange(30), indexing="ij"), axis=-1).reshape(-1, 2)
    xy = np.random.default_rng(1).permutation(np.tile(yx[:, ::-1], (3, 1)))
    graph = event_graph(make_events(xy, 30, 20))
    assert edge_set(*graph) == graph_by_definition(xy)


def test_an_event_off_the_sensor_is_refused() -> None:
    events = make_events(np.array([[0, 0], [3, 9]]), 10, 9)
    with pytest.raises(ValueError, match=r"event 1 lies at \(3, 9\), outside the sensor of 10x9"):
        event_graph(events)
    events.y = events.y[:1]
    with pytest.raises(ValueError, match="different lengths: x 2, y 1"):
        event_graph(events)


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="needs the shared recordings in ../shared/data")
@pytest.mark.parametrize("name", ["syn_240x180_15k", "syn_640x480_15k"])
def test_reference_windows_equal_the_definition(name: str) -> None:
    window = np.load(REFERENCE / f"{name}.npz")
    xy = np.stack([window["x"], window["y"]], axis=1).astype(np.int64)
    graph = event_graph(make_events(xy, int(window["width"]), int(window["height"])))
    assert edge_set(*graph) == graph_by_definition(xy)
