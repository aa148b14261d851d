"""How right the labels are: the reference's windows, cold, and whole simulated recordings, defaults only.

``python -m bench.accuracy [--sim DIR] [--reference DIR] [--scenes NAME …] [--span S] [--jobs N]
[--peer WINDOWS] [--pictures DIR] [--json FILE]``

Recordings are .npz files of x, y, t (µs), p, label, width and height: those of ``../shared/data/sim``, or any
that ``emseg simulate`` wrote.  Figures are those of `emseg.evaluate`, over the events that are not sensor
noise, mean over a scene's windows; windows with fewer than 200 events of objects are reported apart.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

import emseg
from bench import recordings, windows
from bench.common import circumstances, number, print_circumstances, print_table, write_json
from bench.scoring import LABEL_FIGURES, SMALL, Task, score_scene, score_window

MEANS = ("moving_iou_deployed", "moving_iou_oracle", "object_iou", "detection_rate", "clusters_per_motion")


def overall(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Means over the scenes where a figure is defined, and the worst scene of each."""
    if not rows:
        return {}
    means: dict[str, Any] = {}
    for name in MEANS:
        known = [row[name] for row in rows if row[name] is not None]
        means[name] = statistics.fmean(known) if known else None
        means[f"worst_{name}"] = (
            None if not known else max(known) if name == "clusters_per_motion" else min(known)
        )
    means["switches"] = max((row["most_switches"] for row in rows), default=0)
    means["mega_events_a_cpu_second"] = 1e-6 * sum(row["events"] for row in rows) / _cpu(rows)
    return means


def _cpu(rows: Sequence[dict[str, Any]]) -> float:
    return float(sum(row["cpu_s"] for row in rows))


def print_windows(rows: Sequence[dict[str, Any]]) -> None:
    pools = sorted({pool for row in rows for pool in row["published"]})
    heading = ["reference windows, cold", "accuracy", "clusters/motion", "labels", "CPU s"]
    for pool in pools:
        heading += [pool, "its clusters/motion"]
    table = []
    for row in rows:
        cells = [
            row["window"],
            f"{row['one_to_one_accuracy']:.3f}",
            f"{row['clusters_per_motion']:.2f}",
            f"{row['labels']:.0f}/{row['motions']:.0f}",
            f"{row['cpu_s']:.3f}",
        ]
        for pool in pools:
            theirs = row["published"].get(pool, {})
            cells += [number(theirs.get(name), ".3f") for name in LABEL_FIGURES]
        table.append(cells)
    print_table(heading, table)
    accuracy = [row["one_to_one_accuracy"] for row in rows]
    print(f"\nmean accuracy {statistics.fmean(accuracy):.3f}, least {min(accuracy):.3f}")


def print_scenes(rows: Sequence[dict[str, Any]], *, title: str) -> None:
    heading = (
        title,
        "s",
        "windows",
        f"< {SMALL}",
        "skipped",
        "moving IoU",
        "oracle",
        "object IoU",
        "detected",
        "clusters/motion",
        "switches by object",
        "tracked",
        "accuracy",
        "falsely moving",
        "Mev/CPU s",
    )
    table = [
        (
            row["scene"],
            f"{row['seconds']:.2f}",
            str(row["windows"]),
            str(row["small"]["windows"]),
            str(row["skipped"]),
            *(number(row[name], ".3f") for name in MEANS[:4]),
            number(row["clusters_per_motion"], ".2f"),
            " ".join(f"{k}:{count}" for k, count in row["switches"].items()) or "–",
            number(row["tracked"], ".2f"),
            number(row["one_to_one_accuracy"], ".3f"),
            number(row["small"]["falsely_moving"], ".1%"),
            number(row["mega_events_a_cpu_second"], ".2f"),
        )
        for row in rows
    ]
    if len(rows) > 1:
        means = overall(rows)
        cells = [number(means[name], ".3f") for name in MEANS[:4]]
        last = number(means["mega_events_a_cpu_second"], ".2f")
        clusters = number(means["clusters_per_motion"], ".2f")
        most = f"most {means['switches']}"
        table.append(("mean of scenes", "", "", "", "", *cells, clusters, most, "", "", "", last))
        worst = [number(means[f"worst_{name}"], ".3f") for name in MEANS[:4]]
        clusters = number(means["worst_clusters_per_motion"], ".2f")
        table.append(("worst scene", "", "", "", "", *worst, clusters, "", "", "", "", ""))
    print_table(heading, table)


def run_tasks(tasks: Sequence[Task], jobs: int) -> tuple[list[dict[str, Any]], list[str]]:
    """Every task's row, in the tasks' order, and what failed, a line each."""
    rows: dict[str, dict[str, Any]] = {}
    failed = []
    bar = tqdm(total=len(tasks), unit="scene", file=sys.stderr, disable=None)
    with ProcessPoolExecutor(max(1, min(jobs, len(tasks)))) as executor:
        running: dict[Future[dict[str, Any]], Task] = {executor.submit(score_scene, t): t for t in tasks}
        for future in as_completed(running):
            task = running[future]
            try:
                row = rows[task.name] = future.result()
                bar.set_postfix_str(f"{task.name}: moving IoU {number(row['moving_iou_deployed'], '.3f')}")
            except Exception as error:
                failed.append(f"{task.path}: {error}")
            bar.update()
    bar.close()
    return [rows[task.name] for task in tasks if task.name in rows], failed


def scene_files(folder: Path, names: Sequence[str] | None) -> list[Path]:
    """The recordings of a folder, by name, or those named of them; the suite's folders are searched too."""
    files = {path.stem: path for path in sorted(folder.rglob("*.npz"))}
    unknown = sorted(set(names or ()) - set(files))
    if unknown:
        raise SystemExit(f"no {', '.join(unknown)} in {folder}; there are: {', '.join(files) or 'none'}")
    return [files[name] for name in names] if names else list(files.values())


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sim", type=Path, default=recordings.SIM_DIR, help="folder of recordings")
    parser.add_argument(
        "--reference", type=Path, default=windows.REFERENCE_DIR, help="folder of reference windows"
    )
    parser.add_argument("--only", choices=("all", "sim", "reference"), default="all")
    parser.add_argument("--scenes", nargs="+", metavar="NAME", help="of --sim; all")
    parser.add_argument("--span", type=float, metavar="S", help="only the middle S seconds of each scene")
    parser.add_argument("--jobs", type=int, default=2, help="scenes at a time, each with one thread")
    parser.add_argument(
        "--peer",
        type=int,
        nargs="?",
        const=1,
        default=0,
        metavar="WINDOWS",
        help="the NumPy reference with published settings on so many windows a scene (1); minutes each",
    )
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="pictures of each scene's worst windows")
    parser.add_argument("--worst", type=int, default=3, help="how many of them")
    parser.add_argument("--json", type=Path, help="also write everything here")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    options = parse(arguments)
    found = circumstances()
    print_circumstances(found)
    cold: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    failed: list[str] = []
    if options.only != "sim":
        names = sorted(options.reference.glob("syn_*.npz"))
        if not names:
            print(f"no reference windows: {options.reference} holds none", file=sys.stderr)
        cold = [score_window(path) for path in tqdm(names, unit="window", file=sys.stderr, disable=None)]
        if cold:
            print_windows(cold)
            print()
    if options.only != "reference":
        tasks = [
            Task(path, path.stem, options.span, options.pictures, options.worst, options.peer)
            for path in scene_files(options.sim, options.scenes)
        ]
        if not tasks:
            print(f"no recordings: {options.sim} holds none", file=sys.stderr)
        rows, failed = run_tasks(tasks, options.jobs)
        if rows:
            print_scenes(rows, title="whole recordings")
            print()
        peers = [row["peer"] for row in rows if row["peer"]]
        if peers:
            print_scenes(peers, title="NumPy reference, published settings")
            print()
    if options.json:
        contents = {"windows": cold, "scenes": rows, "mean": overall(rows), "failed": failed}
        write_json(options.json, found, settings=asdict(emseg.Config()), **contents)
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
