"""What of a window is the still scene and what moves: parts of motions, and how likely each is to stand still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.events import EventArray
from emseg.motion import MotionModel

__all__ = ["Part", "find_parts", "own_features", "relative_features"]

_TILE: Final = 16  # px
_RING: Final = [(0.0, 0.0)] + [
    (r * float(np.cos(a)), r * float(np.sin(a))) for r in (2.0, 4.0) for a in np.arange(8) * np.pi / 4
]
STILL: Final = MotionModel("translation", (0.0, 0.0))


@dataclass
class Part:
    """Events of one motion that lie together.

    Attributes:
        own: Indices of its events.
        model: Their motion.
        tiles: Tiles of the sensor in which it has most of the events, bool (rows, columns).
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


def find_parts(
    events: EventArray, labels: npt.NDArray[np.int32], members: Sequence[tuple[npt.NDArray[np.intp], MotionModel]]
) -> list[Part]:
    """Parts from the events and the motion of each."""
    columns, rows = -(-events.width // _TILE), -(-events.height // _TILE)
    tile = (events.y // _TILE).astype(np.intp) * columns + events.x // _TILE
    counts = np.zeros((len(members) + 1, rows * columns), np.int64)
    for counted, (own, _) in zip(counts[1:], members, strict=True):
        counted += np.bincount(tile[own], minlength=rows * columns)
    counts[0] = 2  # of fewer, none has a tile
    winner = counts.argmax(axis=0).reshape(rows, columns)
    parts = []
    for number, (own, model) in enumerate(members, 1):
        x, y = (np.sort(values[own]) for values in (events.x, events.y))
        low, high = len(own) // 50, len(own) - 1 - len(own) // 50
        parts.append(Part(own, model, winner == number, (float(x[low]), float(y[low]), float(x[high]), float(y[high]))))
    return parts


def spread_of(tiles: npt.NDArray[np.bool_]) -> float:
    """How much of the view tiles span: 1 for all of it, by their second moments."""
    y, x = np.nonzero(tiles)
    if len(x) == 0:
        return 0.0
    xx, yy = x.var() + 1 / 12, y.var() + 1 / 12
    xy = ((x - x.mean()) * (y - y.mean())).mean()
    return float(np.sqrt(max(0.0, xx * yy - xy * xy)) * 12 / tiles.size)


def flow_at(model: MotionModel, x: float, y: float, engine: Any, t_ref: int, window: float) -> npt.NDArray[np.float64]:
    from emseg.motion import warp

    column, row = (int(min(max(v, 0), last - 1)) for v, last in ((x, engine.width), (y, engine.height)))
    e = EventArray([column, column], [row, row], [0, 1000], [0, 0], width=engine.width, height=engine.height)
    at, moved = warp(e, model, 0, camera=engine.camera).astype(np.float64)
    flow: npt.NDArray[np.float64] = (at - moved) * 1e3 * window
    return flow


def own_features(part: Part, events: EventArray, engine: Any, t_ref: int, window: float) -> list[float]:
    left, top, right, bottom = part.box
    w, h = (right - left) / events.width, (bottom - top) / events.height
    sides = (left < 6) + (right > events.width - 7) + (top < 6) + (bottom > events.height - 7)
    sub = events_of(events, part.own)
    still = losses(engine, sub, t_ref, window, part.model, STILL)
    speed = float(np.linalg.norm(flow_at(part.model, (left + right) / 2, (top + bottom) / 2, engine, t_ref, window)))
    density = len(part.own) / max(1.0, float(part.tiles.sum()) * _TILE**2)
    return [
        np.log(part.area + 0.002), spread_of(part.tiles), w, h, float(sides), float(max(w, h) > 0.85),
        still[0], min(still[:9]), min(still), min(speed, 30.0) / 10, float(np.log(density + 0.01)), len(part.own) / len(events),
    ]


def events_of(events: EventArray, own: npt.NDArray[np.intp], most: int = 1000) -> EventArray:
    if len(own) > most:
        own = own[np.linspace(0, len(own) - 1, most).astype(np.intp)]
    return events[own]


def losses(engine: Any, sub: EventArray, t_ref: int, window: float, own: MotionModel, other: MotionModel) -> list[float]:
    found: list[float] = engine._engine.motion_losses(
        sub.x, sub.y, sub.t, sub.p, t_ref, max(window, 1e-6), own.native(), other.native(), _RING
    )
    return found


def relative_features(part: Part, seed: Part | None, events: EventArray, engine: Any, t_ref: int, window: float) -> list[float]:
    reference = STILL if seed is None else seed.model
    left, top, right, bottom = part.box
    sub = events_of(events, part.own)
    if seed is part:
        lost = [0.0] * len(_RING)
    else:
        lost = losses(engine, sub, t_ref, window, part.model, reference)
    x, y = (left + right) / 2, (top + bottom) / 2
    flow, back = (flow_at(m, x, y, engine, t_ref, window) for m in (part.model, reference))
    rel = float(np.linalg.norm(flow - back))
    return [lost[0], min(lost[:9]), min(lost), min(rel, 30) / 10, min(float(np.linalg.norm(back)), 30) / 10, float(seed is part), float(seed is None), max(0.0, 1.2 - rel), lost[0] * (rel < 4)]
