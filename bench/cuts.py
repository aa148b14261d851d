"""Max-flow and expansion beside PyMaxflow and gco: equal answers first, then CPU time.

``python -m bench.cuts [--json PATH]``
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import maxflow
import numpy as np
from numpy.typing import NDArray

from bench.common import (
    Row,
    circumstances,
    cpu_time,
    cpu_times,
    print_circumstances,
    print_rows,
    require,
    write_json,
)
from bench.event_instances import made_events, published_unary, rows_of, space_time_edges
from bench.windows import REFERENCE_DIR
from emseg.graph_cut import expansion, labeling_energy, max_flow

try:
    import gco
except ImportError:
    gco = None

SMOOTHNESS, LABEL_COST, LABELS = 30, 8000, 12  # published values; 12 labels as in the target


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
        ours, theirs = cpu_times(
            [
                lambda: max_flow(events, edges, smoothness, smoothness, source, sink)[0],  # noqa: B023
                lambda: flow_by_pymaxflow(events, edges, smoothness, bias),  # noqa: B023
            ],
            5,
        )
        require(ours.result == theirs.result, f"flows differ: ours {ours.result}, PyMaxflow {theirs.result}")
        what = f"max-flow, {events} nodes, {len(edges)} edges, noise {noise}"
        rows.append(Row(what, 1e3 * ours.cpu_s, "PyMaxflow", 1e3 * theirs.cpu_s, "≥ 2×"))
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
    """CPU seconds of the expansion alone, its graph built before, and the energy."""
    graph = gco.GCOGeneralGraph(len(labels), LABELS)
    graph.set_data_cost(problem.unary.astype(np.float64))
    graph.set_smooth_cost(SMOOTHNESS * (1.0 - np.eye(LABELS)))
    for i, j in problem.edges.tolist():
        graph.set_neighbors(i, j, 1.0)
    graph.set_label_cost(float(LABEL_COST))
    for site, label in enumerate(labels.tolist()):
        graph.set_label(site, label)
    start = time.process_time()
    graph.expansion(100)
    return time.process_time() - start, round(graph.energy)


def bench_expansion(problem: Labelling) -> list[Row]:
    initial = problem.unary.argmin(axis=1)
    ours = cpu_time(
        lambda: expansion(problem.unary, problem.indptr, problem.indices, SMOOTHNESS, LABEL_COST, initial), 5
    )
    labels, energy = ours.result
    require(
        energy == problem.energy(labels), f"{energy} reported for labels of energy {problem.energy(labels)}"
    )
    start = time.process_time()  # once: it takes seconds
    peer_energy = expansion_by_pymaxflow(problem, initial)
    peers = [("PyMaxflow in a loop", time.process_time() - start, peer_energy)]
    if gco is not None:
        peers.append(("gco", *expansion_by_gco(problem, initial)))
    for peer, _, peer_energy in peers:
        require(
            energy <= peer_energy, f"our energy {energy} is above {peer}'s {peer_energy} on {problem.name}"
        )
    what = f"expansion, {problem.name}, {len(labels)} sites, {len(problem.edges)} edges, {LABELS} labels"
    return [Row(what, 1e3 * ours.cpu_s, peer, 1e3 * spent, "≥ 20×") for peer, spent, _ in peers]


def bench_expansions(events: int = 30_000) -> list[Row]:
    """Expansion on the reference windows of 30k events; on made costs without them or for fewer."""
    labellings = reference_labellings() if events >= 30_000 else []
    if not labellings:
        print(f"made costs; reference windows would be in {REFERENCE_DIR}", file=sys.stderr)
        labellings = [made_labelling(events)]
    return [row for problem in labellings for row in bench_expansion(problem)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="also write the rows here")
    parser.add_argument("--nodes", type=int, default=100_000, help="nodes of the max-flow graph")
    options = parser.parse_args(arguments)
    found = circumstances()
    print_circumstances(found)
    rows = bench_max_flow(options.nodes) + bench_expansions()
    print_rows(rows)
    if options.json:
        write_json(options.json, found, rows=[row.as_dict() for row in rows])


if __name__ == "__main__":
    main()
