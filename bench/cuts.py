"""Max-flow and expansion beside PyMaxflow and gco: equal answers first, then CPU time.

``python -m bench.cuts [--json PATH]``
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import maxflow
import numpy as np
from numpy.typing import NDArray

from bench.event_instances import (
    REFERENCE_DIR,
    made_events,
    published_unary,
    rows_of,
    space_time_edges,
)
from emseg.graph_cut import expansion, labeling_energy, max_flow

try:
    import gco
except ImportError:
    gco = None

SMOOTHNESS, LABEL_COST, LABELS = 30, 8000, 12  # published values; 12 labels as in the target
Result = TypeVar("Result")


class Row(NamedTuple):
    what: str
    ours_ms: float
    peer: str
    peer_ms: float

    @property
    def ratio(self) -> float:
        return self.peer_ms / self.ours_ms


def cpu_ms(run: Callable[[], Result], repeat: int) -> tuple[float, Result]:
    """Least CPU time of several runs, and the last run's result."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        result = run()
        times.append(1e3 * (time.process_time() - start))
    return min(times), result


# --- maximum flow ------------------------------------------------------------------------------------------


def flow_by_pymaxflow(n: int, edges: NDArray[Any], smoothness: NDArray[Any], bias: NDArray[Any]) -> int:
    graph = maxflow.Graph[int](n, len(edges))
    nodes = graph.add_nodes(n)
    graph.add_edges(edges[:, 0], edges[:, 1], smoothness, smoothness)
    graph.add_grid_tedges(nodes, np.maximum(bias, 0), np.maximum(-bias, 0))
    return int(graph.maxflow())


def bench_max_flow(events: int) -> list[Row]:
    """Two regions under noise, on a space-time graph; smoothness 30 as published."""
    x, y, t = made_events(events, 346, 260, seed=0)
    edges = space_time_edges(x, y, t)
    smoothness = np.full(len(edges), SMOOTHNESS)
    region = np.where((x // 60 + y // 60) % 2 == 1, 30, -30)
    rows = []
    for noise in (20, 60, 200):
        bias = region + np.round(np.random.default_rng(1).normal(0, noise, events)).astype(np.int64)
        source, sink = np.maximum(bias, 0), np.maximum(-bias, 0)
        ours, (flow, _) = cpu_ms(lambda: max_flow(events, edges, smoothness, smoothness, source, sink), 5)  # noqa: B023
        theirs, peer_flow = cpu_ms(lambda: flow_by_pymaxflow(events, edges, smoothness, bias), 3)  # noqa: B023
        if flow != peer_flow:
            raise AssertionError(f"flows differ: ours {flow}, PyMaxflow {peer_flow}")
        what = f"max-flow, {events} nodes, {len(edges)} edges, noise {noise}"
        rows.append(Row(what, ours, "PyMaxflow", theirs))
    return rows


# --- expansion with label costs ----------------------------------------------------------------------------


class Labelling(NamedTuple):
    name: str
    unary: NDArray[np.int32]
    edges: NDArray[np.int64]
    indptr: NDArray[np.int64]
    indices: NDArray[np.int32]

    def energy(self, labels: NDArray[Any]) -> int:
        energy = labeling_energy(self.unary, self.indptr, self.indices, SMOOTHNESS, LABEL_COST, labels)
        return int(energy)


def reference_labellings() -> list[Labelling]:
    """Reference windows, their true models and others of the published search, published data term."""
    found = []
    for path in sorted(REFERENCE_DIR.glob("syn_*_30k.npz")):
        window = np.load(path)
        x, y, t = window["x"].astype(np.int64), window["y"].astype(np.int64), window["t"]
        others = np.random.default_rng(0).permutation(window["pool_translation_pool"])
        models = np.vstack([window["models"], others])[:LABELS]
        unary = published_unary(x, y, t, models, int(window["width"]), int(window["height"]))
        edges = space_time_edges(x, y, t)
        found.append(Labelling(path.stem, unary, edges, *rows_of(edges, len(x))))
    return found


def made_labelling(events: int = 30000) -> Labelling:
    """Stands in where the reference windows are absent: noisy costs of a checkerboard of four labels."""
    x, y, t = made_events(events, 346, 260, seed=2)
    rng = np.random.default_rng(3)
    unary = rng.integers(120, 256, (events, LABELS)).astype(np.int32)
    unary[np.arange(events), (x // 90 + 2 * (y // 90)) % 4] -= 50
    edges = space_time_edges(x, y, t)
    return Labelling("made", unary, edges, *rows_of(edges, events))


def move_by_pymaxflow(problem: Labelling, labels: NDArray[Any], alpha: int) -> NDArray[Any]:
    """One expansion with a hub node per label, as the paper draws it."""
    active = np.flatnonzero(labels != alpha)
    node = np.full(len(labels), -1)
    node[active] = np.arange(len(active))
    u, v = node[problem.edges[:, 0]], node[problem.edges[:, 1]]
    both = (u >= 0) & (v >= 0)
    equal = labels[problem.edges[:, 0]] == labels[problem.edges[:, 1]]
    keep = problem.unary[active, labels[active]].astype(np.int64)
    for ends in (u[(u >= 0) & (v < 0)], v[(v >= 0) & (u < 0)], u[both & ~equal]):
        keep += SMOOTHNESS * np.bincount(ends, minlength=len(active))
    used = [label for label in np.unique(labels) if label != alpha]
    graph = maxflow.Graph[int](len(active) + len(used), int(both.sum()) + len(active))
    nodes = graph.add_nodes(len(active))
    graph.add_grid_tedges(nodes, problem.unary[active, alpha], keep)
    smoothness = np.full(int(both.sum()), SMOOTHNESS)
    graph.add_edges(u[both], v[both], np.where(equal[both], SMOOTHNESS, 0), smoothness)
    for label in used:
        hub = graph.add_nodes(1)[0]
        graph.add_tedge(hub, 0, LABEL_COST)
        sites = np.flatnonzero(labels[active] == label)
        graph.add_edges(
            sites, np.full(len(sites), hub), np.full(len(sites), 10**8), np.zeros(len(sites), int)
        )
    graph.maxflow()
    moved = labels.copy()
    moved[active[graph.get_grid_segments(nodes)]] = alpha
    return moved


def expansion_by_pymaxflow(problem: Labelling, labels: NDArray[Any]) -> int:
    energy = problem.energy(labels)
    while True:
        before = energy
        for alpha in range(LABELS):
            moved = move_by_pymaxflow(problem, labels, alpha)
            if problem.energy(moved) < energy:
                labels, energy = moved, problem.energy(moved)
        if energy == before:
            return energy


def expansion_by_gco(problem: Labelling, labels: NDArray[Any]) -> tuple[float, int]:
    """CPU time of the expansion alone, its graph built before, and the energy."""
    graph = gco.GCOGeneralGraph(len(labels), LABELS)
    graph.set_data_cost(problem.unary.astype(np.float64))
    graph.set_smooth_cost(SMOOTHNESS * (1.0 - np.eye(LABELS)))
    for i, j in problem.edges.tolist():
        graph.set_neighbors(i, j, 1.0)
    graph.set_label_cost(float(LABEL_COST))
    for site, label in enumerate(labels.tolist()):
        graph.set_label(site, label)
    spent, _ = cpu_ms(lambda: graph.expansion(100), 1)
    return spent, round(graph.energy)


def bench_expansion(problem: Labelling) -> list[Row]:
    initial = problem.unary.argmin(axis=1)
    ours, (labels, energy) = cpu_ms(
        lambda: expansion(problem.unary, problem.indptr, problem.indices, SMOOTHNESS, LABEL_COST, initial), 5
    )
    if energy != problem.energy(labels):
        raise AssertionError(f"expansion reports {energy} for labels of energy {problem.energy(labels)}")
    what = f"expansion, {problem.name}, {len(labels)} sites, {len(problem.edges)} edges, {LABELS} labels"
    theirs, peer_energy = cpu_ms(lambda: expansion_by_pymaxflow(problem, initial), 1)
    peers = [("PyMaxflow in a loop", theirs, peer_energy)]
    if gco is not None:
        peers.append(("gco", *expansion_by_gco(problem, initial)))
    for peer, _, peer_energy in peers:
        if energy > peer_energy:
            raise AssertionError(f"our energy {energy} is above {peer}'s {peer_energy} on {problem.name}")
    return [Row(what, ours, peer, spent) for peer, spent, _ in peers]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="also write the rows here")
    parser.add_argument("--nodes", type=int, default=100_000, help="nodes of the max-flow graph")
    arguments = parser.parse_args()

    labellings = reference_labellings()
    if not labellings:
        print(f"no reference windows in {REFERENCE_DIR}: made costs instead", file=sys.stderr)
        labellings = [made_labelling()]
    rows = bench_max_flow(arguments.nodes)
    for problem in labellings:
        rows += bench_expansion(problem)
    print(f"{'CPU time, ms':<72}{'ours':>9}{'peer':>9}{'ratio':>7}")
    for row in rows:
        print(f"{row.what:<72}{row.ours_ms:9.1f}{row.peer_ms:9.1f}{row.ratio:7.1f}  {row.peer}")
    if arguments.json:
        arguments.json.write_text(
            json.dumps([row._asdict() | {"ratio": row.ratio} for row in rows], indent=2)
        )


if __name__ == "__main__":
    main()
