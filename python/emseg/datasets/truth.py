"""What data sets know of a recording: labels per event, masks, boxes, flow, depth, and what stands still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.events import EventArray

__all__ = [
    "BoxTrack",
    "Dataset",
    "DatasetError",
    "FlowTrack",
    "ImageTrack",
    "LabelledRecording",
    "Truth",
]

Times = npt.NDArray[np.int64]
Span = tuple[float, float]
"""Seconds from the first event: from (inclusive), to (exclusive)."""

UNKNOWN: Final = -1
"""In masks: a pixel of which it is not known whether it moves."""


class DatasetError(ValueError):
    """A data set that is not there or not as its makers describe it; the message names the place."""


@dataclass(frozen=True)
class ImageTrack:
    """Images at moments, loaded when asked for.

    t: µs, int64 (n,), rising.  load: gives the k-th, (h, w); of masks int: 0 background, 1.. moving objects,
    -1 unknown; of depth float: m, 0 or NaN where unknown.
    """

    t: Times
    load: Callable[[int], npt.NDArray[Any]]

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, k: int) -> npt.NDArray[Any]:
        return self.load(k)


@dataclass(frozen=True)
class BoxTrack:
    """Boxes at moments.  t: µs, int64 (n,); boxes: (n, 4) x, y, w, h in px; moments may recur."""

    t: Times
    boxes: npt.NDArray[np.float64]


@dataclass(frozen=True)
class FlowTrack:
    """Flow of what pixels show, from a moment to another.

    t_from, t_to: µs, int64 (n,).  load: gives the k-th, float (h, w, 2), px of the sensor, NaN where unknown.
    """

    t_from: Times
    t_to: Times
    load: Callable[[int], npt.NDArray[Any]]

    def __len__(self) -> int:
        return len(self.t_from)


@dataclass(frozen=True)
class Truth:
    """All that is known; None where it is not.

    Attributes:
        labels: Per event, (n,): 0 background, 1.. objects, -1 noise.
        masks: Of moving objects.
        boxes: Of moving objects.
        flow: Of pixels.
        depth: Of pixels.
        scene: "still" where nothing moves but the camera, "moving" where objects do, "unknown".
    """

    labels: npt.NDArray[np.int64] | None = None
    masks: ImageTrack | None = None
    boxes: BoxTrack | None = None
    flow: FlowTrack | None = None
    depth: ImageTrack | None = None
    scene: Literal["still", "moving", "unknown"] = "unknown"


@dataclass(frozen=True)
class LabelledRecording:
    """A recording of a data set with its truth.

    Attributes:
        name: Its name in the data set.
        events: Its events.
        group: What published figures put it in, such as EV-IMO's "table"; empty where they do not.
        camera: Calibration, if the data set has one that fits.
        truth: What is known of it.
    """

    name: str
    events: EventArray
    group: str = ""
    camera: Camera | None = None
    truth: Truth = field(default_factory=Truth)


@runtime_checkable
class Dataset(Protocol):
    """Recordings in the order of their names."""

    @property
    def name(self) -> str:
        """The name that the registry knows it by."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> LabelledRecording: ...

    def load(self, index: int, *, span: Span | None = None) -> LabelledRecording:
        """A recording, or the part of it in a span of seconds from its first event.

        Raises:
            ValueError: a file is damaged or not as expected; the message names it.
        """
