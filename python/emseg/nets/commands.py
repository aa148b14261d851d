"""What the commands about networks do; errors are a ValueError or OSError of one line."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from emseg.nets.recordings import LabelledRecording, Split, find_recordings
from emseg.nets.settings import RunSettings
from emseg.nets.slices import SliceDataset

__all__ = ["train"]

Echo = Callable[..., Any]
Labels = Literal["truth", "engine"]


def _quiet() -> None:
    """Lightning tells much that is no news to who runs a command."""
    import lightning  # noqa: F401: it sets its loggers up when it is imported

    for name in (
        "lightning.pytorch",
        "lightning.pytorch.utilities.rank_zero",
        "lightning.fabric",
        "lightning",
    ):
        logging.getLogger(name).setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", module="lightning")
    warnings.filterwarnings("ignore", message=".*num_workers.*|.*ckpt_path.*")


def _datasets(data: Path, settings: RunSettings, labels: Labels) -> tuple[SliceDataset, SliceDataset]:
    def recordings(split: Split) -> list[LabelledRecording]:
        found = find_recordings(data, split)
        if labels == "truth":
            return list(found)
        from emseg.nets.teacher import EngineLabels

        return [EngineLabels(recording, width=settings.slices.width) for recording in found]

    return (
        SliceDataset(recordings("train"), settings.slices, settings.network, augmentation=settings.training),
        SliceDataset(recordings("validation"), settings.slices, settings.network),
    )


def train(
    data: Path,
    out: Path,
    settings: RunSettings,
    *,
    labels: Labels,
    existing: Literal["resume", "replace"],
    resnet18_weights: Path | None,
    max_minutes: float,
    echo: Echo,
) -> None:
    """Train, saying a line an epoch."""
    _quiet()
    from emseg.nets.resnet import read_weights
    from emseg.nets.training import EpochLines
    from emseg.nets.training import train as run

    weights = read_weights(resnet18_weights) if resnet18_weights else None
    training, validation = _datasets(data, settings, labels)
    echo(f"{len(training)} targets to learn from, {len(validation)} to validate")
    seconds = round(60 * max_minutes)
    result = run(
        settings,
        training,
        validation,
        out,
        resume=existing == "resume",
        resnet_weights=weights,
        callbacks=(EpochLines(echo),),
        about={"labels": labels, "data": data.name},
        max_time={"seconds": seconds} if seconds else None,
    )
    echo(f"done: {result.best}: validation loss {result.validation_loss:.4f}, {_line(result.figures)}")


def _line(figures: Any) -> str:
    return ", ".join(f"{name} {value:.3f}" for name, value in figures.items())
