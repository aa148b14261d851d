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
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.events import EventArray
from emseg.layers import SURELY_STILL, layer_doubt
from emseg.motion import MotionModel
from emseg.parts import TILE, Features, Part, Window
from emseg.still_scene import agreed_motion, sight, still_motion

__all__ = [
    "MIN_EVENTS",
    "STILL",
    "Perceptron",
    "ambiguity",
    "appearance",
    "choose_background",
    "firmness",
    "motion_against",
    "moving_logits",
    "parallax_doubt",
]

MIN_EVENTS: Final = 30
"""Of a part: what is smaller is not learnt from."""

_AVOID: Final = 0.7  # how much less likely a part of ambiguous motion is taken for the background
_STILL_PX: Final = 1.0  # over the window: what moves less lies still in the image
_FIRM: Final = 0.05  # nats an event that what lies still loses by moving a little
_SLOW: Final = 4.0  # px over the window that an object seen from a moving camera goes against the scene
_SLOW_DOUBT: Final = 2.0  # logit of a part for every px below that
_DOUBT: Final = 8.0  # logit of a part that has not gone at all
_EXPECTED: Final = 4.0  # logit of a part that lies where moving objects are expected

STILL: Final = MotionModel("translation", (0.0, 0.0))

_LARGE: Final = 0.03  # share of the view that a background fills at least
_BORDER: Final = 6  # px
_NEAR, _FAR = 2.0, 4.0  # px over the window that parallax may add
_RING: Final = [(0.0, 0.0)] + [
    (radius * float(np.cos(angle)), radius * float(np.sin(angle)))
    for radius in (_NEAR, _FAR)
    for angle in np.arange(8) * np.pi / 4
]
_FAR_RING: Final = 9  # where the ring at _FAR begins


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
    density = len(part.own) / max(1.0, float(part.tiles.sum()) * TILE**2)
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
    still = _stillness(logits)
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


def moving_logits(
    parts: Sequence[Part], window: Window, expected: npt.NDArray[np.bool_] | None = None
) -> tuple[Features, Part | None, MotionModel]:
    """How likely each part is to move by itself, as logits; the part taken for the background; its motion.

    The camera comes first: what surely stands still by one part's motion gives the motion of all, against
    which every part is held again.

    Args:
        parts: Of the window.
        window: What they are parts of.
        expected: Tiles in which objects that moved before should be now: not the background's.
    """
    if not parts:
        return np.empty(0), None, STILL
    by_appearance, by_part, by_scene = _classifiers()
    own = np.array([appearance(part, window) for part in parts])
    firm = np.array([firmness(part, window) for part in parts])
    taken = _EXPECTED * np.array([0.0 if expected is None else part.share_in(expected) for part in parts])
    areas = [part.area for part in parts]
    logits = by_appearance(own) + taken
    chosen = choose_background(areas, own, logits, firm)
    if chosen is None:
        against = np.array([motion_against(part, None, window) for part in parts])
        return by_part(np.hstack([own, against])), None, STILL
    background = parts[chosen]
    sights = [sight(part, window) for part in parts]
    agreed = agreed_motion(parts, chosen, window, sights, np.array(areas) * firm * _stillness(logits))
    against = np.array([motion_against(part, background, window, agreed) for part in parts])
    logits = by_part(np.hstack([own, against])) - _doubt(own) + taken
    still = [k for k, logit in enumerate(logits) if logit < SURELY_STILL or k == chosen]
    clear = [sights[k] for k in still]
    reference = still_motion([parts[k] for k in still], window, ambiguity(own[still]), firm[still], clear)
    against = np.array([motion_against(part, background, window, reference) for part in parts])
    logits = by_scene(np.hstack([own, against])) - _doubt(own) - parallax_doubt(against)
    logits -= layer_doubt(parts, window, chosen, firm * (1 - ambiguity(own)), logits)
    return logits, background, reference


def _stillness(logits: Features) -> Features:
    still: Features = 1 / (1 + np.exp(np.clip(logits, -50, 50)))
    return still


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
