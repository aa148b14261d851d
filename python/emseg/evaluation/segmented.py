"""A recording segmented from end to end, with what scoring needs of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from emseg.config import Config
from emseg.datasets import LabelledRecording
from emseg.motion import MotionModel
from emseg.segmentation import Segmenter

__all__ = ["SegmentedRecording", "SegmentedWindow", "segment_recording"]


@dataclass(frozen=True)
class SegmentedWindow:
    """A window: its events in the recording, the time that events are warped to (µs), models and boxes."""

    start: int
    stop: int
    t_ref: int
    models: list[MotionModel]
    boxes: npt.NDArray[Any]


@dataclass(frozen=True)
class SegmentedRecording:
    """Labels of all events, int32 (n,), and the windows that they were found in, with the time it took."""

    labels: npt.NDArray[np.int32]
    windows: list[SegmentedWindow]
    cpu_s: float
    wall_s: float


def segment_recording(
    recording: LabelledRecording, config: Config, *, progress: Callable[[int], None] | None = None
) -> SegmentedRecording:
    """Segment a recording by `Segmenter.run`; progress is called with the events done."""
    events = recording.events
    labels = np.full(len(events), -1, np.int32)
    windows = []
    cpu, wall = time.process_time(), time.perf_counter()
    segmenter = Segmenter(events.width, events.height, recording.camera, config)
    for seg in segmenter.run(events):
        labels[seg.start : seg.stop] = seg.labels
        windows.append(SegmentedWindow(seg.start, seg.stop, seg.t_ref, seg.models, seg.boxes))
        if progress is not None:
            progress(seg.stop)
    return SegmentedRecording(labels, windows, time.process_time() - cpu, time.perf_counter() - wall)
