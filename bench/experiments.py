"""The experiments of the master thesis that this work carries on: settings side by side, and curves.

``python -m bench.experiments [--suite DIR] [--seeds A:B] [--duration S] [--data NAME=DIR …] [--only WHICH]
[--scenes NAME …] [--parameters NAME …] [--jobs N] [--out DIR]``

Its chapter 6.1 shows five scenes: hands (DVSMOTION20), fast_drone (EED), a sequence of EV-IMO, and two own
recordings, slow_cam and fast_cam.  The suite of `emseg simulate` has their like, with truth; `--data` takes
public recordings instead, such as ``--data evimo=EV-IMO``, where they are at hand.  Each scene is segmented
by our engine with the thesis' settings, with those published for it, and with `auto`; a process a run, one
thread, so that memory and time are its own.

Its Table 6.3 says what parameters do: each is varied here about the thesis' settings, as curves of moving
IoU, clusters per motion and time.  The thesis' own sweep on hands, smoothness 20 and 30 by label costs from 0
to 8,000, is among them.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import resource
import statistics
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

import emseg
from bench.common import ROOT, circumstances, number, print_circumstances, write_json
from bench.experiment_tables import (
    CLAIMS,
    parameter_table,
    settings_table,
    sweep_table,
)
from bench.recordings import Recording, load_file
from bench.scoring import segment_scored, summary
from emseg.datasets import open_dataset
from emseg.evaluation.protocols import event_truth
from emseg.simulation.generate import generate, suite_jobs


@dataclass(frozen=True)
class Experiment:
    """A scene of the thesis: its like in the suite, the settings, and the public recording, if any."""

    name: str
    scene: str  # of the suite
    thesis: str  # presets
    published: str
    public: tuple[str, str] | None  # data set, and what the recording's name holds


EXPERIMENTS: Final = {
    experiment.name: experiment
    for experiment in (
        Experiment("hands", "hands", "thesis/hands", "distsurf/hand", ("dvsmotion20", "hands")),
        Experiment("fast_drone", "fast_drone", "thesis/fast_drone", "eed/fast_drone", ("eed", "fast_drone")),
        Experiment("evimo", "collision_table", "thesis/evimo", "evimo/table01", ("evimo", "table")),
        Experiment("slow_cam", "slow_cam", "thesis/slow_cam", "published", None),
        Experiment("fast_cam", "fast_cam", "thesis/fast_cam", "published", None),
    )
}
PUBLISHED_EVENTS: Final = 30_000  # a window where the published settings leave it open

PARAMETERS: Final[dict[str, tuple[int | float, ...]]] = {
    "num_events_per_image": (5_000, 10_000, 15_000, 20_000, 30_000, 45_000, 60_000),
    "lambda_smooth": (5, 10, 20, 30, 40, 60, 100),
    "lambda_label": (0, 1_000, 2_000, 4_000, 6_000, 8_000, 12_000, 16_000),
    "lambda_data": (0.25, 0.5, 1, 2, 4),
    "bracket": (2, 4, 6, 8, 10),
}
HANDS_SMOOTH: Final = (20, 30)
HANDS_LABEL: Final = tuple(range(0, 9_000, 1_000))


@dataclass(frozen=True)
class Run:
    """One recording with one set of settings; `what` says which part of the experiments it belongs to."""

    what: str
    experiment: str
    path: Path
    dataset: str  # empty: a recording of the suite
    config: emseg.Config
    seed: int
    duration: float
    value: float | None = None


def settings_runs(recordings: Iterable[Run]) -> list[Run]:
    """The three settings of every recording."""
    runs = []
    for run in recordings:
        experiment = EXPERIMENTS[run.experiment]
        published = emseg.Config.preset(experiment.published)
        if published.num_events_per_image is None:
            published = replace(published, num_events_per_image=PUBLISHED_EVENTS)
        for what, config in (
            ("thesis", emseg.Config.preset(experiment.thesis)),
            ("published", published),
            ("auto", emseg.Config()),
        ):
            runs.append(replace(run, what=what, config=replace(config, threads=1)))
    return runs


def parameter_runs(recordings: Iterable[Run], names: Sequence[str]) -> list[Run]:
    """Each parameter varied about the thesis' settings, the others as they are."""
    return [
        replace(run, what=name, value=value, config=_varied(run, **{name: value}))
        for run in recordings
        for name in names
        for value in PARAMETERS[name]
    ]


def hands_runs(recordings: Iterable[Run]) -> list[Run]:
    """The thesis' own sweep, on its hands."""
    return [
        replace(
            run,
            what=f"hands, smoothness {smooth}",
            value=label,
            config=_varied(run, lambda_smooth=smooth, lambda_label=label),
        )
        for run in recordings
        if run.experiment == "hands"
        for smooth, label in itertools.product(HANDS_SMOOTH, HANDS_LABEL)
    ]


def _varied(run: Run, **values: Any) -> emseg.Config:
    config = emseg.Config.preset(EXPERIMENTS[run.experiment].thesis)
    if "bracket" in values:
        bracket = values.pop("bracket")
        config = replace(config, bracket_row=bracket, bracket_col=bracket)
    return replace(config, threads=1, **values)


def measure(run: Run) -> dict[str, Any]:
    """Segment and score one recording: its figures, with time and memory."""
    recording = _load(run)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found, cpu_s = segment_scored(recording, run.config)
    peak_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    figures = summary(recording, found, cpu_s)
    kept = ("moving_iou_deployed", "moving_iou_oracle", "object_iou", "clusters_per_motion", "detection_rate")
    return {
        "what": run.what,
        "experiment": run.experiment,
        "recording": recording.name,
        "seed": run.seed,
        "value": run.value,
        **{name: figures[name] for name in kept},
        "switches": figures["most_switches"],
        "labels": statistics.fmean(window.figures["labels"] for window in found),
        "windows": figures["windows"],
        "small_windows": figures["small"]["windows"],
        "events": figures["events"],
        "cpu_s": cpu_s,
        "ms_a_window": 1e3 * cpu_s / len(found),
        "cpu_s_a_mega_event": 1e6 * cpu_s / figures["events"],
        "peak_mb": peak_mb,
    }


def _load(run: Run) -> Recording:
    if not run.dataset:
        return load_file(run.path)
    dataset = open_dataset(run.dataset, run.path)
    wanted = EXPERIMENTS[run.experiment].public
    assert wanted is not None
    index = next(k for k, name in enumerate(dataset.names) if wanted[1] in name)
    recording = dataset.load(index, span=(0.0, run.duration))
    truth = event_truth(recording)
    if truth is None:
        raise ValueError(f"{recording.name} has no masks, try `emseg evaluate {run.dataset}`")
    return Recording(recording.name, recording.events, truth)


def recordings_of(options: argparse.Namespace) -> list[Run]:
    """What there is to run on: public recordings where given, else the suite's, which are made if missing."""
    given = dict(entry.split("=", 1) for entry in options.data)
    first, last = (int(part) for part in options.seeds.split(":"))
    runs = []
    for experiment in (EXPERIMENTS[name] for name in options.scenes):
        if experiment.public is not None and experiment.public[0] in given:
            dataset = experiment.public[0]
            path = Path(given[dataset])
            runs.append(Run("", experiment.name, path, dataset, emseg.Config(), 0, options.duration))
            continue
        jobs = suite_jobs(
            options.suite, range(first, last), names=[experiment.scene], duration=options.duration
        )
        for outcome in generate(jobs, processes=options.jobs):
            if outcome.status == "failed":
                raise SystemExit(f"failed: {outcome.message}")
        runs += [
            Run("", experiment.name, job.target, "", emseg.Config(), job.seed, options.duration)
            for job in jobs
        ]
    return runs


def run_all(runs: Sequence[Run], jobs: int) -> tuple[list[dict[str, Any]], list[str]]:
    """The rows of all runs, in their order, each from a process of its own; and failures, a line each."""
    rows: dict[int, dict[str, Any]] = {}
    failed = []
    bar = tqdm(total=len(runs), unit="run", file=sys.stderr, disable=None)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as executor:
        running = {executor.submit(measure, run): k for k, run in enumerate(runs)}
        for future in as_completed(running):
            k = running[future]
            try:
                rows[k] = future.result()
                shown = number(rows[k]["moving_iou_deployed"], ".3f")
                bar.set_postfix_str(f"{runs[k].experiment}, {runs[k].what}: moving IoU {shown}")
            except Exception as error:
                failed.append(f"{runs[k].experiment}, {runs[k].what}: {error}")
            bar.update()
    bar.close()
    return [rows[k] for k in sorted(rows)], failed


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--suite", type=Path, default=ROOT / "build" / "experiments", help="where the suite's recordings go"
    )
    parser.add_argument("--seeds", default="11000:11003", metavar="A:B", help="of the suite, A to B-1")
    parser.add_argument("--duration", type=float, default=0.3, help="seconds of each recording")
    parser.add_argument("--data", nargs="+", default=[], metavar="NAME=DIR", help="public data sets instead")
    parser.add_argument("--scenes", nargs="+", choices=list(EXPERIMENTS), default=list(EXPERIMENTS))
    parser.add_argument("--only", choices=("all", "settings", "parameters"), default="all")
    parser.add_argument("--parameters", nargs="+", choices=list(PARAMETERS), default=list(PARAMETERS))
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time")
    parser.add_argument("--out", type=Path, default=ROOT / "bench" / "results")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    options = parse(arguments)
    found = circumstances()
    print_circumstances(found)
    start = time.perf_counter()
    recordings = recordings_of(options)
    runs = settings_runs(recordings) if options.only != "parameters" else []
    if options.only != "settings":
        runs += [*parameter_runs(recordings, options.parameters), *hands_runs(recordings)]
    rows, failed = run_all(runs, options.jobs)
    wall_s = time.perf_counter() - start
    options.out.mkdir(parents=True, exist_ok=True)
    presets = {name: (experiment.thesis, experiment.published) for name, experiment in EXPERIMENTS.items()}
    about = {"seeds": options.seeds, "duration": options.duration, "data": options.data, "wall_s": wall_s}
    settings = {name: asdict(emseg.Config.preset(thesis)) for name, (thesis, _) in presets.items()}
    write_json(options.out / "experiments.json", found, **about, settings=settings, runs=rows, failed=failed)
    page = _page(found, about, rows, options)
    (options.out / "experiments.md").write_text(page, encoding="utf-8")
    print(page)
    for line in failed:
        print(f"failed: {line}", file=sys.stderr)
    return 1 if failed else 0


def _page(
    found: dict[str, Any], about: dict[str, Any], rows: Sequence[dict[str, Any]], options: argparse.Namespace
) -> str:
    """The tables, and the curves drawn beside them."""
    arguments = f"--seeds {options.seeds} --duration {options.duration:g}"
    machine = found["machine"]
    lines = [
        "# The thesis' experiments",
        "",
        f"`python -m bench.experiments {arguments}`: commit {found['commit']}, seeds {options.seeds}, "
        f"{options.duration:g} s each; {machine['processor']}, {machine['cores']} cores, one thread a run, "
        f"{about['wall_s'] / 60:.0f} minutes in all. Means over seeds and windows with at least 200 events "
        "of objects.",
    ]
    if options.only != "parameters":
        lines += ["", "## Settings side by side", "", settings_table(rows, list(EXPERIMENTS))]
    if options.only != "settings":
        from bench.experiment_plots import plot_parameters

        names = [name for name in PARAMETERS if name in options.parameters]
        drawn = plot_parameters(rows, names, options.out)
        lines += ["", "## What parameters do", ""]
        for name in names:
            lines += [f"**{name}** — the thesis: {CLAIMS[name]}", "", parameter_table(rows, name), ""]
            lines += [f"![{name}]({drawn[name].name})", ""]
        if sweep := sweep_table(rows, HANDS_SMOOTH):
            lines += ["## hands, the thesis' own sweep", "", sweep]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main())
