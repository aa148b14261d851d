"""Whole recordings, window after window: the speed that is kept up, and the quality beside it.

``python -m bench.sequences [--scenes NAME …] [--seconds S] [--threads N …] [--json FILE]``
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import emseg
from bench import recordings
from bench.common import circumstances, number, print_circumstances, print_table, require, write_json
from bench.recordings import Recording

SECONDS = 0.25  # of each recording, unless asked for more: fast_cam has 12 million events a second
WARM_UP_EVENTS = 5000  # what is imported or allocated on first use is not what a recording keeps up
QUALITIES = ("moving_iou_deployed", "moving_iou_oracle", "object_iou")


def timed_run(recording: Recording, threads: int) -> tuple[dict[str, Any], list[emseg.Segmentation]]:
    """`Segmenter.run` over the recording: its figures, and its windows."""
    events = recording.events
    config = emseg.Config(threads=threads)
    list(emseg.Segmenter(events.width, events.height, config=config).run(events[:WARM_UP_EVENTS]))
    found, latencies = [], []
    cpu, start = time.process_time(), time.perf_counter()
    before = start
    for seg in emseg.Segmenter(events.width, events.height, config=config).run(events):
        now = time.perf_counter()
        latencies.append(now - before)
        before = now
        found.append(seg)
    wall_s, cpu_s = time.perf_counter() - start, time.process_time() - cpu
    figures = {
        "threads": threads,
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "windows": len(found),
        "mega_events_a_second": 1e-6 * len(events) / wall_s,
        "mega_events_a_cpu_second": 1e-6 * len(events) / cpu_s,
        "windows_a_second": len(found) / wall_s,
        "latency_p50_s": float(np.quantile(latencies, 0.5)),
        "latency_p95_s": float(np.quantile(latencies, 0.95)),
        "real_time_factor": 1e-6 * events.duration / wall_s,
        "thinned": sum(int(getattr(seg, "thinned", 0)) for seg in found) / len(events),
    }
    return figures, found


def check_run(recording: Recording, found: Sequence[emseg.Segmentation]) -> None:
    """Windows follow each other and label every event once."""
    stop = 0
    for seg in found:
        where = f"{recording.name}: window {seg.start}..{seg.stop}"
        require(seg.start == stop < seg.stop, f"{where} follows one that ends at {stop}")
        require(len(seg.labels) == seg.stop - seg.start, f"{where} has {len(seg.labels)} labels")
        require(seg.labels.min() >= -1, f"{where} has label {seg.labels.min()}")
        stop = seg.stop
    events = len(recording.events)
    require(stop == events, f"{recording.name}: windows end at {stop} of {events} events")


def check_same(
    recording: Recording, some: Sequence[emseg.Segmentation], others: Sequence[emseg.Segmentation]
) -> None:
    """Two runs found the same windows and the same labels."""
    require(
        len(some) == len(others), f"{recording.name}: {len(some)} windows, {len(others)} by other threads"
    )
    for one, other in zip(some, others, strict=True):
        require(
            one.start == other.start and np.array_equal(one.labels, other.labels),
            f"{recording.name}: labels of window {one.start}..{one.stop} depend on the number of threads",
        )


def cold_run(
    recording: Recording, windows: Sequence[emseg.Segmentation]
) -> tuple[float, list[emseg.Segmentation]]:
    """CPU seconds and results of the same windows, each by itself, by one thread."""
    config = emseg.Config(threads=1)
    start = time.process_time()
    found = [emseg.segment(recording.events[seg.start : seg.stop], config=config) for seg in windows]
    return time.process_time() - start, found


def mean_quality(
    recording: Recording, windows: Sequence[emseg.Segmentation], found: Sequence[emseg.Segmentation]
) -> dict[str, Any]:
    """Figures of `emseg.evaluate`, mean over the windows where each is defined, and how many those are."""
    if recording.truth is None:
        return {}
    scores = [
        emseg.evaluate(recording.truth[window.start : window.stop], seg.labels)
        for window, seg in zip(windows, found, strict=True)
    ]
    quality: dict[str, Any] = {}
    for name in QUALITIES:
        defined = [score[name] for score in scores if score[name] == score[name]]
        quality[name] = statistics.fmean(defined) if defined else None
        quality[f"{name}_windows"] = len(defined)
    return quality


def bench_recording(recording: Recording, threads: Sequence[int], *, cold: bool) -> dict[str, Any]:
    """Speed for every number of threads, and quality warm and, if asked for, cold."""
    runs, warm = [], None
    for count in threads:
        figures, found = timed_run(recording, count)
        runs.append(figures)
        check_run(recording, found)
        if warm is not None:
            check_same(recording, warm, found)
        warm = found
    assert warm is not None
    row: dict[str, Any] = {
        "recording": recording.name,
        "events": len(recording.events),
        "seconds": 1e-6 * recording.events.duration,
        "runs": runs,
        "warm": mean_quality(recording, warm, warm),
    }
    if cold:
        spent, found = cold_run(recording, warm)
        row["cold"] = {"cpu_s": spent, **mean_quality(recording, warm, found)}
    return row


# --- tables ------------------------------------------------------------------------------------------------


def print_speed(rows: Sequence[dict[str, Any]]) -> None:
    heading = (
        "speed",
        "threads",
        "events",
        "s",
        "wall s",
        "CPU s",
        "Mev/s",
        "Mev/CPU s",
        "windows",
        "windows/s",
        "p50 ms",
        "p95 ms",
        "real time",
        "thinned",
    )
    table = [
        (
            row["recording"],
            str(run["threads"]),
            str(row["events"]),
            f"{row['seconds']:.2f}",
            f"{run['wall_s']:.2f}",
            f"{run['cpu_s']:.2f}",
            f"{run['mega_events_a_second']:.2f}",
            f"{run['mega_events_a_cpu_second']:.2f}",
            str(run["windows"]),
            f"{run['windows_a_second']:.1f}",
            f"{1e3 * run['latency_p50_s']:.0f}",
            f"{1e3 * run['latency_p95_s']:.0f}",
            f"{run['real_time_factor']:.2f}",
            f"{run['thinned']:.0%}",
        )
        for row in rows
        for run in row["runs"]
    ]
    print_table(heading, table)


def print_quality(rows: Sequence[dict[str, Any]]) -> None:
    heading = (
        "quality, warm and cold",
        "windows scored",
        "moving IoU",
        "cold",
        "warm - cold",
        "oracle",
        "cold",
        "warm - cold",
        "object IoU",
        "cold",
        "CPU s",
        "cold",
        "cold/warm",
    )
    table = []
    for row in rows:
        warm, cold = row["warm"], row.get("cold", {})

        def pair(name: str, *, difference: bool) -> list[str]:
            ours, theirs = warm.get(name), cold.get(name)  # noqa: B023
            apart = None if ours is None or theirs is None else ours - theirs
            cells = [number(ours, ".3f"), number(theirs, ".3f")]
            return [*cells, number(apart, "+.3f")] if difference else cells

        spent = row["runs"][0]["cpu_s"]
        table.append(
            (
                row["recording"],
                number(warm.get("moving_iou_deployed_windows"), "d"),
                *pair("moving_iou_deployed", difference=True),
                *pair("moving_iou_oracle", difference=True),
                *pair("object_iou", difference=False),
                f"{spent:.2f}",
                number(cold.get("cpu_s"), ".2f"),
                number(cold["cpu_s"] / spent if cold else None, ".2f"),
            )
        )
    print_table(heading, table)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = recordings.names()
    parser.add_argument("--scenes", nargs="+", metavar="NAME", choices=known, default=known)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of each recording; 0: all of it")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument(
        "--cold", choices=("all", "none"), default="all", help="also segment every window by itself"
    )
    parser.add_argument("--json", type=Path, help="also write everything here")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(arguments)
    found = circumstances()
    print_circumstances(found)
    if not recordings.simulated():
        print(f"no simulated scenes: {recordings.SIM_DIR} holds none", file=sys.stderr)
    rows = []
    for name in options.scenes:
        print(f"{name} …", file=sys.stderr, flush=True)
        recording = recordings.load(name, options.seconds or None)
        rows.append(bench_recording(recording, options.threads, cold=options.cold == "all"))
    show: Callable[[Sequence[dict[str, Any]]], None]
    for show in (print_speed, print_quality):
        show(rows)
        print()
    if options.json:
        write_json(options.json, found, settings=asdict(emseg.Config()), recordings=rows)


if __name__ == "__main__":
    main()
