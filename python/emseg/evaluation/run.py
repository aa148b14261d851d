"""Evaluating a data set: what `emseg evaluate` does."""

from __future__ import annotations

import platform
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import emseg
from emseg.batch import source_commit
from emseg.config import Config
from emseg.datasets import Dataset
from emseg.evaluation.protocols import Figure, score_recording
from emseg.evaluation.report import Row, merged_rows
from emseg.evaluation.segmented import segment_recording
from emseg.evaluation.views import View, extreme_views

__all__ = ["Evaluation", "evaluate_dataset"]

MOST_VIEWS: Final = 12
"""Pictures in the report: half of them the worst, half the best."""


@dataclass
class Evaluation:
    """All that was found: rows of figures, a dictionary a recording, pictures, and failures, a line each."""

    about: dict[str, Any]
    rows: list[Row] = field(default_factory=list)
    recordings: list[dict[str, Any]] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)


def evaluate_dataset(
    dataset: Dataset,
    config: Config,
    *,
    settings_name: str = "auto",
    recordings: Sequence[str] = (),
    seconds: float | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Evaluation:
    """Segment and score the recordings of a data set.

    Args:
        dataset: The recordings.
        config: Settings of the engine.
        settings_name: What the report calls them.
        recordings: Names, or beginnings of names, of those to take; all if none.
        seconds: Of each recording, from its start; None for all.
        progress: Called with a recording's name, the events done and all of them.

    Returns:
        What was found; recordings that cannot be read are among the failures.
    """
    chosen = [
        k for k, name in enumerate(dataset.names) if not recordings or name.startswith(tuple(recordings))
    ]
    found = Evaluation(_about(dataset.name, config, settings_name, seconds))
    figures: list[tuple[str, Figure]] = []
    for k in chosen:
        try:
            _evaluate_one(dataset, k, config, seconds, progress, figures, found)
        except (ValueError, OSError) as error:
            found.failed.append(f"{dataset.names[k]}: {error}")
    found.rows = merged_rows(dataset.name, figures)
    found.views = _most_telling(found.views)
    found.about["peak_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    found.about["failed"] = found.failed
    return found


def _evaluate_one(
    dataset: Dataset,
    k: int,
    config: Config,
    seconds: float | None,
    progress: Callable[[str, int, int], None] | None,
    figures: list[tuple[str, Figure]],
    found: Evaluation,
) -> None:
    recording = dataset.load(k, span=None if seconds is None else (0.0, seconds))
    events = recording.events
    if not len(events):
        raise ValueError("holds no events")

    def report(done: int) -> None:
        if progress is not None:
            progress(recording.name, done, len(events))

    segmented = segment_recording(recording, config, progress=report)
    own = score_recording(recording, segmented)
    figures += [(recording.group, figure) for figure in own]
    found.views += extreme_views(recording, segmented)
    found.recordings.append(
        {
            "name": recording.name,
            "group": recording.group,
            "events": len(events),
            "seconds": 1e-6 * events.duration,
            "windows": len(segmented.windows),
            "cpu_s": segmented.cpu_s,
            "wall_s": segmented.wall_s,
            "ms_a_window": 1e3 * segmented.wall_s / max(1, len(segmented.windows)),
            "figures": [asdict(row) for row in merged_rows("", [("", figure) for figure in own])],
        }
    )


def _about(dataset: str, config: Config, settings_name: str, seconds: float | None) -> dict[str, Any]:
    return {
        "dataset": dataset,
        "version": emseg.__version__,
        "commit": source_commit(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "machine": f"{platform.machine()} {platform.system()}, Python {platform.python_version()}",
        "settings_name": settings_name,
        "settings": asdict(config),
        "seconds": seconds,
    }


def _most_telling(views: list[View]) -> list[View]:
    """The worst and the best of all recordings, and windows without truth where there is room."""
    scored = sorted((view for view in views if view.score == view.score), key=lambda view: view.score)
    half = MOST_VIEWS // 2
    chosen = scored if len(scored) <= MOST_VIEWS else [*scored[:half], *scored[-half:]]
    unscored = [view for view in views if view.score != view.score]
    return [*chosen, *unscored[: MOST_VIEWS - len(chosen)]]
