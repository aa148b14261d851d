"""The runs of `bench.experiments`: which there are, and what one measures.

A run is one recording with one set of settings, by one thread, in a process of its own.  Its figures are
kept in a file named by all that they follow from, so that an interrupted command goes on where it was, and
settings that several curves pass through are measured once.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import statistics
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import emseg
import emseg._core
from bench import recordings, scoring
from bench.fresh import peak_mb
from bench.recordings import Recording
from emseg.datasets import open_dataset
from emseg.evaluation.protocols import event_truth


@dataclass(frozen=True)
class Experiment:
    """A scene of the thesis: its like in the suite, the settings, and the public recording, if any."""

    name: str
    scene: str  # of the suite
    duration: float  # of that, s: some ten windows or more of the thesis' size
    thesis: str  # presets
    published: str
    public: tuple[str, str] | None  # data set, and what the recording's name holds


EXPERIMENTS: Final = {
    experiment.name: experiment
    for experiment in (
        Experiment("hands", "hands", 0.8, "thesis/hands", "distsurf/hand", ("dvsmotion20", "hands")),
        Experiment(
            "fast_drone", "fast_drone", 0.6, "thesis/fast_drone", "eed/fast_drone", ("eed", "fast_drone")
        ),
        Experiment("evimo", "collision_table", 0.25, "thesis/evimo", "evimo/table01", ("evimo", "table")),
        Experiment("slow_cam", "slow_cam", 0.4, "thesis/slow_cam", "published", None),
        Experiment("fast_cam", "fast_cam", 0.15, "thesis/fast_cam", "published", None),
    )
}
PUBLISHED_EVENTS: Final = 30_000  # a window where the published settings leave it open

PARAMETERS: Final[dict[str, tuple[int | float, ...]]] = {
    "num_events_per_image": (5_000, 10_000, 15_000, 20_000, 30_000, 60_000),
    "lambda_smooth": (5, 10, 20, 30, 40, 80),
    "lambda_label": (0, 1_000, 2_000, 4_000, 8_000, 16_000),
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
    seconds: float  # of a public recording
    most_events: int | None = None  # those in the middle of the recording; None for all
    most_cpu_s: float = float("inf")  # no further window once it took so long
    value: float | None = None


def settings_runs(recordings: Iterable[Run]) -> list[Run]:
    """The three settings of every recording, which is taken whole."""
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


def parameter_runs(recordings: Iterable[Run], names: Sequence[str], windows: int) -> list[Run]:
    """Each parameter varied about the thesis' settings, the others as they are.

    All take the same events, as many as `windows` windows of the thesis' size hold.
    """
    return [
        replace(run, what=name, value=value, config=_varied(run, **{name: value}), most_events=most)
        for run in recordings
        for most in (_events_of(run, windows),)
        for name in names
        for value in PARAMETERS[name]
    ]


def hands_runs(recordings: Iterable[Run], windows: int) -> list[Run]:
    """The thesis' own sweep, on its hands, on the events of :func:`parameter_runs`."""
    return [
        replace(
            run,
            what=f"hands, smoothness {smooth}",
            value=label,
            config=_varied(run, lambda_smooth=smooth, lambda_label=label),
            most_events=_events_of(run, windows),
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


def _events_of(run: Run, windows: int) -> int:
    size = emseg.Config.preset(EXPERIMENTS[run.experiment].thesis).num_events_per_image
    assert size is not None
    return windows * size


# --- one run -----------------------------------------------------------------------------------------------


def measure(run: Run) -> dict[str, Any]:
    """Segment and score one recording: its figures, with time and memory, which are this process'."""
    recording = _load(run)
    held = peak_mb() if not _forget_peak() else _resident_mb()
    found, cpu_s = scoring.segment_scored(recording, run.config, most_cpu_s=run.most_cpu_s)
    peak = peak_mb()
    figures = scoring.summary(recording, found, cpu_s)
    kept = ("moving_iou_deployed", "moving_iou_oracle", "object_iou", "clusters_per_motion", "detection_rate")
    return {
        "recording": recording.name,
        **{name: figures[name] for name in kept},
        "switches": figures["most_switches"],
        "labels": statistics.fmean(window.figures["labels"] for window in found),
        "windows": figures["windows"],
        "small_windows": figures["small"]["windows"],
        "events": figures["events"],
        "cut_short": figures["events"] < len(recording.events),
        "cpu_s": cpu_s,
        "ms_a_window": 1e3 * cpu_s / len(found),
        "cpu_s_a_mega_event": 1e6 * cpu_s / figures["events"],
        "peak_mb": peak - held,
        "process_peak_mb": peak,
        "process_cpu_s": time.process_time(),
    }


def labelled(run: Run, figures: dict[str, Any]) -> dict[str, Any]:
    """The figures of a run beside what it belongs to."""
    belongs = {"what": run.what, "experiment": run.experiment, "seed": run.seed, "value": run.value}
    return {**belongs, **figures}


def _load(run: Run) -> Recording:
    recording = _load_whole(run)
    assert recording.truth is not None
    if run.most_events is None or len(recording.events) <= run.most_events:
        return recording
    start = (len(recording.events) - run.most_events) // 2
    part = slice(start, start + run.most_events)
    return Recording(recording.name, recording.events[part], recording.truth[part])


def _load_whole(run: Run) -> Recording:
    if not run.dataset:
        return recordings.load_file(run.path)
    dataset = open_dataset(run.dataset, run.path)
    wanted = EXPERIMENTS[run.experiment].public
    assert wanted is not None
    index = next((k for k, name in enumerate(dataset.names) if wanted[1] in name), None)
    if index is None:
        raise ValueError(f"{run.path}: no recording of {run.dataset} is named like {wanted[1]!r}")
    recording = dataset.load(index, span=(0.0, run.seconds))
    truth = event_truth(recording)
    if truth is None:
        raise ValueError(f"{recording.name} has no masks, try `emseg evaluate {run.dataset}`")
    return Recording(recording.name, recording.events, truth)


def _forget_peak() -> bool:
    """Let the peak of resident memory begin anew, as Linux allows; whether it does."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return False
    return True


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


# --- runs that are done ------------------------------------------------------------------------------------


def key_of(run: Run) -> str:
    """Names all that a run's figures follow from: settings, the recording's bytes, and the code."""
    recording = digest(run.path) if run.path.is_file() else f"{run.path.resolve()}, {run.seconds} s"
    scope = (run.experiment if run.dataset else "", run.dataset, run.most_events, run.most_cpu_s)
    contents = [asdict(run.config), recording, scope, code_digest()]
    return hashlib.sha256(json.dumps(contents, sort_keys=True).encode()).hexdigest()[:32]


@cache
def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def code_digest() -> str:
    """Of the engine as it was built, of the package, and of what measures it: committed or not."""
    package = Path(emseg.__file__).parent
    measuring = [Path(str(module.__file__)) for module in (recordings, scoring)]
    files = [Path(emseg._core.__file__), *package.rglob("*.py"), *measuring, Path(__file__)]
    return hashlib.sha256("".join(digest(path) for path in sorted(files)).encode()).hexdigest()


def kept_figures(folder: Path, key: str) -> dict[str, Any] | None:
    """Figures of a run done before, if there are any."""
    try:
        figures: dict[str, Any] = json.loads((folder / f"{key}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return figures


def keep_figures(folder: Path, key: str, figures: dict[str, Any]) -> None:
    """Keep the figures of a run, wholly or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    work = folder / f".{key}.tmp-{os.getpid()}"
    work.write_text(json.dumps(figures), encoding="utf-8")
    work.replace(folder / f"{key}.json")
