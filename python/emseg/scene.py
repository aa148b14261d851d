"""What of a window is the still scene and what moves.

A still scene at several depths moves at several speeds in the image, an object may make most of the events, and a
straight edge leaves its motion along itself open.  No single number tells them apart, but together a few do: how much
of the view a part spans, whether it reaches the sensor's border, and how many nats an event of it loses when it is
made to move as the rest of the scene does, or within a few pixels of that, as parallax would have it.  A small network
weighs them.  It was trained on simulated scenes (scripts/train_scene.py), none of which is a recording or a scene that
emseg is measured on.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.events import EventArray
from emseg.motion import MotionModel, warp

__all__ = [
    "MIN_EVENTS",
    "LossFunction",
    "Part",
    "Perceptron",
    "appearance",
    "choose_background",
    "find_parts",
    "motion_against",
    "moving_logits",
]

MIN_EVENTS: Final = 30
"""Of a part: what is smaller is not judged."""

STILL: Final = MotionModel("translation", (0.0, 0.0))

_TILE: Final = 16  # px
_LARGE: Final = 0.03  # share of the view that a background fills at least
_BORDER: Final = 6  # px
_NEAR, _FAR = 2.0, 4.0  # px over the window that parallax may add
_RING: Final = [(0.0, 0.0)] + [
    (radius * float(np.cos(angle)), radius * float(np.sin(angle)))
    for radius in (_NEAR, _FAR)
    for angle in np.arange(8) * np.pi / 4
]

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

    @property
    def area(self) -> float:
        """Share of the sensor's tiles."""
        return float(self.tiles.mean())

    @property
    def centre(self) -> tuple[float, float]:
        """Of the box, px."""
        left, top, right, bottom = self.box
        return (left + right) / 2, (top + bottom) / 2


def find_parts(
    events: EventArray, groups: Sequence[tuple[npt.NDArray[np.intp], MotionModel]]
) -> list[Part]:
    """Parts of a window, from the indices of the events and the motion of each."""
    columns, rows = -(-events.width // _TILE), -(-events.height // _TILE)
    tile = (events.y // _TILE).astype(np.intp) * columns + events.x // _TILE
    counts = np.full((len(groups) + 1, rows * columns), 2)  # the first is nobody's: two events make no tile
    for number, (own, _) in enumerate(groups, 1):
        counts[number] = np.bincount(tile[own], minlength=rows * columns)
    winner = counts.argmax(axis=0).reshape(rows, columns)
    return [
        Part(own, model, winner == number, _inner_box(events, own))
        for number, (own, model) in enumerate(groups, 1)
    ]


def _inner_box(events: EventArray, own: npt.NDArray[np.intp]) -> tuple[float, float, float, float]:
    low, high = len(own) // 50, len(own) - 1 - len(own) // 50
    (left, right), (top, bottom) = (np.partition(v[own], (low, high))[[low, high]] for v in (events.x, events.y))
    return float(left), float(top), float(right), float(bottom)


def _spread(tiles: npt.NDArray[np.bool_]) -> float:
    """How much of the view tiles span by their second moments: 1 for all of it."""
    y, x = np.nonzero(tiles)
    if len(x) == 0:
        return 0.0
    # 1/12: the variance of a tile within itself.
    xx, yy = x.var() + 1 / 12, y.var() + 1 / 12
    xy = ((x - x.mean()) * (y - y.mean())).mean()
    return float(np.sqrt(max(0.0, xx * yy - xy * xy)) * 12 / tiles.size)


def _some_events(events: EventArray, part: Part, most: int = 600) -> EventArray:
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

    def __init__(self, events: EventArray, duration: float, loss: LossFunction, camera: Camera | None) -> None:
        self.events = events
        self.duration = duration
        self.loss = loss
        self.camera = camera

    def displacement(self, model: MotionModel, x: float, y: float) -> npt.NDArray[np.float64]:
        """Of what is at (x, y) px by a motion over the window, px."""
        place = [min(max(round(v), 0), last - 1) for v, last in ((x, self.events.width), (y, self.events.height))]
        columns = {"width": self.events.width, "height": self.events.height}
        twice = EventArray([place[0]] * 2, [place[1]] * 2, [0, 1000], [0, 0], **columns)
        at, moved = warp(twice, model, 0, camera=self.camera).astype(np.float64)
        result: npt.NDArray[np.float64] = (at - moved) * 1e3 * self.duration
        return result


def appearance(part: Part, window: Window) -> Features:
    """What a part is by itself: size, place, and what it loses by standing still."""
    events = window.events
    left, top, right, bottom = part.box
    w, h = (right - left) / events.width, (bottom - top) / events.height
    sides = (
        int(left < _BORDER)
        + int(right > events.width - 1 - _BORDER)
        + int(top < _BORDER)
        + int(bottom > events.height - 1 - _BORDER)
    )
    (still,) = window.loss(_some_events(events, part), part.model, STILL, _RING[:1])
    speed = float(np.linalg.norm(window.displacement(part.model, *part.centre)))
    density = len(part.own) / max(1.0, float(part.tiles.sum()) * _TILE**2)
    return np.array(
        [
            np.log(part.area + 0.002),
            _spread(part.tiles),
            w,
            h,
            sides,
            max(w, h) > 0.85,
            still,
            min(speed, 30.0) / 10,
            np.log(density + 0.01),
            len(part.own) / len(events),
        ],
        dtype=np.float64,
    )


def motion_against(part: Part, background: Part | None, window: Window) -> Features:
    """What a part loses by moving as the background, or near it; None: the background stands still unseen."""
    reference = STILL if background is None else background.model
    if background is part:
        lost = [0.0] * len(_RING)
    else:
        lost = window.loss(_some_events(window.events, part), part.model, reference, _RING)
    own, other = (window.displacement(model, *part.centre) for model in (part.model, reference))
    apart = float(np.linalg.norm(own - other))
    return np.array(
        [
            lost[0],
            min(lost[:9]),
            min(lost),
            min(apart, 30.0) / 10,
            min(float(np.linalg.norm(other)), 30.0) / 10,
            background is part,
            background is None,
            max(0.0, 1.2 - apart),
            lost[0] if apart < 4 else 0.0,
            0.0 if background is None else background.area,
        ],
        dtype=np.float64,
    )


@dataclass(frozen=True)
class Perceptron:
    """One hidden layer: logits of features.

    Attributes:
        mean: Of each feature, (n,).
        scale: Of each feature, (n,).
        hidden: Weights (n, h).
        bias: (h,).
        out: Weights (h,).
        level: Of the logit.
    """

    mean: Features
    scale: Features
    hidden: Features
    bias: Features
    out: Features
    level: float

    def __call__(self, features: Features) -> Features:
        """Logits (m,) of features (m, n)."""
        standard = (features - self.mean) / self.scale
        logits: Features = np.tanh(standard @ self.hidden + self.bias) @ self.out + self.level
        return logits


@cache
def _classifiers() -> tuple[Perceptron, Perceptron]:
    """By appearance alone, and with the motion against the background."""
    text = resources.files("emseg").joinpath("data/scene_classifiers.json").read_text()
    weights = json.loads(text)
    first, second = (
        Perceptron(**{name: np.array(v) if isinstance(v, list) else v for name, v in weights[which].items()})
        for which in ("appearance", "motion")
    )
    return first, second


def choose_background(parts: Sequence[Part], logits: Features) -> Part | None:
    """The part that is largest and surest to stand still by appearance; None where none is likely to."""
    best: tuple[float, Part | None] = (0.0, None)
    for part, logit in zip(parts, logits, strict=True):
        still = 1 / (1 + np.exp(np.clip(logit, -50, 50)))
        if part.area >= _LARGE and still >= 0.25 and part.area**0.5 * still > best[0]:
            best = part.area**0.5 * still, part
    return best[1]


def moving_logits(parts: Sequence[Part], window: Window) -> tuple[Features, Part | None]:
    """How likely each part is to move by itself, as logits, and the part taken for the background."""
    if not parts:
        return np.empty(0), None
    by_appearance, by_motion = _classifiers()
    own = np.array([appearance(part, window) for part in parts])
    background = choose_background(parts, by_appearance(own))
    against = np.array([motion_against(part, background, window) for part in parts])
    return by_motion(np.hstack([own, against])), background
