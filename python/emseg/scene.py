"""What of a window is the still scene and what moves.

A still scene at several depths moves at several speeds in the image, an object may make most of the events,
and a straight edge leaves its motion along itself open.  No single number tells them apart, but together a
few do: how much of the view a part spans, whether it reaches the sensor's border, and how many nats an event
of it loses when it is made to move as the rest of the scene does, or within a few pixels of that, as parallax
would have it.  A small network weighs them; what one rigid motion of the camera explains is doubted besides
(emseg.rigid_motion).  The network was trained on simulated scenes (scripts/train_scene.py),
none of which is a recording or a scene that emseg is measured on.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.camera import Camera
from emseg.events import EventArray
from emseg.motion import MotionModel, undistorted, warp_frame
from emseg.rigid_motion import doubt_of_layers, fit_rigid_motion, layers_of

__all__ = [
    "MIN_EVENTS",
    "LossFunction",
    "Part",
    "Perceptron",
    "ambiguity",
    "appearance",
    "choose_background",
    "find_parts",
    "firmness",
    "layer_doubt",
    "motion_against",
    "moving_logits",
    "parallax_doubt",
]

MIN_EVENTS: Final = 30
"""Of a part: what is smaller is not learnt from."""

_SURELY_STILL: Final = -1.0  # logit
_AVOID: Final = 0.7  # how much less likely a part of ambiguous motion is taken for the background
_STILL_PX: Final = 1.0  # over the window: what moves less lies still in the image
_FIRM: Final = 0.05  # nats an event that what lies still loses by moving a little
_SLOW: Final = 4.0  # px over the window that an object seen from a moving camera goes against the scene
_SLOW_DOUBT: Final = 2.0  # logit of a part for every px below that
_DOUBT: Final = 8.0  # logit of a part that has not gone at all
_LAYER_EVENTS: Final = 100  # of a part whose flow says something of the camera's motion
_LAYER_AREA: Final = 0.015  # share of the view from which on a part is a layer of its own
_MOST_LAYERS: Final = 12  # parts that the camera's motion is taken from
_STRANGE: Final = 2.5  # standard deviations that no motion of the camera explains
_COMPANY: Final = 2.0  # how much the area of what is strange counts against that of what it touches

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
_FAR_RING: Final = 9  # where the ring at _FAR begins

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
    winner = _core.winners_of_tiles(*columns, [own for own, _ in groups], *size, _TILE)
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


def still_motion(
    parts: Sequence[Part],
    window: Window,
    ambiguous: Sequence[float] | Features,
    firm: Sequence[float] | Features,
) -> MotionModel:
    """One planar motion for all of several parts that stand still, each weighing by its area and firmness.

    A camera before a plane, or one that only turns, sees a flow of eight parameters, second order in the
    image's coordinates.  They are fitted to the displacements of the parts at their tiles by least squares
    with Cauchy weights.  Of a part whose motion is `ambiguous` (0 to 1), what lies along that motion counts
    less.
    """
    events = window.events
    places, flows, weights, ways = [], [], [], []
    for part, doubt, trust in zip(parts, ambiguous, firm, strict=True):
        y, x = np.nonzero(part.tiles)
        at: npt.NDArray[np.float64] = (np.column_stack([x, y]).astype(np.float64) + 0.5) * _TILE
        at = at[:: max(1, len(at) // 12)] if len(at) else np.array([part.centre])
        places.append(at)
        flows.append(window.displacements(part.model, at))
        way = window.displacement(part.model, *part.centre)
        way = way / max(1e-6, float(np.linalg.norm(way)))
        ways.append(np.tile(np.eye(2) - 0.99 * doubt * np.outer(way, way), (len(at), 1, 1)))
        weights.append(np.full(len(at), trust * (part.area + 1e-3) / len(at)))
    flow, weight, way = np.concatenate(flows), np.concatenate(weights), np.concatenate(ways)
    r = np.concatenate(places) - [(events.width - 1) / 2, (events.height - 1) / 2]
    f0 = max(events.width, events.height)
    one, zero, (x, y) = np.ones(len(r)), np.zeros(len(r)), r.T
    terms = np.stack(
        [
            np.column_stack([one, zero, x, y, zero, zero, x * x / f0, x * y / f0]),
            np.column_stack([zero, one, zero, zero, x, y, x * y / f0, y * y / f0]),
        ],
        axis=1,
    )
    terms, flow = way @ terms, (way @ flow[..., None])[..., 0]  # (n, 2, 8) and (n, 2)
    # What few tiles leave open stays near no shear and no perspective.
    calm = np.diag([0.0, 0.0, *[0.05 * f0] * 6]) * 0.1
    robust = np.ones(len(r))
    for _ in range(4):
        scale = np.sqrt(weight / weight.sum() * robust)
        rows = np.concatenate([(terms * scale[:, None, None]).reshape(-1, 8), calm])
        values = np.concatenate([(flow * scale[:, None]).ravel(), np.zeros(8)])
        fitted = np.linalg.lstsq(rows, values, rcond=None)[0]
        error = np.linalg.norm(terms @ fitted - flow, axis=1)
        robust = 1 / (1 + (error / 2) ** 2)
    return MotionModel("homography", tuple(float(v) for v in fitted / window.duration))


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
    (still,) = window.loss(window.sample(part), part.model, STILL, _RING[:1])
    along = window.displacement(part.model, *part.centre)
    speed = math.hypot(*along)
    # An edge that nearly follows the columns of pixels looks as if it moved along itself, fast, but stays.
    went = _core.share_gone(events.x, events.y, events.t, part.own, *along)
    density = len(part.own) / max(1.0, float(part.tiles.sum()) * _TILE**2)
    across = min(2.0, float(np.abs(along).min()))
    beyond = _beyond(part, events, along) if speed > 5 else 0.0
    return np.array(
        [
            math.log(part.area + 0.002),
            _core.spread_of_tiles(part.tiles),
            w,
            h,
            sides,
            max(w, h) > 0.85,
            still,
            min(speed, 30.0) / 10,
            went,
            (1 - went) * min(speed, 30.0) / 10,
            math.log(density + 0.01),
            len(part.own) / len(events),
            across,
            (1 - went) * (2 - across) * min(speed, 20.0) / 10,
            beyond,
        ],
        dtype=np.float64,
    )


def _beyond(part: Part, events: EventArray, along: npt.NDArray[np.float64]) -> float:
    """Events of its own sign that a part meets beyond where it goes: an edge along itself meets its own."""
    columns, (ahead, down) = (events.x, events.y, events.t, events.p), along.tolist()
    return _core.events_beyond(*columns, part.own, ahead, down, events.width, events.height)


def motion_against(
    part: Part, background: Part | None, window: Window, reference: MotionModel | None = None
) -> Features:
    """What a part loses by moving as the background, or near it; None: the background stands still unseen.

    `reference` is the background's motion, that of the part taken for it unless given.
    """
    if reference is None:
        reference = STILL if background is None else background.model
    if reference is part.model:
        lost = [0.0] * len(_RING)
    else:
        lost = window.loss(window.sample(part), part.model, reference, _RING)
    own, other = (window.displacement(model, *part.centre) for model in (part.model, reference))
    apart, along = math.hypot(*(own - other)), math.hypot(*other)
    # A camera that moves sideways moves what is nearer further the same way.
    ahead, aside = 0.0, apart
    if along > 1:
        ahead = float((own - other) @ other) / along
        aside = math.sqrt(max(0.0, apart**2 - ahead**2))
    return np.array(
        [
            lost[0],
            min(lost[:9]),
            min(lost),
            min(apart, 30.0) / 10,
            min(along, 30.0) / 10,
            min(max(ahead, -20.0), 20.0) / 10,
            min(aside, 20.0) / 10,
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
def _classifiers() -> tuple[Perceptron, Perceptron, Perceptron]:
    """By appearance alone, with the motion against one part, and with that against all that stands still."""
    # importlib.resources would import for longer than a small window takes.
    path = os.path.join(os.path.dirname(__file__), "data", "scene_classifiers.json")
    with open(path, encoding="utf-8") as file:
        weights = json.load(file)
    return _perceptron(weights["appearance"]), _perceptron(weights["part"]), _perceptron(weights["scene"])


def _perceptron(weights: dict[str, Any]) -> Perceptron:
    level = float(weights.pop("level"))
    return Perceptron(**{name: np.array(v, dtype=np.float64) for name, v in weights.items()}, level=level)


def choose_background(areas: Sequence[float], own: Features, logits: Features, firm: Features) -> int | None:
    """Which part is largest, firmest, and surest to stand still by appearance; None where none is likely to.

    Args:
        areas: Of the parts.
        own: Their appearance, (n, features).
        logits: That they move, (n,).
        firm: How firmly they hold to their motions, (n,).
    """
    still = 1 / (1 + np.exp(np.clip(logits, -50, 50)))
    score = np.sqrt(areas) * still * (1 - _AVOID * ambiguity(own)) * firm
    score[(np.array(areas) < _LARGE) | (still < 0.25)] = 0
    return int(score.argmax()) if len(score) and score.max() > 0 else None


def ambiguity(own: Features) -> Features:
    """How far the motions of parts are doubtful, 0 to 1, (n,), by their appearance (n, features).

    A straight edge near a column or a row of pixels passes one pixel of it after the other.  That is sharp by
    a fast motion along the edge, whatever the true one: nothing goes anywhere by it.
    """
    speed, went, across = own[:, 7] * 10, own[:, 8], own[:, 12]
    sure = [np.clip((0.6 - went) / 0.3, 0, 1), np.clip((speed - 5) / 5, 0, 1), np.clip(1.5 - across, 0, 1)]
    doubt: Features = np.prod(sure, axis=0)
    return doubt


def firmness(part: Part, window: Window) -> float:
    """How firmly the events of a part hold to its motion, 0.01 to 1; 1 for all that moves in the image.

    Noise and flicker lie where they lie: standing still explains them, but no better than moving some pixels
    would.  What gathers them says nothing of the camera's motion.
    """
    if float(np.linalg.norm(window.displacement(part.model, *part.centre))) >= _STILL_PX:
        return 1.0
    lost = window.loss(window.sample(part), part.model, part.model, _RING[_FAR_RING:])
    return min(1.0, max(0.1, float(np.mean(lost)) / _FIRM)) ** 2


def moving_logits(parts: Sequence[Part], window: Window) -> tuple[Features, Part | None, MotionModel]:
    """How likely each part is to move by itself, as logits; the part taken for the background; its motion.

    The camera comes first: what surely stands still by one part's motion gives the motion of all, against
    which every part is held again.
    """
    if not parts:
        return np.empty(0), None, STILL
    by_appearance, by_part, by_scene = _classifiers()
    own = np.array([appearance(part, window) for part in parts])
    firm = np.array([firmness(part, window) for part in parts])
    chosen = choose_background([part.area for part in parts], own, by_appearance(own), firm)
    if chosen is None:
        against = np.array([motion_against(part, None, window) for part in parts])
        return by_part(np.hstack([own, against])), None, STILL
    background = parts[chosen]
    against = np.array([motion_against(part, background, window) for part in parts])
    logits = by_part(np.hstack([own, against])) - _doubt(own)
    still = [k for k, logit in enumerate(logits) if logit < _SURELY_STILL or k == chosen]
    reference = still_motion([parts[k] for k in still], window, ambiguity(own[still]), firm[still])
    against = np.array([motion_against(part, background, window, reference) for part in parts])
    logits = by_scene(np.hstack([own, against])) - _doubt(own) - parallax_doubt(against)
    logits -= layer_doubt(parts, window, chosen, firm * (1 - ambiguity(own)), logits)
    return logits, background, reference


def layer_doubt(
    parts: Sequence[Part], window: Window, background: int, firm: Features, logits: Features
) -> Features:
    """Of parts that one rigid motion of the camera explains together with other layers of the still scene.

    Args:
        parts: Of the window.
        window: What they are parts of.
        background: Which of them surely stands still.
        firm: How firmly they hold to their motions, 0 where these are ambiguous, (n,).
        logits: That they move, without this doubt, (n,).
    """
    doubt = np.zeros(len(parts))
    known = [k for k, part in enumerate(parts) if len(part.own) >= _LAYER_EVENTS and firm[k] > 0.1]
    used = sorted(known, key=lambda k: -parts[k].area)[:_MOST_LAYERS]
    areas = np.array([parts[k].area for k in used])
    clear = (areas >= _LAYER_AREA) & (firm[used] > 0.3)
    if clear.sum() < 3 or background not in used or np.delete(logits, background).max() < _SURELY_STILL:
        return doubt
    places: Features = np.stack([_some_places(parts[k]) for k in used])
    flows = np.stack([window.displacements(parts[k].model, at) for k, at in zip(used, places, strict=True)])
    if len(layers_of(np.hypot(*flows.mean(axis=1).T))) < 3:
        return doubt
    events, camera = window.events, window.camera
    if camera is None:
        middle = ((events.width - 1) / 2, (events.height - 1) / 2)
        focal_length = float(max(events.width, events.height))
    else:
        places = undistorted(places.reshape(-1, 2), events, camera).reshape(places.shape)
        middle, focal_length = (camera.cx, camera.cy), (camera.fx + camera.fy) / 2
    motion = fit_rigid_motion(places - middle, flows, np.sqrt(areas + 1e-3) * firm[used], focal_length)
    doubt[used] = doubt_of_layers(motion, areas, clear=clear, background=used.index(background))
    # Limbs of a body that partly moves as the camera would have it belong with the others.
    strange = [
        parts[k] for k, error in zip(used, motion.errors, strict=True) if error > _STRANGE and logits[k] > 0
    ]
    for k in used:
        company = sum(part.area for part in strange if part is not parts[k] and part.touches(parts[k]))
        doubt[k] *= parts[k].area / (parts[k].area + _COMPANY * company + 1e-9)
    return doubt


def _some_places(part: Part) -> Features:
    """Places (3, 2) in a part, px: of its tiles from the top to the bottom, or its middle."""
    y, x = np.nonzero(part.tiles)
    if not len(x):
        return np.tile(part.centre, (3, 1))
    some = np.linspace(0, len(x) - 1, 3).astype(np.intp)
    return (np.column_stack([x[some], y[some]]).astype(np.float64) + 0.5) * _TILE


def parallax_doubt(against: Features) -> Features:
    """Of parts that hardly move against the still scene, while the camera moves: parallax does no less.

    Windows last until most objects have moved further.
    """
    apart, along = against[:, 3] * 10, against[:, 4] * 10
    doubt: Features = _SLOW_DOUBT * np.maximum(0.0, _SLOW - apart) * np.minimum(1.0, along)
    return doubt


def _doubt(own: Features) -> Features:
    """Of parts that did not go where their motions say: rarer in training than with pillars in the view."""
    speed, went = own[:, 7] * 10, own[:, 8]
    doubt: Features = _DOUBT * np.maximum(0.0, 0.4 - went) * np.minimum(1.0, speed / 12)
    return doubt
