"""The experiments of the master thesis that this work carries on: settings side by side, and curves.

``python -m bench.experiments [--suite DIR] [--seeds A:B] [--duration S] [--data NAME=DIR …] [--only WHICH]
[--scenes NAME …] [--parameters NAME …] [--jobs N] [--out DIR] [--redraw]``

Its chapter 6.1 shows five scenes: hands (DVSMOTION20), fast_drone (EED), a sequence of EV-IMO, and two own
recordings, slow_cam and fast_cam.  The suite of `emseg simulate` has their like, with truth; `--data` takes
public recordings instead, such as ``--data evimo=EV-IMO``, where they are at hand.  Each scene is segmented
by our engine with the thesis' settings, with those published for it, and with `auto`; a process a run, one
thread, so that memory and time are its own.

Its Table 6.3 says what parameters do: each is varied here about the thesis' settings, as curves of moving
IoU, clusters per motion and time, over the recordings' middle.  The thesis' own sweep on hands, smoothness 20
and 30 by label costs from 0 to 8,000, is among them.

Runs that are done are kept beside the suite's recordings: an interrupted command goes on where it was, and
one after a change of the engine measures everything anew.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import signal
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from tqdm import tqdm

import emseg
from bench.common import ROOT, circumstances, number, print_circumstances
from bench.experiment_runs import (
    EXPERIMENTS,
    HANDS_SMOOTH,
    PARAMETERS,
    Run,
    hands_runs,
    keep_figures,
    kept_figures,
    key_of,
    labelled,
    measure,
    parameter_runs,
    settings_runs,
)
from bench.experiment_tables import (
    CLAIMS,
    SETTINGS,
    parameter_table,
    settings_table,
    sweep_table,
)
from emseg.simulation.generate import generate, suite_jobs

MOST_WINDOWS: Final = 16
"""Of a recording, of the thesis' size, that curves are measured on."""
MOST_CPU_S: Final = 60.0
"""Of a run."""


def recordings_of(options: argparse.Namespace) -> list[Run]:
    """What there is to run on: public recordings where given, else the suite's, which are made if missing."""
    given = dict(entry.split("=", 1) for entry in options.data)
    runs = []
    for experiment in (EXPERIMENTS[name] for name in options.scenes):
        duration = experiment.duration if options.duration is None else options.duration
        if experiment.public is not None and experiment.public[0] in given:
            dataset = experiment.public[0]
            places = [(Path(given[dataset]), dataset, 0)]
        else:
            jobs = suite_jobs(options.suite, options.seeds, names=[experiment.scene], duration=duration)
            for outcome in generate(jobs, processes=options.jobs):
                if outcome.status == "failed":
                    raise SystemExit(f"failed: {outcome.message}")
            places = [(job.target, "", job.seed) for job in jobs]
        runs += [
            Run(
                "",
                experiment.name,
                path,
                dataset,
                emseg.Config(),
                seed,
                duration,
                most_cpu_s=options.most_cpu_s,
            )
            for path, dataset, seed in places
        ]
    return runs


def runs_of(options: argparse.Namespace, recordings: Sequence[Run]) -> list[Run]:
    """All runs that are asked for; curves take the first seeds only."""
    runs = settings_runs(recordings) if options.only != "parameters" else []
    if options.only != "settings":
        swept = [run for run in recordings if run.dataset or run.seed in options.seeds[: options.curve_seeds]]
        runs += parameter_runs(swept, options.parameters, options.windows)
        runs += hands_runs(swept, options.windows)
    return runs


def run_all(runs: Sequence[Run], jobs: int, folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """The rows of all runs, in their order, each from a process of its own; and failures, a line each.

    Runs of the same key are one; those that the folder keeps are not run again.
    """
    by_key: dict[str, Run] = {}
    for run in runs:
        by_key.setdefault(key_of(run), run)
    known = {key: figures for key in by_key if (figures := kept_figures(folder, key)) is not None}
    failed = []
    bar = tqdm(
        total=len(by_key),
        initial=len(known),
        unit="run",
        mininterval=0.5 if sys.stderr.isatty() else 30,
    )
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(
        jobs,
        mp_context=context,
        max_tasks_per_child=1,
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    )
    try:
        running = {executor.submit(measure, run): key for key, run in by_key.items() if key not in known}
        for future in as_completed(running):
            key, run = running[future], by_key[running[future]]
            try:
                known[key] = future.result()
                keep_figures(folder, key, known[key])
                shown = number(known[key]["moving_iou_deployed"], ".3f")
                bar.set_postfix_str(f"{run.experiment}, {run.what}: moving IoU {shown}", refresh=False)
            except Exception as error:
                failed.append(f"{run.experiment}, {run.what}: {error}")
            bar.update()
    finally:
        executor.shutdown(wait=True, cancel_futures=True)  # what has begun ends, also when interrupted
        bar.close()
    rows = [(run, known.get(key_of(run))) for run in runs]
    return [labelled(run, figures) for run, figures in rows if figures is not None], failed


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    folder = ROOT / "build" / "experiments"
    add("--suite", type=Path, default=folder, help="where recordings and runs that are done are kept")
    add("--seeds", type=_seeds, default=range(11000, 11005), metavar="A:B", help="of the suite, A to B-1")
    add("--duration", type=float, metavar="S", help="seconds of each recording; by default its scene's own")
    add("--data", nargs="+", default=[], metavar="NAME=DIR", help="public data sets instead")
    add("--scenes", nargs="+", choices=list(EXPERIMENTS), default=list(EXPERIMENTS))
    add("--only", choices=("all", "settings", "parameters"), default="all")
    add("--parameters", nargs="+", choices=list(PARAMETERS), default=list(PARAMETERS))
    add("--curve-seeds", type=int, default=3, metavar="N", help="how many of the seeds curves are of")
    add(
        "--windows",
        type=int,
        default=MOST_WINDOWS,
        help="of the thesis' size, in the middle of each recording, that curves are measured on",
    )
    add("--most-cpu-s", type=float, default=MOST_CPU_S, help="a run that takes longer is cut short")
    add("--redraw", action="store_true", help="measure nothing: tables and curves of experiments.json")
    add("--jobs", type=int, default=2, help="runs at a time")
    add("--out", type=Path, default=ROOT / "bench" / "results")
    return parser.parse_args(arguments)


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    if not (first.isdigit() and last.isdigit() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"{text!r}, expected A:B with A below B")
    return range(int(first), int(last))


def main(arguments: Sequence[str] | None = None) -> int:
    options = parse(arguments)
    path = options.out / "experiments.json"
    if not options.redraw:
        found = circumstances()
        print_circumstances(found)
        recordings = recordings_of(options)
        try:
            rows, failed = run_all(runs_of(options, recordings), options.jobs, options.suite / "runs")
        except KeyboardInterrupt:
            print("interrupted: the same command goes on from here", file=sys.stderr)
            return 130
        options.out.mkdir(parents=True, exist_ok=True)
        measured = {
            **found,
            "seeds": list(options.seeds),
            "curve_seeds": list(options.seeds[: options.curve_seeds]),
            "durations": {run.experiment: run.seconds for run in recordings},
            "windows": options.windows,
            "most_cpu_s": options.most_cpu_s,
            "data": options.data,
            "settings": {
                name: asdict(emseg.Config.preset(EXPERIMENTS[name].thesis)) for name in options.scenes
            },
            "failed": failed,
        }
        path.write_text(_written(measured, rows), encoding="utf-8")
    contents = json.loads(path.read_text(encoding="utf-8"))
    page = _page(contents, options.out)
    path.with_suffix(".md").write_text(page, encoding="utf-8")
    print(page)
    for line in contents["failed"]:
        print(f"failed: {line}", file=sys.stderr)
    return 1 if contents["failed"] else 0


def _written(measured: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> str:
    """JSON with a line a run, so that it is small, and a change of one run a change of one line."""
    rounded = [
        {name: float(f"{value:.6g}") if isinstance(value, float) else value for name, value in row.items()}
        for row in rows
    ]
    runs = ",\n".join(json.dumps(row) for row in rounded)
    return json.dumps(measured, indent=1).removesuffix("\n}") + f',\n "runs": [\n{runs}\n]}}\n'


def _page(contents: Mapping[str, Any], folder: Path) -> str:
    """The tables, and the curves drawn beside them, of what experiments.json holds."""
    rows, machine = contents["runs"], contents["machine"]
    durations = ", ".join(f"{name} {seconds:g}" for name, seconds in contents["durations"].items())
    each = {(row["recording"], row["cpu_s"], row["process_cpu_s"]) for row in rows}  # some recur
    minutes = sum(process_cpu_s for *_, process_cpu_s in each) / 60
    given = f" Public data: {', '.join(contents['data'])}." if contents["data"] else ""
    lines = [
        "# The thesis' experiments",
        "",
        f"`python -m bench.experiments`: commit {contents['commit']}; {machine['processor']}, "
        f"{machine['cores']} cores; {len(each)} runs, one thread and one process each, "
        f"{minutes:.0f} CPU minutes in all. Seconds of the recordings: {durations}.{given} "
        "Means over seeds and windows with at least 200 events of objects. "
        "Peak MB is what a run adds to its recording. "
        + _cut_short([row for row in rows if row["cut_short"]], contents["most_cpu_s"]),
    ]
    if any(row["what"] in SETTINGS for row in rows):
        lines += [
            "",
            "## Settings side by side",
            "",
            f"Seeds {_listed(contents['seeds'])}, whole recordings.",
        ]
        lines += ["", settings_table(rows, list(EXPERIMENTS))]
    names = [name for name in PARAMETERS if any(row["what"] == name for row in rows)]
    if names:
        from bench.experiment_plots import plot_parameters

        caption = (
            f"commit {contents['commit']}, seeds {_listed(contents['curve_seeds'])}, "
            f"the middle {contents['windows']} windows of the thesis' size"
        )
        drawn = plot_parameters(rows, names, folder, caption=caption)
        lines += ["", "## What parameters do", "", f"Of {caption}; the same events for every value.", ""]
        for name in names:
            lines += [f"**{name}** — the thesis: {CLAIMS[name]}", "", parameter_table(rows, name), ""]
            lines += [f"![{name}]({drawn[name].name})", ""]
        if sweep := sweep_table(rows, HANDS_SMOOTH):
            lines += ["## hands, the thesis' own sweep", "", sweep]
    return "\n".join(lines).rstrip() + "\n"


def _cut_short(cut: Sequence[dict[str, Any]], most_cpu_s: float) -> str:
    if not cut:
        return f"No run took its {most_cpu_s:g} CPU seconds."
    runs = (f"{row['experiment']}, {row['what']} {row['value'] or 0:g}, seed {row['seed']}" for row in cut)
    return f"Cut short at {most_cpu_s:g} CPU seconds: {'; '.join(dict.fromkeys(runs))}."


def _listed(seeds: Sequence[int]) -> str:
    return f"{seeds[0]}" if len(seeds) == 1 else f"{seeds[0]} to {seeds[-1]}"


if __name__ == "__main__":
    sys.exit(main())
