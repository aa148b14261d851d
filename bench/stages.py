"""A cold window, stage by stage, beside the published code's figures and the NumPy reference.

``python -m bench.stages [--windows NAME …] [--preset NAME | --config FILE] [--reference WHICH]
[--json FILE]``
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import emseg
from bench import windows
from bench.common import (
    circumstances,
    cpu_times,
    number,
    print_circumstances,
    print_table,
    require,
    write_json,
)
from bench.fresh import run_fresh
from bench.published import our_solution, published_energies, published_solution, reference_window
from bench.windows import BenchWindow
from emseg.datasets import bundled
from emseg.metrics import one_to_one_accuracy
from emseg.reference import SegmentOptions
from emseg.reference import segment as reference_segment

SMALLEST = "240x180_15k"  # the window that the NumPy reference segments unless asked for more
VARIANTS = ("head", "translation_pool")  # the published code as it is, and as its pool is usually better
REFERENCE_POOLS = ("searched", "true_pool")


def labels_in_use(labels: NDArray[Any]) -> int:
    return len(np.unique(labels[labels >= 0]))


def accuracy(window: BenchWindow, labels: NDArray[Any]) -> float:
    """One-to-one accuracy, noise left out; NaN where the truth is not known."""
    return float("nan") if window.truth is None else one_to_one_accuracy(window.truth, labels)


def check(window: BenchWindow, one: emseg.Segmentation, many: emseg.Segmentation) -> None:
    """What must hold of a segmentation before its time is worth reporting."""
    require(np.array_equal(one.labels, many.labels), f"{window.name}: labels depend on the number of threads")
    require(len(one.labels) == len(window.events), f"{window.name}: {len(one.labels)} labels")
    falls = all(
        after <= before for before, after in zip(one.energy_trace, one.energy_trace[1:], strict=False)
    )
    require(falls, f"{window.name}: the energy rises: {one.energy_trace}")
    require(sum(one.timings.values()) > 0, f"{window.name}: no time passed")


def bench_window(window: BenchWindow, config: emseg.Config, *, repeats: int, fresh: int) -> dict[str, Any]:
    """Times and quality of one window, beside the published code's."""
    one_thread = replace(config, threads=1)
    single, default = cpu_times(
        [lambda c=c: emseg.segment(window.events, window.camera, c) for c in (one_thread, config)],  # type: ignore[misc]
        repeats,
    )
    check(window, single.result, default.result)
    cold = [run_fresh(window.name, json.dumps(asdict(one_thread))) for _ in range(fresh)]
    require(
        all(run["energy"] == single.result.energy for run in cold),
        f"{window.name}: a fresh process finds another energy than a warm one",
    )
    # The labels that were optimised: events marked as noise have lost theirs.
    unmarked = emseg.segment(window.events, window.camera, replace(one_thread, noise_label="off"))
    require(unmarked.energy == single.result.energy, f"{window.name}: marking noise changes the energy")
    row: dict[str, Any] = {
        "window": window.name,
        "events": len(window.events),
        "import_cpu_s": statistics.median(run["import_cpu_s"] for run in cold),
        "cold_cpu_s": statistics.median(run["segment_cpu_s"] for run in cold),
        "warm_cpu_s_one_thread": single.cpu_s,
        "warm_cpu_s": default.cpu_s,
        "peak_mb_over_numpy": statistics.median(run["peak_mb_over_numpy"] for run in cold),
        "stages_wall_s": {
            stage: statistics.median(found.timings[stage] for found in single.results)
            for stage in single.result.timings
        },
        "labels": labels_in_use(single.result.labels),
        "true_labels": None if window.truth is None else labels_in_use(window.truth),
        "accuracy": accuracy(window, single.result.labels),
        "accuracy_unmarked": accuracy(window, unmarked.labels),
        "published": {},
    }
    variants = {name: window.published[name] for name in VARIANTS if name in window.published}
    solutions = [our_solution(window, unmarked), *(published_solution(window, p) for p in variants.values())]
    row["published_energy"], *energies = published_energies(window, solutions)
    row["published_energy_own_scale"], *own_scale = [
        published_energies(window, [one])[0] for one in solutions
    ]
    for (name, published), energy, own in zip(variants.items(), energies, own_scale, strict=True):
        row["published"][name] = {
            **published.figures,
            "accuracy": accuracy(window, published.labels),
            "published_energy": energy,
            "published_energy_own_scale": own,
            "over_cold": published.figures["cpu_s"] / row["cold_cpu_s"],
        }
    return row


def bench_reference(window: BenchWindow, pool_name: str) -> dict[str, Any]:
    """The NumPy reference on one window: its own coarse-to-fine search, or the true models as its pool."""
    if pool_name == "searched":
        frame, pool = reference_window(window), None
    else:
        solution = published_solution(window, window.published[pool_name])
        frame, pool = solution.window, list(dict.fromkeys(solution.models))
    found = reference_segment(frame, SegmentOptions(), pool=pool)
    return {
        "window": window.name,
        "pool": pool_name,
        "cpu_s": sum(found.timings.values()),
        "stages_cpu_s": found.timings,
        "labels": labels_in_use(found.labels),
        "accuracy": accuracy(window, found.labels),
    }


# --- tables ------------------------------------------------------------------------------------------------


def print_times(rows: Sequence[dict[str, Any]]) -> None:
    heading = (
        "CPU seconds",
        "import",
        "cold",
        "warm",
        "warm, threads",
        *VARIANTS,
        "head/cold",
        "translation/cold",
    )
    table = []
    for row in rows:
        theirs = [row["published"].get(name, {}) for name in VARIANTS]
        table.append(
            (
                row["window"],
                *(
                    f"{row[key]:.3f}"
                    for key in ("import_cpu_s", "cold_cpu_s", "warm_cpu_s_one_thread", "warm_cpu_s")
                ),
                *(number(figures.get("cpu_s"), ".1f") for figures in theirs),
                *(number(figures.get("over_cold"), ".0f") for figures in theirs),
            )
        )
    print_table(heading, table)


def print_quality(rows: Sequence[dict[str, Any]]) -> None:
    heading = (
        "quality",
        "accuracy",
        "noise unmarked",
        *VARIANTS,
        "labels",
        "true",
        "energy/translation's",
        "own scales",
        "MB",
        "MB published",
    )
    table = []
    for row in rows:
        theirs = [row["published"].get(name, {}) for name in VARIANTS]
        rival = theirs[1]
        ratios = [
            row[key] / rival[key] if rival else None
            for key in ("published_energy", "published_energy_own_scale")
        ]
        table.append(
            (
                row["window"],
                number(row["accuracy"], ".3f"),
                number(row["accuracy_unmarked"], ".3f"),
                *(number(figures.get("accuracy"), ".3f") for figures in theirs),
                str(row["labels"]),
                number(row["true_labels"], "d"),
                *(number(ratio, ".4f") for ratio in ratios),
                f"{row['peak_mb_over_numpy']:.0f}",
                number(theirs[0].get("rss_mb"), "d"),
            )
        )
    print_table(heading, table)


def print_stages(rows: Sequence[dict[str, Any]]) -> None:
    stages = list(rows[0]["stages_wall_s"])
    heading = ("wall ms, warm, one thread", *stages, "all", "published: pool, CPU s", "labelling, CPU s")
    table = []
    for row in rows:
        times = row["stages_wall_s"]
        head = row["published"].get("head", {})
        table.append(
            (
                row["window"],
                *(f"{1e3 * times[stage]:.1f}" for stage in stages),
                f"{1e3 * sum(times.values()):.1f}",
                number(head.get("pool_cpu_s"), ".1f"),
                number(head.get("labelling_cpu_s"), ".1f"),
            )
        )
    print_table(heading, table)


def print_reference(rows: Sequence[dict[str, Any]], ours: dict[str, dict[str, Any]]) -> None:
    stages = list(rows[0]["stages_cpu_s"])
    heading = ("NumPy reference, CPU s", "pool of", *stages, "all", "all/our cold", "accuracy", "labels")
    table = [
        (
            row["window"],
            row["pool"],
            *(f"{row['stages_cpu_s'][stage]:.2f}" for stage in stages),
            f"{row['cpu_s']:.2f}",
            f"{row['cpu_s'] / ours[row['window']]['cold_cpu_s']:.0f}",
            number(row["accuracy"], ".3f"),
            str(row["labels"]),
        )
        for row in rows
    ]
    print_table(heading, table, left=(0, 1))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = sorted({*windows.recorded(), *bundled()})
    parser.add_argument("--windows", nargs="+", metavar="NAME", choices=known, default=windows.names())
    settings = parser.add_mutually_exclusive_group()
    settings.add_argument(
        "--preset", choices=emseg.Config.presets(), help="published settings; else the defaults"
    )
    settings.add_argument("--config", type=Path, help="settings from a YAML file")
    parser.add_argument("--repeats", type=int, default=5, help="of warm runs; medians are shown")
    parser.add_argument("--fresh", type=int, default=3, help="fresh processes a window; medians are shown")
    parser.add_argument(
        "--reference", choices=("none", "smallest", "all"), default="smallest", help="NumPy reference"
    )
    parser.add_argument("--json", type=Path, help="also write everything here")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    config = emseg.Config()
    if options.preset:
        config = emseg.Config.preset(options.preset)
    elif options.config:
        config = emseg.Config.from_yaml(options.config)
    found = circumstances()
    print_circumstances(found)
    rows, reference = [], []
    for name in options.windows:
        print(f"{name} …", file=sys.stderr, flush=True)
        window = windows.load(name)
        rows.append(bench_window(window, config, repeats=options.repeats, fresh=options.fresh))
        if options.reference == "all" or (options.reference == "smallest" and name == SMALLEST):
            pools = [pool for pool in REFERENCE_POOLS if pool == "searched" or pool in window.published]
            reference += [bench_reference(window, pool) for pool in pools]
    for show in (print_times, print_quality, print_stages):
        show(rows)
        print()
    if reference:
        print_reference(reference, {row["window"]: row for row in rows})
    if options.json:
        write_json(options.json, found, settings=asdict(config), windows=rows, reference=reference)


if __name__ == "__main__":
    main()
