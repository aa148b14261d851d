"""The native kernels beside their peers: equal answers first, then CPU time.

``python -m bench.kernels [--only KERNEL …] [--events N] [--json FILE]``
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

import emseg
from bench import cuts, windows
from bench.common import (
    Row,
    circumstances,
    cpu_times,
    print_circumstances,
    print_rows,
    require,
    write_json,
)
from bench.event_instances import made_events
from bench.numba_peer import warp_and_vote
from bench.published import reference_window
from bench.start_up import bench_start_up
from bench.windows import BenchWindow
from emseg import _core
from emseg import reference as numpy_reference
from emseg.motion import middle_time, points, warp_frame
from emseg.reference.fit import central_difference, one_pixel_step

try:
    import eventcv
except ImportError:
    eventcv = None

WIDTH, HEIGHT = 346, 260
EVENTS = 30_000
REPEATS = 9
STEP = 1e-6  # px, of central differences: votes are piecewise smooth, and larger steps cross the seams
FIT_REPEATS = 3
AFFINE = (180.0, -90.0, 0.3, -0.2, 0.25, 0.1)  # px/s and 1/s: some pixels over the made events' 50 ms
SIMILARITY = (180.0, -90.0, 0.3, 0.8)

Integers = NDArray[np.int64]


def made_window(events: int, seed: int = 0) -> BenchWindow:
    """Events of drifting edges over 50 ms on a 346x260 sensor."""
    x, y, t = made_events(events, WIDTH, HEIGHT, seed=seed)
    array = emseg.EventArray(
        x, y, np.rint(1e6 * t).astype(np.int64), np.arange(events) % 2, width=WIDTH, height=HEIGHT
    )
    return BenchWindow(f"made {WIDTH}x{HEIGHT}", array)


# --- graph -------------------------------------------------------------------------------------------------


def active_pixels(events: emseg.EventArray) -> NDArray[np.int32]:
    """Pixels that hold events, (m, 2), in raster order."""
    code = np.unique(events.y.astype(np.int64) * events.width + events.x)
    return np.column_stack([code % events.width, code // events.width]).astype(np.int32)


def check_triangulation(
    pixels: NDArray[np.int32], ours: NDArray[np.int32], theirs: NDArray[np.int32]
) -> None:
    """Both are Delaunay triangulations of the pixels: they differ in diagonals of cocircular pixels only.

    Triangulations of the same pixels have equally many edges.  Where two of them differ an edge of one
    crosses edges of the other, and each such pair must lie on one circle.
    """
    require(len(ours) == len(theirs), f"{len(ours)} Delaunay edges, CGAL has {len(theirs)}")
    mine, other = set(map(tuple, ours.tolist())), set(map(tuple, theirs.tolist()))
    only_ours = pixels[np.array(sorted(mine - other), dtype=np.int64).reshape(-1, 2)].astype(np.int64)
    only_theirs = pixels[np.array(sorted(other - mine), dtype=np.int64).reshape(-1, 2)].astype(np.int64)
    if len(only_ours) == 0:
        return
    longest = max(np.linalg.norm(edge[:, 1] - edge[:, 0], axis=1).max() for edge in (only_ours, only_theirs))
    near = cKDTree(only_ours.mean(axis=1)).query_ball_tree(cKDTree(only_theirs.mean(axis=1)), longest)
    a, b = only_ours[np.repeat(np.arange(len(near)), [len(n) for n in near])].transpose(1, 2, 0)
    c, d = only_theirs[np.concatenate(near).astype(np.int64)].transpose(1, 2, 0)
    crosses = (_turn(a, b, c) * _turn(a, b, d) < 0) & (_turn(c, d, a) * _turn(c, d, b) < 0)
    require(bool(crosses.any()), "edges differ from CGAL's without crossing them")
    require(not _in_circle(a, b, c, d)[crosses].any(), "an edge crosses one of CGAL's off its circle")
    crossing = np.repeat(np.arange(len(near)), [len(n) for n in near])[crosses]
    require(len(np.unique(crossing)) == len(near), "an edge that CGAL lacks crosses none of its edges")


def _turn(a: Integers, b: Integers, c: Integers) -> Integers:
    """Above, below or at zero as c (2, n) lies left of, right of or on the line from a to b; exact."""
    return np.asarray((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _in_circle(a: Integers, b: Integers, c: Integers, d: Integers) -> Integers:
    """Zero where the four (2, n) lie on one circle; exact."""
    a, b, c = a - d, b - d, c - d
    lift = [(p * p).sum(axis=0) for p in (a, b, c)]
    return np.asarray(
        lift[0] * (b[0] * c[1] - b[1] * c[0])
        - lift[1] * (a[0] * c[1] - a[1] * c[0])
        + lift[2] * (a[0] * b[1] - a[1] * b[0])
    )


def bench_graph(events: int) -> list[Row]:
    """The space-time graph, and our triangulation alone, beside others' triangulations of the same pixels."""
    wanted = [name for name in windows.names() if name.endswith("_30k")] if events == EVENTS else []
    rows = []
    for window in [windows.load(name) for name in wanted] or [made_window(events)]:
        pixels = active_pixels(window.events)
        triangulation, bare = _core.delaunay_edges(pixels), _core.delaunay_edges_cgal(pixels)
        check_triangulation(pixels, triangulation, bare)
        graph, ours, cgal, scipy = cpu_times(
            [
                lambda: emseg.event_graph(window.events),  # noqa: B023
                lambda: _core.delaunay_edges(pixels),  # noqa: B023
                lambda: _core.delaunay_edges_cgal(pixels),  # noqa: B023
                lambda: Delaunay(pixels),  # noqa: B023
            ],
            REPEATS,
        )
        require(len(graph.result.indptr) == len(window.events) + 1, "a row of the graph for every event")
        what = f"{window.name}, {len(window.events)} events at {len(pixels)} pixels"
        for name, run, target in (("graph", graph, "≤ 6 ms, ≤ CGAL"), ("triangulation", ours, "")):
            for peer, its in (("bare CGAL", cgal), ("SciPy Delaunay", scipy)):
                rows.append(Row(f"{name}, {what}", 1e3 * run.cpu_s, peer, 1e3 * its.cpu_s, target))
    return rows


# --- image of warped events --------------------------------------------------------------------------------


def bench_iwe(events: int) -> list[Row]:
    """Warp and bilinear vote, clearing the image included; and numba's votes alone."""
    window = made_window(events)
    x, y, dt = points(window.events, middle_time(window.events), None)
    frame = warp_frame(window.events, None)
    field, centre = np.array(AFFINE, np.float32), np.array([frame.cx, frame.cy], np.float32)
    image = np.empty((HEIGHT, WIDTH), np.float32)
    workspace = _core.IweWorkspace()
    seen = reference_window(window, t_ref=float(middle_time(window.events)))
    model = numpy_reference.MotionModel("affine", AFFINE)
    places = numpy_reference.warp(model, seen)
    ours, fused, votes = cpu_times(
        [
            lambda: _core.iwe(x, y, dt, "affine", AFFINE, frame, WIDTH, HEIGHT, 0.0, workspace),
            lambda: warp_and_vote(x, y, dt, field, centre, image),
            lambda: numpy_reference.bilinear_votes(places, WIDTH, HEIGHT),
        ],
        REPEATS,
    )
    truth = votes.result
    for name, result in (("ours", ours.result), ("numba", fused.result)):
        worst = np.abs(result - truth).max() / max(1.0, truth.max())
        require(worst <= 1e-4, f"{name}'s image is off the reference by {worst:.1e}, expected 1e-4")
    rate = f"{len(x) / ours.cpu_s / 1e6:.0f} Mev/s"
    what = f"warp + vote, affine, {events} events, {WIDTH}x{HEIGHT}: {rate}"
    target = "≥ 1.5×" if events < 300_000 else "≥ 2×"
    return [
        Row(what, 1e3 * ours.cpu_s, "numba, fused, float32", 1e3 * fused.cpu_s, target),
        Row(what, 1e3 * ours.cpu_s, "reference's votes alone, numba", 1e3 * votes.cpu_s),
    ]


def bench_contrast(events: int) -> list[Row]:
    """Variance of the blurred image and its gradient by six parameters."""
    window = made_window(events)
    x, y, dt = points(window.events, middle_time(window.events), None)
    frame = warp_frame(window.events, None)
    seen = reference_window(window, t_ref=float(middle_time(window.events)))
    pixel = one_pixel_step("affine", seen)
    workspace = _core.ContrastWorkspace()

    def value(pixels: NDArray[np.float64]) -> float:
        params = np.array(AFFINE) + pixels * pixel
        model = numpy_reference.MotionModel("affine", tuple(params.tolist()))
        return numpy_reference.variance(numpy_reference.iwe(model, seen))

    ours, reference = cpu_times(
        [
            lambda: _core.contrast(x, y, dt, "affine", AFFINE, frame, WIDTH, HEIGHT, workspace=workspace),
            lambda: (value(np.zeros(6)), central_difference(value, np.zeros(6), STEP)),
        ],
        REPEATS,
    )
    contrast, gradient = ours.result
    expected, expected_gradient = reference.result
    require(
        abs(contrast - expected) <= 1e-4 * expected, f"contrast {contrast}, the reference's is {expected}"
    )
    worst = np.abs(gradient * pixel - expected_gradient).max() / np.abs(expected_gradient).max()
    require(worst <= 1e-4, f"the gradient is off central differences by {worst:.1e}, expected 1e-4")
    what = f"contrast + gradient, affine, {events} events, {WIDTH}x{HEIGHT}"
    peer = "reference, central differences"
    return [Row(what, 1e3 * ours.cpu_s, peer, 1e3 * reference.cpu_s, "≤ 0.15 ms")]


# --- motion fit --------------------------------------------------------------------------------------------


def one_motion(events: int, velocity: tuple[float, float], seed: int = 1) -> BenchWindow:
    """Points that drift together for 40 ms, with a third of a pixel of jitter."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 40_000, events))
    start = rng.uniform((0, 0), (WIDTH, HEIGHT), (max(1, events // 15), 2))[
        rng.integers(0, max(1, events // 15), events)
    ]
    place = start + np.outer((t - 20_000) * 1e-6, velocity) + rng.normal(0, 0.3, (events, 2))
    x, y = np.rint(place).astype(np.int64).T
    inside = (x >= 0) & (x < WIDTH) & (y >= 0) & (y < HEIGHT)
    array = emseg.EventArray(
        x[inside], y[inside], t[inside], np.arange(inside.sum()) % 2, width=WIDTH, height=HEIGHT
    )
    return BenchWindow("one motion", array)


def bench_fit(events: int) -> list[Row]:
    """One translation by contrast maximisation, from no knowledge."""
    velocity = (310.0, -140.0)
    window = one_motion(events, velocity)
    t_ref = middle_time(window.events)
    seen = reference_window(window, t_ref=float(t_ref))
    options = numpy_reference.FitOptions(kind="translation")

    def by_scipy() -> NDArray[np.float64]:
        return np.array(numpy_reference.fit_motion(seen, options)[0].params)

    runs: dict[str, Callable[[], NDArray[np.float64]]] = {
        "ours": lambda: emseg.fit_motion(window.events, "translation", t_ref=t_ref)[0].params,
        "SciPy on the reference": by_scipy,
    }
    if eventcv is not None:
        columns = np.column_stack([window.events.x, window.events.y, window.events.t, window.events.p])
        stream = eventcv.from_numpy(columns.astype(np.float64), sensor_size=(WIDTH, HEIGHT), time_unit="us")
        runs["eventcv contrast_maximise"] = lambda: np.array(
            stream.contrast_maximise(blur_sigma=1.0)["params"]
        )
    timed = dict(zip(runs, cpu_times(list(runs.values()), FIT_REPEATS), strict=True))

    def contrast(params: NDArray[np.float64]) -> float:
        model = numpy_reference.MotionModel("translation", tuple(params.tolist()))
        return numpy_reference.variance(numpy_reference.iwe(model, seen))

    ours = timed.pop("ours")
    off = float(np.linalg.norm(ours.result - velocity)) * 0.04
    require(off <= 0.2, f"the fit is {off:.2f} px off the true motion over the window, expected 0.2")
    rows = []
    targets = {"SciPy on the reference": "≥ 200×", "eventcv contrast_maximise": "≥ 50×"}
    for peer, its in timed.items():
        reached, peer_reached = contrast(ours.result), contrast(its.result)
        require(
            reached >= peer_reached * (1 - 1e-4), f"contrast {reached} reached, {peer} reaches {peer_reached}"
        )
        reaching = f"contrast {reached:.4g}, peer {peer_reached:.4g}"
        what = f"motion fit, translation, {len(window.events)} events ({reaching})"
        rows.append(Row(what, 1e3 * ours.cpu_s, peer, 1e3 * its.cpu_s, targets[peer]))
    return rows


KERNELS: dict[str, Callable[[int], list[Row]]] = {
    "graph": bench_graph,
    "iwe": lambda events: bench_iwe(events) + (bench_iwe(1_000_000) if events >= EVENTS else []),
    "contrast": lambda events: bench_contrast(min(events, 20_000)),
    "fit": bench_fit,
    "max_flow": lambda events: cuts.bench_max_flow(100_000 if events >= EVENTS else events),
    "expansion": lambda events: cuts.bench_expansions(events),
    "start_up": lambda _: bench_start_up(),
}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=tuple(KERNELS), default=tuple(KERNELS))
    parser.add_argument("--events", type=int, default=EVENTS, help="fewer for a quick look")
    parser.add_argument("--json", type=Path, help="also write the rows here")
    options = parser.parse_args(arguments)
    found: dict[str, Any] = circumstances()
    print_circumstances(found)
    rows = [row for kernel in options.only for row in KERNELS[kernel](options.events)]
    print_rows(rows)
    if options.json:
        write_json(options.json, found, events=options.events, rows=[row.as_dict() for row in rows])


if __name__ == "__main__":
    main()
