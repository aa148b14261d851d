"""The engine as teacher: a recording whose labels are what the engine makes of it, without any truth."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emseg.events import EventArray
from emseg.nets.recordings import Image, LabelledRecording
from emseg.segmentation import Segmenter

__all__ = ["BELIEVED", "EngineLabels", "engine_labels", "label_image"]

BELIEVED: Final = 0.4


def engine_labels(events: EventArray) -> NDArray[np.int32]:
    """The label that the engine gives each event with its default settings: 0 background, 1.., -1 noise."""
    labels = np.full(len(events), -1, np.int32)
    for window in Segmenter(width=events.width, height=events.height).run(events):
        labels[window.start : window.stop] = window.labels
    return labels


def label_image(events: EventArray, labels: NDArray[np.integer[Any]]) -> NDArray[np.int16]:
    """The label that most events of a pixel have, noise left out, (h, w); -1 where there is none."""
    kept = labels >= 0
    image = np.full(events.width * events.height, -1, np.int16)
    pixel = events.y[kept].astype(np.int64) * events.width + events.x[kept]
    span = int(labels.max(initial=0)) + 1
    pairs, counts = np.unique(pixel * span + labels[kept], return_counts=True)
    # Later entries overwrite: the most frequent last, and of equals the greater label.
    order = np.argsort(counts, kind="stable")
    image[pairs[order] // span] = pairs[order] % span
    return image.reshape(events.height, events.width)


class EngineLabels:
    """A recording whose masks are the engine's labels, at the pixels that have events; nothing else is known.

    Args:
        recording: Of it only events, intrinsics and moments are used.
        width: Of the time around a moment whose events tell its mask, s.
        believed: Share of a mask's pixels that may move: what is called background should be most of a scene,
            and where it is not, the engine has probably taken parallax for motion; such a mask is not known.
    """

    def __init__(self, recording: LabelledRecording, *, width: float, believed: float = BELIEVED) -> None:
        self._recording = recording
        self._width_us = round(1e6 * width)
        self._believed = believed

    @property
    def name(self) -> str:
        """The recording's."""
        return self._recording.name

    @property
    def events(self) -> EventArray:
        """The recording's."""
        return self._recording.events

    @property
    def K(self) -> NDArray[np.float64]:
        """The recording's."""
        return self._recording.K

    @property
    def times(self) -> NDArray[np.int64]:
        """The recording's."""
        return self._recording.times

    @property
    def T_world_camera(self) -> None:
        """Not known."""
        return None

    @cached_property
    def _labels(self) -> NDArray[np.int32]:
        return engine_labels(self.events)

    def mask(self, moment: int) -> Image:
        """The engine's labels, int16 (h, w); -1 where it gives none, or all of them are not believed."""
        start = self.times[moment] - self._width_us // 2
        begin, end = np.searchsorted(self.events.t, [start, start + self._width_us])
        image = label_image(self.events[begin:end], self._labels[begin:end])
        if np.count_nonzero(image > 0) > self._believed * np.count_nonzero(image >= 0):
            image[:] = -1
        return image

    def depth(self, moment: int) -> None:
        """Not known."""
        return None

    def flow(self, moment: int) -> None:
        """Not known."""
        return None

    def owners(self) -> None:
        """Not known."""
        return None
