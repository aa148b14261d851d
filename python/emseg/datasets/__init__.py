"""Recordings: those that come with the package, and the public data sets through one Protocol."""

from pathlib import Path

from emseg.datasets.registry import DatasetEntry, known_datasets, open_dataset
from emseg.datasets.truth import (
    BoxTrack,
    Dataset,
    DatasetError,
    FlowTrack,
    ImageTrack,
    LabelledRecording,
    Truth,
)

__all__ = [
    "BoxTrack",
    "Dataset",
    "DatasetEntry",
    "DatasetError",
    "FlowTrack",
    "ImageTrack",
    "LabelledRecording",
    "Truth",
    "bundled",
    "known_datasets",
    "open_dataset",
]


def bundled() -> dict[str, Path]:
    """The recordings in the package, by name, as .npz files of x, y, t (µs), p, width, height.

    `cars`: a DAVIS346 (346x260) standing still above a road; three cars; 78,830 events in 2.36 s.
    `made_scene`: a made scene with a moving camera and two objects, with the truth per event in `label`;
    see `emseg.datasets.made_scene`.
    """
    folder = Path(__file__).parent / "data"
    return {"cars": folder / "cars_davis346.npz", "made_scene": folder / "made_scene.npz"}
