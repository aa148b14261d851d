"""Objects through time: the parts of a motion that lie apart, and identities from window to window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.events import EventArray
from emseg.motion import MotionModel, warp

__all__ = ["BOX_DTYPE", "Tracker", "bounding_box"]

BOX_DTYPE: Final = np.dtype([("track", "i4"), ("x", "f4"), ("y", "f4"), ("w", "f4"), ("h", "f4")])
"""A track's box: left upper corner and size, px."""

MEMORY_US: Final = 300_000
"""How long a track that is not seen keeps its identity, µs."""

Box = tuple[float, float, float, float]


def bounding_box(positions: npt.NDArray[np.float32]) -> Box:
    """Box (x, y, w, h), px, of positions (n, 2), without the outermost hundredth on every side."""
    low, high = np.quantile(positions, (0.01, 0.99), axis=0)
    x, y = float(low[0]), float(low[1])
    return x, y, float(high[0]) - x + 1, float(high[1]) - y + 1


def connected_components(occupied: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Component of every occupied cell of a small grid, diagonal neighbours joined; -1 elsewhere.

    Components are numbered from 0 by their first cell in raster order.  SciPy's `label` does the same, but
    importing it takes longer than segmenting many windows.
    """
    height, width = occupied.shape
    nobody = occupied.size
    first = np.full((height + 2, width + 2), nobody)
    inner = first[1:-1, 1:-1]
    inner[occupied] = np.flatnonzero(occupied)
    while True:  # every cell takes the first cell known around it, until nothing changes
        rows = np.minimum(np.minimum(first[:-2], first[1:-1]), first[2:])
        around = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
        around[~occupied] = nobody
        if np.array_equal(around, inner):
            break
        inner[:] = around
    components = np.full(occupied.shape, -1)
    components[occupied] = np.unique(inner[occupied], return_inverse=True)[1]
    return components


def best_pairs(gain: npt.NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs of a row and a column with the largest total gain (rows, columns), each used at most once.

    Rows are added one by one along shortest augmenting paths (Jonker & Volgenant, Computing 38, 1987), as in
    SciPy's `linear_sum_assignment`, whose import would take longer than segmenting many windows.
    """
    if gain.shape[0] > gain.shape[1]:
        return sorted((row, column) for column, row in best_pairs(gain.T))
    rows, columns = gain.shape
    row_price, price = np.zeros(rows), np.zeros(columns)  # dual: row_price + price ≤ -gain
    row_of = np.full(columns, -1)
    for added in range(rows):
        reach, came_from = np.full(columns, np.inf), np.full(columns, -1)
        done = np.zeros(columns, bool)
        row, column, length = added, -1, 0.0
        while row >= 0:  # grow the tree of shortest paths until it reaches a free column
            through = length - gain[row] - row_price[row] - price
            nearer = ~done & (through < reach)
            reach[nearer], came_from[nearer] = through[nearer], column
            column = int(np.argmin(np.where(done, np.inf, reach)))
            length = float(reach[column])
            done[column] = True
            row = int(row_of[column])
        row_price[added] += length
        settled = done & (row_of >= 0)
        row_price[row_of[settled]] += length - reach[settled]
        price[done] -= length - reach[done]
        while column >= 0:  # each column on the path takes the row of the one before it
            before = int(came_from[column])
            row_of[column] = added if before < 0 else row_of[before]
            column = before
    return sorted((int(row_of[column]), int(column)) for column in np.flatnonzero(row_of >= 0))


def split_apart(positions: npt.NDArray[np.float32], gap: int) -> npt.NDArray[np.intp]:
    """Part of every position (n, 2): positions of two parts lie more than about `gap` px apart.

    Parts are numbered from 0, largest first.  Crumbs, with less than 30 positions or a twenty-fifth of the
    largest part's, are numbered -1.
    """
    cells = np.floor(positions / gap).astype(np.intp)
    cells -= cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0) + 1, bool)
    occupied[cells[:, 0], cells[:, 1]] = True
    part = connected_components(occupied)[cells[:, 0], cells[:, 1]]
    sizes = np.bincount(part)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    rank[sizes < min(max(30, sizes.max() / 25), sizes.max())] = -1
    parts: npt.NDArray[np.intp] = rank[part]
    return parts


@dataclass
class _Track:
    number: int
    box: Box
    velocity: npt.NDArray[np.float64]  # px/s of the box's centre
    seen: int  # µs

    def predicted(self, t: int) -> Box:
        dx, dy = self.velocity * ((t - self.seen) * 1e-6)
        x, y, w, h = self.box
        return x + float(dx), y + float(dy), w, h


def _overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes."""
    w = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    h = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    shared = max(0.0, w) * max(0.0, h)
    return shared / (a[2] * a[3] + b[2] * b[3] - shared)


class Tracker:
    """Gives the moving labels of successive windows the numbers of the objects that they are.

    Args:
        width: Width of the sensor, px.
        height: Height of the sensor, px.
    """

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        self._gap = max(4, max(width, height) // 24)
        self._tracks: list[_Track] = []
        self._next_number = 1

    def assign(
        self,
        events: EventArray,
        labels: npt.NDArray[np.int32],
        models: Sequence[MotionModel],
        t_ref: int,
        camera: Camera | None,
    ) -> tuple[npt.NDArray[np.int32], list[MotionModel]]:
        """Replace the labels above 0 of one window by track ids.

        Args:
            events: The window's events.
            labels: int32 (n,): 0 background, 1.. motions, -1 noise.
            models: One per label, in the order of the labels.
            t_ref: Reference time, µs; later than the last window's.
            camera: The camera, if there is one.

        Returns:
            The labels, int32 (n,), and one model per label, the background's first.
        """
        renamed = np.where(labels > 0, 0, labels).astype(np.int32)
        crumbs: list[npt.NDArray[np.intp]] = [np.empty(0, np.intp)]
        objects: list[tuple[npt.NDArray[np.intp], Box, MotionModel]] = []
        for model in models[1:]:
            own = np.flatnonzero(labels == model.label)
            if not len(own):
                continue
            positions = warp(events[own], model, t_ref, camera=camera)
            part = split_apart(positions, self._gap)
            crumbs.append(own[part < 0])
            for number in range(int(part.max()) + 1):
                chosen = part == number
                if chosen.any():
                    objects.append((own[chosen], bounding_box(positions[chosen]), model))
        # Crumbs of a motion far from its objects are its chance coincidences with something else.
        renamed[np.concatenate(crumbs)] = -1
        objects.sort(key=lambda found: (-len(found[0]), int(found[0][0])))

        numbers = self._match([box for _, box, _ in objects], t_ref)
        kept = [MotionModel(models[0].kind, models[0].params, 0)]
        for (own, box, model), number in zip(objects, numbers, strict=True):
            renamed[own] = number
            kept.append(MotionModel(model.kind, model.params, number))
            self._remember(_Track(number, box, self._velocity(model, box, camera), t_ref))
        self._tracks = [track for track in self._tracks if t_ref - track.seen <= MEMORY_US]
        return renamed, kept

    def _match(self, boxes: list[Box], t_ref: int) -> list[int]:
        """Numbers of the boxes: that of the track whose predicted box overlaps, each once; else new ones."""
        numbers = [0] * len(boxes)
        if boxes and self._tracks:
            gain = np.array([[_overlap(box, t.predicted(t_ref)) for t in self._tracks] for box in boxes])
            for i, j in best_pairs(gain):
                if gain[i, j] > 0.1:
                    numbers[i] = self._tracks[j].number
        for i, number in enumerate(numbers):
            if number == 0:
                numbers[i] = self._next_number
                self._next_number += 1
        return numbers

    def _remember(self, seen: _Track) -> None:
        self._tracks = [track for track in self._tracks if track.number != seen.number] + [seen]

    def _velocity(self, model: MotionModel, box: Box, camera: Camera | None) -> npt.NDArray[np.float64]:
        """Velocity of a box's centre under a motion, px/s."""
        x = min(max(round(box[0] + box[2] / 2), 0), self._size[0] - 1)
        y = min(max(round(box[1] + box[3] / 2), 0), self._size[1] - 1)
        columns: dict[str, Any] = {"width": self._size[0], "height": self._size[1]}
        centre = EventArray([x, x], [y, y], [0, 1000], [0, 0], **columns)
        at, moved = warp(centre, model, 0, camera=camera).astype(np.float64)
        velocity: npt.NDArray[np.float64] = (at - moved) * 1e3
        return velocity
