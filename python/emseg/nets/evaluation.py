"""Figures of trained networks on recordings with truth."""

from __future__ import annotations

from collections.abc import Iterable

from torch.utils.data import DataLoader

from emseg.nets.checkpoints import TrainedNetworks
from emseg.nets.figures import ValidationFigures, predict
from emseg.nets.recordings import LabelledRecording
from emseg.nets.slices import SliceDataset

__all__ = ["ALL", "evaluate_networks"]

ALL = "all"
BATCH = 4


def evaluate_networks(
    trained: TrainedNetworks, recordings: Iterable[LabelledRecording]
) -> dict[str, dict[str, float]]:
    """The figures of each recording by its name, and of all together under "all".

    Masks are cut at the threshold that validation chose.
    """
    together = ValidationFigures()
    results: dict[str, dict[str, float]] = {}
    for recording in recordings:
        alone = ValidationFigures()
        dataset = SliceDataset([recording], trained.settings.slices, trained.settings.network)
        for batch in DataLoader(dataset, batch_size=BATCH):
            prediction = predict(trained.networks, batch)
            alone.update(prediction, batch)
            together.update(prediction, batch)
        results[recording.name] = alone.compute(trained.threshold)
    results[ALL] = together.compute(trained.threshold)
    return results
