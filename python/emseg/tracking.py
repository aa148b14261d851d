"""Objects through time: the parts of a motion that lie apart, and identities from window to window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.camera import Camera
from emseg.events import EventArray
from emseg.motion import MotionModel, warp_some
from emseg.parts import TILE, Part, Window, find_parts
from emseg.scene import moving_logits

__all__ = ["BOX_DTYPE", "Objects", "TrackedMotion", "Tracker", "bounding_box"]

BOX_DTYPE: Final = np.dtype([("track", "i4"), ("x", "f4"), ("y", "f4"), ("w", "f4"), ("h", "f4")])
"""A track's box: left upper corner and size, px."""

MEMORY_US: Final = 300_000
"""How long a track that is not seen keeps its identity, µs."""

_HALF_FORGOTTEN_US: Final = 30_000  # age at which a track's number counts half
_MEMORY: Final = 0.7  # share of the evidence of earlier windows that counts in the next
_LATE_US: Final = 100_000  # how long an object that is not seen is expected where it would have gone, µs
_WENT: Final = 1.5  # weight of where a part went
_TOLD_APART: Final = 8.0  # px between two windows, from which on that can be told
_PLACES: Final = 400  # events of a part, at the most, whose places are remembered
_SURE: Final = 6.0  # logit beyond which evidence does not add up

Box = tuple[float, float, float, float]
WindowLoss = Callable[..., list[float]]


def bounding_box(positions: npt.NDArray[np.float32]) -> Box:
    """Box (x, y, w, h), px, of positions (n, 2), without the outermost hundredth on every side."""
    left, top, right, bottom = _core.outer_box(positions)
    return left, top, right - left + 1, bottom - top + 1


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


@dataclass
class _Track:
    """A part as it was last seen; it has a number once it has moved."""

    number: int
    box: Box
    velocity: npt.NDArray[np.float64]  # px/s of the box's centre
    seen: int  # µs
    evidence: float  # that it moves: logits of its windows, older ones forgotten
    model: MotionModel
    places: npt.NDArray[np.float32]  # of some of its events then, px; none before it has moved

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


@dataclass(frozen=True)
class TrackedMotion:
    """The motion of an object that is known to be there.

    Attributes:
        model: How it moves.
        places: Where some of its events were, px, float32 (n, 2); none: it may be anywhere.
        t: When they were there, µs.
    """

    model: MotionModel
    places: npt.NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 2), np.float32))
    t: int = 0


@dataclass(frozen=True)
class Objects:
    """The moving objects of a window.

    Attributes:
        labels: int32 (n,): 0 background, 1.. track ids, -1 noise.
        models: One per label, the background's first; an object's is that of its largest part.
        parts: int32 (n,): as labels, with a number of its own for every part that moves by itself.
        part_models: One per part, the background's first.
        flows: Displacement of every moving part against the background over the window, px, and its events.
        background_flow: Displacement of the slowest larger part of the background, px.
    """

    labels: npt.NDArray[np.int32]
    models: list[MotionModel]
    parts: npt.NDArray[np.int32]
    part_models: list[MotionModel]
    flows: list[tuple[npt.NDArray[np.float64], int]]
    background_flow: npt.NDArray[np.float64]


class Tracker:
    """Tells the moving parts of successive windows, joins them to objects, and keeps the objects' numbers.

    Args:
        width: Width of the sensor, px.
        height: Height of the sensor, px.
        camera: The camera, if there is one.
        loss: The engine's, by which parts are held against the background; None: all labels above 0 move.
        least_evidence: Logit from which on a part that was no object before moves; an object takes 0.
    """

    def __init__(
        self,
        width: int,
        height: int,
        camera: Camera | None = None,
        loss: WindowLoss | None = None,
        *,
        least_evidence: float = 0.0,
    ) -> None:
        self._gap = max(4, max(width, height) // 24)
        self._camera = camera
        self._loss = loss
        self._least_evidence = least_evidence
        self._tracks: list[_Track] = []
        self._next_number = 1

    def assign(
        self, events: EventArray, labels: npt.NDArray[np.int32], models: Sequence[MotionModel], t_ref: int
    ) -> Objects:
        """The objects of the next window.

        Args:
            events: The window's events.
            labels: int32 (n,): 0 background, 1.. motions, -1 noise.
            models: One per label, in the order of the labels.
            t_ref: Reference time, µs; later than the last window's.
        """
        groups, crumbs = self.split(events, labels, models, t_ref)
        parts = find_parts(events, groups)
        duration = max(1, int(events.t[-1] - events.t[0])) * 1e-6 if len(events) else 1e-6
        loss = partial(self._loss, t_ref=t_ref, duration=duration) if self._loss else _no_loss
        window = Window(events, duration, loss, self._camera)
        expected: list[tuple[_Track, npt.NDArray[np.bool_]]] = []
        if self._loss is None:
            logits = np.array([np.inf if part.model.label else -np.inf for part in parts])
            background, still_model = None, models[0]
        else:
            expected = self._expected(events, t_ref)
            taken = np.any([tiles for _, tiles in expected], axis=0) if expected else None
            logits, background, still_model = moving_logits(parts, window, taken)

        boxes = [bounding_box(warp_some(events, p.own, p.model, t_ref, camera=self._camera)) for p in parts]
        seen = self._match(boxes, [part is background for part in parts], t_ref)
        evidence = [
            logit + self._evidence_before(part, box, track, window, still_model, expected, t_ref)
            for logit, part, box, track in zip(logits, parts, boxes, seen, strict=True)
        ]
        # An object lives on by less than it is born by.
        least = [0.0 if track and track.number else self._least_evidence for track in seen]
        moving = [k for k in range(len(parts)) if evidence[k] > least[k] and parts[k] is not background]
        flows = {k: self._flow(parts[k], still_model, window) for k in moving}
        objects = self._join(parts, moving, flows)

        numbers = [track.number if track else 0 for track in seen]
        # Of the tracks of an object's parts the latest are meant: parts may have become one since.
        votes = [
            len(part.own) * 0.5 ** ((t_ref - track.seen if track else 0) / _HALF_FORGOTTEN_US)
            for part, track in zip(parts, seen, strict=True)
        ]
        by_object = self._number(objects, numbers, votes)
        by_part = [(flows[k], len(parts[k].own)) for k in moving]
        along = self._slowest([p for k, p in enumerate(parts) if k not in flows], still_model, window)
        found = Objects(
            *_paint(labels, crumbs, parts, objects, by_object, still_model, moving), by_part, along
        )
        for k, part in enumerate(parts):
            if part is not background:
                velocity = window.displacement(part.model, *part.centre) / window.duration
                strength = min(max(float(evidence[k]), -_SURE), _SURE)
                few = part.own[:: 1 + len(part.own) // _PLACES] if numbers[k] else part.own[:0]
                places = warp_some(events, few, part.model, t_ref, camera=self._camera)
                self._remember(
                    _Track(numbers[k], boxes[k], velocity, t_ref, strength, part.model, places), seen[k]
                )
        self._tracks = [track for track in self._tracks if t_ref - track.seen <= MEMORY_US]
        return found

    def _expected(self, events: EventArray, t_ref: int) -> list[tuple[_Track, npt.NDArray[np.bool_]]]:
        """The tracks of objects seen of late, and the tiles in which their events should be now."""
        shape = np.array([-(-events.height // TILE), -(-events.width // TILE)])
        expected = []
        for track in self._tracks:
            age = t_ref - track.seen
            if not (track.number and track.evidence > 0 and len(track.places) and age < _LATE_US):
                continue
            at = ((track.places + track.velocity * (age * 1e-6)) // TILE).astype(np.intp)[:, ::-1]
            tiles = np.zeros(shape, bool)
            tiles[tuple(at[((at >= 0) & (at < shape)).all(axis=1)].T)] = True
            expected.append((track, tiles))
        return expected

    def _evidence_before(
        self,
        part: Part,
        box: Box,
        track: _Track | None,
        window: Window,
        background: MotionModel,
        expected: Sequence[tuple[_Track, npt.NDArray[np.bool_]]],
        t_ref: int,
    ) -> float:
        """That a part moves, by its own track, or else by that of an object where it lies and goes alike."""
        if track:
            return _MEMORY * track.evidence + _went(track, box, window, background, t_ref)
        best = 0.0
        own, still = (window.displacement(m, *part.centre) for m in (part.model, background))
        for other, tiles in expected:
            way = other.velocity * window.duration
            if np.linalg.norm(own - way) <= 0.5 * np.linalg.norm(still - way):
                best = max(best, other.evidence * part.share_in(tiles))
        return _MEMORY * best

    def motions(self) -> list[TrackedMotion]:
        """Last known motions of the objects that are remembered, each once, and where it was seen."""
        known: dict[tuple[str, int], list[_Track]] = {}
        for track in self._tracks:
            if track.number and track.evidence > 0:
                known.setdefault((str(track.model.native()), track.seen), []).append(track)
        return [
            TrackedMotion(tracks[0].model, np.concatenate([track.places for track in tracks]), seen)
            for (_, seen), tracks in known.items()
        ]

    def split(
        self, events: EventArray, labels: npt.NDArray[np.int32], models: Sequence[MotionModel], t_ref: int
    ) -> tuple[list[tuple[npt.NDArray[np.intp], MotionModel]], list[npt.NDArray[np.intp]]]:
        """Indices of the events and motion of every part, and of crumbs: chance meetings of motions."""
        groups, crumbs = [], []
        for own, model in zip(_core.positions_of_values(labels, len(models)), models, strict=True):
            if not len(own):
                continue
            if model.label == 0:
                groups.append((own, model))
                continue
            places = warp_some(events, own, model, t_ref, camera=self._camera)
            part = _core.split_apart(places, self._gap)
            crumbs.append(own[part < 0])
            together = _core.positions_of_values(part, int(part.max()) + 1)
            groups += [(own[members], model) for members in together]
        groups.sort(key=lambda group: (group[1].label != 0, -len(group[0]), int(group[0][0])))
        return groups, crumbs

    def _match(self, boxes: list[Box], excepted: list[bool], t_ref: int) -> list[_Track | None]:
        """The track of each box: one whose predicted box overlaps, each once."""
        seen: list[_Track | None] = [None] * len(boxes)
        rows = [k for k, left_out in enumerate(excepted) if not left_out]
        if rows and self._tracks:
            predicted = [track.predicted(t_ref) for track in self._tracks]
            gain = np.array([[_overlap(boxes[k], box) for box in predicted] for k in rows])
            for i, j in best_pairs(gain):
                if gain[i, j] > 0.1:
                    seen[rows[i]] = self._tracks[j]
        return seen

    def _slowest(
        self, still: Sequence[Part], background: MotionModel, window: Window
    ) -> npt.NDArray[np.float64]:
        """Displacement of the slowest of the larger parts that stand still: false motions are fast."""
        least = 0.1 * sum(len(part.own) for part in still)
        flows = [window.displacement(p.model, *p.centre) for p in still if len(p.own) >= least]
        if not flows:
            return window.displacement(background, window.events.width / 2, window.events.height / 2)
        return min(flows, key=lambda flow: float(np.linalg.norm(flow)))

    def _flow(self, part: Part, background: MotionModel, window: Window) -> npt.NDArray[np.float64]:
        """Displacement of a part against the background, px."""
        own, still = (window.displacement(m, *part.centre) for m in (part.model, background))
        return own - still

    def _join(
        self, parts: Sequence[Part], moving: list[int], flows: dict[int, npt.NDArray[np.float64]]
    ) -> list[list[int]]:
        """Moving parts that touch and go the same way: limbs of one body, largest part first."""
        objects: list[list[int]] = []
        for k in sorted(moving, key=lambda k: -len(parts[k].own)):
            home = next(
                (o for o in objects if any(_one_body(parts[k], flows[k], parts[m], flows[m]) for m in o)),
                None,
            )
            if home is None:
                objects.append([k])
            else:
                home.append(k)
        return objects

    def _number(self, objects: list[list[int]], numbers: list[int], weights: list[float]) -> list[int]:
        """A number for every object: that most weight of its parts had, else a new one; its parts get it."""
        by_object = []
        taken: set[int] = set()
        for own in objects:
            votes: dict[int, float] = {}
            for k in own:
                if numbers[k] and numbers[k] not in taken:
                    votes[numbers[k]] = votes.get(numbers[k], 0.0) + weights[k]
            if votes:
                number = max(votes, key=lambda candidate: (votes[candidate], -candidate))
            else:
                number = self._next_number
                self._next_number += 1
            taken.add(number)
            by_object.append(number)
            for k in own:
                numbers[k] = number
        return by_object

    def _remember(self, track: _Track, before: _Track | None) -> None:
        self._tracks = [known for known in self._tracks if known is not before] + [track]


def _went(track: _Track, box: Box, window: Window, background: MotionModel, t_ref: int) -> float:
    """Evidence that what was seen before has gone where its motion said, and not where the background went.

    An edge along the columns of pixels can look as if it moved along itself, fast; but it stays.
    """
    seconds = (t_ref - track.seen) * 1e-6
    x, y, w, h = track.box
    before = np.array([x + w / 2, y + h / 2])
    now = np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
    own = before + track.velocity * seconds
    stays = window.displacement(background, float(before[0]), float(before[1])) / window.duration
    still = before + stays * seconds
    apart = float(np.linalg.norm(own - still))
    if apart < _TOLD_APART:
        return 0.0
    missed, stayed = float(np.linalg.norm(now - own)), float(np.linalg.norm(now - still))
    return _WENT * float(np.log((stayed + 4) / (missed + 4)))


def _paint(
    labels: npt.NDArray[np.int32],
    crumbs: Sequence[npt.NDArray[np.intp]],
    parts: Sequence[Part],
    objects: Sequence[Sequence[int]],
    numbers: Sequence[int],
    background: MotionModel,
    moving: Sequence[int],
) -> tuple[npt.NDArray[np.int32], list[MotionModel], npt.NDArray[np.int32], list[MotionModel]]:
    """Labels and models of the objects of a window, and of their parts."""
    by_object = np.minimum(labels, 0)
    crumb_of_moving = {parts[k].model.label for k in moving}
    for crumb in crumbs:
        if len(crumb) and int(labels[crumb[0]]) in crumb_of_moving:
            by_object[crumb] = -1
    by_part = by_object.copy()
    models = [MotionModel(background.kind, background.params, 0)]
    part_models = models.copy()
    for own, number in zip(objects, numbers, strict=True):
        for k in own:
            by_object[parts[k].own] = number
            by_part[parts[k].own] = len(part_models)
            part_models.append(MotionModel(parts[k].model.kind, parts[k].model.params, len(part_models)))
        main = parts[own[0]].model
        models.append(MotionModel(main.kind, main.params, number))
    return by_object, models, by_part, part_models


def _one_body(a: Part, flow_a: npt.NDArray[np.float64], b: Part, flow_b: npt.NDArray[np.float64]) -> bool:
    """Whether two moving parts are limbs of one body: they touch and go the same way at like speeds."""
    if not a.touches(b):
        return False
    speeds = float(np.linalg.norm(flow_a)), float(np.linalg.norm(flow_b))
    slow, fast = min(speeds), max(speeds)
    return slow > 0.25 * fast and float(flow_a @ flow_b) > 0.6 * slow * fast


def _no_loss(*_: object, **__: object) -> list[float]:
    raise AssertionError("without a loss, nothing is held against the background")
