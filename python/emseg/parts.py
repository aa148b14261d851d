"""Parts of a window: events of one motion that lie together, and what is asked of them again and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.camera import Camera
from emseg.events import EventArray
from emseg.motion import MotionModel, undistorted, warp_frame

__all__ = ["TILE", "Features", "LossFunction", "Part", "Window", "find_parts"]

TILE: Final = 16
"""Side of the tiles that parts hold, px."""

Features = npt.NDArray[np.float64]


class LossFunction(Protocol):
    """Nats an event that another motion loses against the events' own, once for every offset of it."""

    def __call__(
        self,
        events: EventArray,
        own: MotionModel,
        other: MotionModel,
        offsets: Sequence[tuple[float, float]],
    ) -> list[float]:
        """Offsets are displacements over the window, px."""


@dataclass(frozen=True)
class Part:
    """Events of one motion that lie together.

    Attributes:
        own: Indices of its events in the window.
        model: Their motion.
        tiles: Tiles of the sensor in which most events are its, bool (rows, columns).
        box: Left, top, right, bottom of all but its outermost events, px.
    """

    own: npt.NDArray[np.intp]
    model: MotionModel
    tiles: npt.NDArray[np.bool_]
    box: tuple[float, float, float, float]

    @cached_property
    def area(self) -> float:
        """Share of the sensor's tiles."""
        return float(self.tiles.mean())

    @property
    def centre(self) -> tuple[float, float]:
        """Of the box, px."""
        left, top, right, bottom = self.box
        return (left + right) / 2, (top + bottom) / 2

    def share_in(self, tiles: npt.NDArray[np.bool_]) -> float:
        """Share of the part's tiles that are among these (rows, columns); 0 where it holds none."""
        return float(tiles[self.tiles].mean()) if self.tiles.any() else 0.0

    def touches(self, other: Part) -> bool:
        """Whether tiles of the two are the same or side by side."""
        grown = other.tiles.copy()
        grown[1:] |= other.tiles[:-1]
        grown[:-1] |= other.tiles[1:]
        grown[:, 1:] |= other.tiles[:, :-1]
        grown[:, :-1] |= other.tiles[:, 1:]
        return bool((self.tiles & grown).any())


def find_parts(events: EventArray, groups: Sequence[tuple[npt.NDArray[np.intp], MotionModel]]) -> list[Part]:
    """Parts of a window, from the indices of the events and the motion of each."""
    columns, size = (events.x, events.y, events.t), (events.width, events.height)
    winner = _core.winners_of_tiles(*columns, [own for own, _ in groups], *size, TILE)
    return [
        Part(own, model, winner == number, _core.inner_box(*columns, own, *size))
        for number, (own, model) in enumerate(groups)
    ]


def _some_events(events: EventArray, part: Part, most: int = 600) -> EventArray:
    """Events of a part, evenly from its first to its last."""
    own = part.own
    if len(own) > most:
        own = own[np.linspace(0, len(own) - 1, most).astype(np.intp)]
    return events[own]


class Window:
    """What the features of a window's parts are taken from.

    Args:
        events: The window.
        duration: Its length, s.
        loss: The engine's.
        camera: The camera, if there is one.
    """

    def __init__(
        self, events: EventArray, duration: float, loss: LossFunction, camera: Camera | None = None
    ) -> None:
        self.events = events
        self.duration = duration
        self.loss = loss
        self.camera = camera
        self._frame = warp_frame(events, camera)
        self._samples: dict[int, tuple[Part, EventArray]] = {}

    def sample(self, part: Part) -> EventArray:
        """Some of a part's events, which are looked at again and again."""
        if id(part) not in self._samples:
            self._samples[id(part)] = part, _some_events(self.events, part)
        return self._samples[id(part)][1]

    def displacement(self, model: MotionModel, x: float, y: float) -> npt.NDArray[np.float64]:
        """Of what is at (x, y) px by a motion over the window, px."""
        if self.camera is not None:
            x, y = undistorted(np.array([[x, y]]), self.events, self.camera)[0].tolist()
        velocity = _core.image_velocity(*model.native(), self._frame, x, y)
        return np.array(velocity) * self.duration

    def displacements(self, model: MotionModel, places: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """As `displacement`, of places (n, 2): (n, 2)."""
        places = undistorted(places, self.events, self.camera)
        return _core.image_velocities(*model.native(), self._frame, places) * self.duration

    @cached_property
    def structure(self) -> Features:
        """Structure tensors xx, xy, yy of the tiles' edges, (rows, columns, 3)."""
        columns = self.events.x, self.events.y, self.events.t, self.events.p
        return _core.structure_tensors(*columns, self.events.width, self.events.height, TILE)
