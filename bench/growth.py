"""How time and memory grow with events, labels and threads.

``python -m bench.growth [--only PART …] [--events N …] [--size WxH] [--pools N …] [--threads N …]
[--plot FOLDER] [--json FILE]``
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

import emseg
from bench.common import (
    circumstances,
    cpu_time,
    number,
    print_circumstances,
    print_table,
    require,
    write_json,
)
from bench.event_instances import published_unary
from bench.fresh import run_fresh
from bench.moving_outlines import VELOCITIES, moving_outlines
from bench.windows import BenchWindow
from emseg.graph_cut import expansion, labeling_energy
from emseg.metrics import one_to_one_accuracy

EVENTS: Final = (10_000, 30_000, 100_000, 300_000, 1_000_000)
POOLS: Final = (5, 10, 20, 50, 100)
SHARED_EVENTS: Final = 30_000  # of the windows for pools and threads
FITTING: Final = ("model_pool", "refit")  # stages that fit motions
FASTEST: Final = 300.0  # px/s, of the pool's further motions
LAMBDA_SMOOTH, LAMBDA_LABEL = 30, 8000
# The true labels are of motions, and the outlines have no signs.
CONFIG: Final = emseg.Config(background="widest", polarity="ignored")


def check(window: BenchWindow, found: emseg.Segmentation) -> None:
    """What must hold of a segmentation before its time is worth reporting."""
    require(len(found.labels) == len(window.events), f"{window.name}: {len(found.labels)} labels")
    require(
        all(after <= before for before, after in pairwise(found.energy_trace)),
        f"{window.name}: the energy rises: {found.energy_trace}",
    )
    known = {model.label for model in found.models} | {-1}
    require(set(np.unique(found.labels).tolist()) <= known, f"{window.name}: labels without a motion")


def stage_shares(cpu_s: float, results: Sequence[emseg.Segmentation]) -> dict[str, float]:
    """CPU seconds of every stage of one thread: its share of the engine's wall time, of all CPU time."""
    walls = {stage: statistics.median(r.timings[stage] for r in results) for stage in results[0].timings}
    return {stage: cpu_s * wall / sum(walls.values()) for stage, wall in walls.items()}


def accuracy(window: BenchWindow, found: emseg.Segmentation) -> float:
    assert window.truth is not None
    return one_to_one_accuracy(window.truth, found.labels)


# --- windows -----------------------------------------------------------------------------------------------


def memory_mb(window: BenchWindow) -> float:
    """Peak memory that a cold segmentation adds to a fresh process that holds the events."""
    events = window.events
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "window.npz"
        columns = {name: getattr(events, name) for name in "xytp"}
        np.savez(path, allow_pickle=False, width=events.width, height=events.height, **columns)
        settings = json.dumps(asdict(replace(CONFIG, threads=1)))
        return float(run_fresh(str(path), settings)["peak_mb_over_events"])


def bench_events(events: int, width: int, height: int, repeats: int) -> dict[str, Any]:
    """One cold window, by one thread."""
    window = moving_outlines(events, width, height)
    config = replace(CONFIG, threads=1)
    timed = cpu_time(lambda: emseg.segment(window.events, config=config), repeats)
    check(window, timed.result)
    return {
        "size": window.name,
        "events": events,
        "cpu_s": timed.cpu_s,
        "stages_cpu_s": stage_shares(timed.cpu_s, timed.results),
        "peak_mb_over_events": memory_mb(window),
        "labels": len(timed.result.models),
        "accuracy": accuracy(window, timed.result),
    }


def exponents(rows: Sequence[dict[str, Any]], key: str) -> dict[str, float]:
    """Exponents of power laws in rows[key] fitted to the times of all stages and of each, in logarithms."""

    def fitted(times: Sequence[float]) -> float:
        sizes = [math.log(row[key]) for row in rows]
        return float(np.polyfit(sizes, np.log(np.maximum(times, 1e-9)), 1)[0])

    found = {"all": fitted([row["cpu_s"] for row in rows])}
    for stage in rows[0]["stages_cpu_s"]:
        found[stage] = fitted([row["stages_cpu_s"][stage] for row in rows])
    return found


def local_exponents(rows: Sequence[dict[str, Any]], key: str) -> list[float | None]:
    """The exponent from every row's predecessor to it: where growth bends."""
    return [
        None,
        *(
            math.log(after["cpu_s"] / before["cpu_s"]) / math.log(after[key] / before[key])
            for before, after in pairwise(rows)
        ),
    ]


# --- pools of labels ---------------------------------------------------------------------------------------


def motion_pool(labels: int) -> list[emseg.MotionModel]:
    """The true motions, and others at random; a larger pool holds the smaller one."""
    others = np.random.default_rng(5).uniform(-FASTEST, FASTEST, (max(POOLS) * 10, 2))
    velocities = [*VELOCITIES, *map(tuple, others.tolist())][:labels]
    return [emseg.MotionModel("translation", velocity) for velocity in velocities]


def bench_pool(labels: int, width: int, height: int, repeats: int) -> dict[str, Any]:
    """A whole window with a given pool, and expansion alone with the published data term."""
    window = moving_outlines(SHARED_EVENTS, width, height)
    events, pool, config = window.events, motion_pool(labels), replace(CONFIG, threads=1)
    timed = cpu_time(lambda: emseg.segment(events, config=config, pool=pool), repeats)
    check(window, timed.result)
    models = np.array([[*model.params, 0.0, 0.0] for model in pool])
    x, y, t = (column.astype(kind) for column, kind in ((events.x, int), (events.y, int), (events.t, float)))
    unary = published_unary(x, y, 1e-6 * t, models, width, height)
    graph = emseg.event_graph(events)
    problem = (unary, graph.indptr, graph.indices, LAMBDA_SMOOTH, LAMBDA_LABEL)
    alone = cpu_time(lambda: expansion(*problem), repeats)
    found, energy = alone.result
    require(
        energy == labeling_energy(*problem, found), f"{labels} labels: energy {energy} is not the labels'"
    )
    single = int(unary.sum(axis=0).min()) + LAMBDA_LABEL
    require(energy <= single, f"{labels} labels: energy {energy}, a single one has {single}")
    return {
        "size": f"{labels} labels",
        "pool_labels": labels,
        "cpu_s": timed.cpu_s,
        "stages_cpu_s": stage_shares(timed.cpu_s, timed.results),
        "expansion_cpu_s": alone.cpu_s,
        "expansion_energy": energy,
        "accuracy": accuracy(window, timed.result),
    }


# --- threads -----------------------------------------------------------------------------------------------


def bench_threads(threads: Sequence[int], width: int, height: int, repeats: int) -> list[dict[str, Any]]:
    """One cold window by several numbers of threads, in turns: medians."""
    window = moving_outlines(SHARED_EVENTS, width, height)
    configs = {count: replace(CONFIG, threads=count) for count in threads}
    runs: dict[int, list[tuple[float, float, emseg.Segmentation]]] = {count: [] for count in threads}
    for turn in range(repeats + 1):
        for count, config in configs.items():
            cpu, start = time.process_time(), time.perf_counter()
            found = emseg.segment(window.events, config=config)
            if turn:  # the first warms up
                runs[count].append((time.perf_counter() - start, time.process_time() - cpu, found))
    first = runs[threads[0]][0][2]
    check(window, first)
    rows = []
    for count, timed in runs.items():
        same = all(np.array_equal(found.labels, first.labels) for _, _, found in timed)
        require(same, f"labels by {count} threads differ from those by {threads[0]}")
        stages = {stage: statistics.median(f.timings[stage] for _, _, f in timed) for stage in first.timings}
        rows.append(
            {
                "size": window.name,
                "threads": count,
                "wall_s": statistics.median(wall for wall, _, _ in timed),
                "cpu_s": statistics.median(cpu for _, cpu, _ in timed),
                "fitting_wall_s": sum(stages.get(stage, 0.0) for stage in FITTING),
                "stages_wall_s": stages,
            }
        )
    return rows


# --- tables ------------------------------------------------------------------------------------------------


def milliseconds(times: dict[str, float]) -> list[str]:
    return [f"{1e3 * seconds:.1f}" for seconds in times.values()]


def print_events(rows: Sequence[dict[str, Any]]) -> None:
    stages = list(rows[0]["stages_cpu_s"])
    heading = ("CPU ms, one thread", *stages, "all", "exponent from the last", "MB", "labels", "accuracy")
    table = [
        (
            row["size"],
            *milliseconds(row["stages_cpu_s"]),
            f"{1e3 * row['cpu_s']:.1f}",
            number(local, ".2f"),
            f"{row['peak_mb_over_events']:.0f}",
            str(row["labels"]),
            f"{row['accuracy']:.3f}",
        )
        for row, local in zip(rows, local_exponents(rows, "events"), strict=True)
    ]
    if len(rows) > 1:
        fitted = exponents(rows, "events")
        cells = (f"{fitted[stage]:.2f}" for stage in (*stages, "all"))
        table.append(("exponent of the events", *cells, *["–"] * 4))
    print_table(heading, table)


def print_pools(rows: Sequence[dict[str, Any]]) -> None:
    stages = list(rows[0]["stages_cpu_s"])
    heading = ("CPU ms, given pool of", *stages, "all", "exponent", "expansion alone", "accuracy")
    table = [
        (
            row["size"],
            *milliseconds(row["stages_cpu_s"]),
            f"{1e3 * row['cpu_s']:.1f}",
            number(local, ".2f"),
            f"{1e3 * row['expansion_cpu_s']:.1f}",
            f"{row['accuracy']:.3f}",
        )
        for row, local in zip(rows, local_exponents(rows, "pool_labels"), strict=True)
    ]
    print_table(heading, table)


def print_threads(rows: Sequence[dict[str, Any]]) -> None:
    stages = list(rows[0]["stages_wall_s"])
    heading = ("wall ms, threads", *stages, "all", "CPU ms", "fitting, times as fast", "all, times as fast")
    table = [
        (
            str(row["threads"]),
            *milliseconds(row["stages_wall_s"]),
            f"{1e3 * row['wall_s']:.1f}",
            f"{1e3 * row['cpu_s']:.1f}",
            f"{rows[0]['fitting_wall_s'] / max(row['fitting_wall_s'], 1e-9):.2f}",
            f"{rows[0]['wall_s'] / row['wall_s']:.2f}",
        )
        for row in rows
    ]
    print_table(heading, table)


PRINT: Final[dict[str, Callable[[Sequence[dict[str, Any]]], None]]] = {
    "events": print_events,
    "pools": print_pools,
    "threads": print_threads,
}


# --- the command -------------------------------------------------------------------------------------------


def sensor(text: str) -> tuple[int, int]:
    """Width and height from "640x480"."""
    width, _, height = text.partition("x")
    return int(width), int(height)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=tuple(PRINT), default=tuple(PRINT))
    parser.add_argument("--events", type=int, nargs="+", default=list(EVENTS), help="of the windows")
    parser.add_argument("--size", type=sensor, default=(640, 480), help="of the sensor, as 640x480")
    parser.add_argument("--pools", type=int, nargs="+", default=list(POOLS), help="labels of the pools")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeats", type=int, default=3, help="medians are shown; long runs are timed once")
    parser.add_argument("--plot", type=Path, help="also draw the growth here, as SVG (needs Matplotlib)")
    parser.add_argument("--json", type=Path, help="also write everything here")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    found = circumstances()
    print_circumstances(found)
    (width, height), repeats = options.size, options.repeats
    parts: dict[str, list[dict[str, Any]]] = {}
    for part in options.only:
        print(f"{part} …", file=sys.stderr, flush=True)
        if part == "events":
            parts[part] = [bench_events(events, width, height, repeats) for events in sorted(options.events)]
        elif part == "pools":
            parts[part] = [bench_pool(labels, width, height, repeats) for labels in sorted(options.pools)]
        else:
            parts[part] = bench_threads(options.threads, width, height, repeats)
        PRINT[part](parts[part])
        print()
    if options.plot:
        from bench.plots import plot_growth  # Matplotlib is needed for nothing else

        for path in plot_growth(parts, options.plot):
            print(path)
    if options.json:
        write_json(options.json, found, **parts)


if __name__ == "__main__":
    main()
