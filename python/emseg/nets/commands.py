"""What the commands about networks do; errors are a ValueError or OSError of one line."""

from __future__ import annotations

import json
import logging
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from emseg.nets.checkpoints import load_networks
from emseg.nets.recordings import LabelledRecording, Split, find_recordings
from emseg.nets.settings import RunSettings
from emseg.nets.slices import SliceDataset

__all__ = ["compare", "evaluate", "export", "predict", "train", "tune"]

Echo = Callable[..., Any]
Labels = Literal["truth", "engine"]


def _quiet() -> None:
    """Lightning tells much that is no news to who runs a command."""
    import lightning  # noqa: F401  (it sets its loggers up when it is imported)

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

    options: dict[str, Any] = {"without_mask": "keep" if labels == "truth" else "drop"}
    slices, network = settings.slices, settings.network
    return (
        SliceDataset(recordings("train"), slices, network, augmentation=settings.training, **options),
        SliceDataset(recordings("validation"), slices, network, **options),
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


def evaluate(
    data: Path, checkpoint: Path, split: Split | Literal["all"], out: Path | None, echo: Echo
) -> None:
    """Print the figures of each recording and of all, at the threshold that validation chose."""
    _quiet()
    from emseg.nets.evaluation import evaluate_networks

    trained = load_networks(checkpoint)
    results = evaluate_networks(trained, find_recordings(data, split))
    for name, figures in results.items():
        echo(f"{name}: {_line(figures)}")
    if out is not None:
        content = {
            "checkpoint": checkpoint.name,
            "split": split,
            "about": dict(trained.about),
            "figures": results,
        }
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def predict(
    recording: Path, checkpoint: Path, out: Path, camera: Path | None, pictures: int, echo: Echo
) -> None:
    """Write what networks see in a recording."""
    from emseg.camera import Camera
    from emseg.io import read
    from emseg.nets.prediction import predict_recording

    trained = load_networks(checkpoint)
    events = read(recording)
    calibrated = (
        None if camera is None else Camera.from_file(camera, width=events.width, height=events.height)
    )
    folder = predict_recording(trained, events, out / recording.stem, camera=calibrated, pictures=pictures)
    echo(f"done: {folder}")


def tune(data: Path, out: Path, settings: RunSettings, trials: int, echo: Echo) -> None:
    """Search, saying a line a trial."""
    _quiet()
    from emseg.nets.tuning import search

    best = search(settings, lambda changed: _datasets(data, changed, "truth"), out, trials=trials, echo=echo)
    echo(f"done: {out / 'best.yaml'}: validation loss {best:.4f}")


def export(checkpoint: Path, out: Path, size: str, echo: Echo) -> None:
    """Write TorchScript."""
    from emseg.nets.export import export_torchscript

    match = re.fullmatch(r"(\d{1,4})x(\d{1,4})", size)
    if match is None:
        raise ValueError(f"--size {size}: expected such as 346x260")
    export_torchscript(load_networks(checkpoint), out, width=int(match[1]), height=int(match[2]))
    echo(f"done: {out}")


def compare(
    data: Path, out: Path, checkpoints: list[Path], split: Split | Literal["all"], pictures: int, echo: Echo
) -> None:
    """Print the table of engine and networks, and write it with pictures."""
    from emseg.nets.comparison import compare_methods

    table = compare_methods(find_recordings(data, split), checkpoints, out, pictures=pictures)
    echo(table)
    echo(f"done: {out}")
