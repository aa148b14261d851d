"""The image motion of the still scene, from the motions of the parts that stand still.

The motion of a straight edge is seen across the edge only.  What such parts say along their edges is chance,
and counts for as little; what other parts say takes its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from emseg.motion import MotionModel
from emseg.parts import TILE, Features, Part, Window

__all__ = ["agreed_motion", "sight", "still_motion"]

_ROUND: Final = 0.3  # ratio of a structure tensor's eigenvalues from which on a part is seen to move any way
_ALIKE: Final = 2.0  # px over the window, that motions of one scene differ by
_SELF: Final = 0.01  # what a part's own word counts for at least
_FAR: Final = 15.0  # px over the window, by which an edge's own motion along itself is wrong at times


def sight(part: Part, window: Window) -> Features:
    """How well a part's motion is seen in each direction, (2, 2): 1 across its edges, less along them.

    By the eigenvalues of the structure tensor of its tiles; all is seen of what holds no tile.
    """
    xx, xy, yy = window.structure[part.tiles].sum(axis=0)
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    if values[1] <= 0:
        return np.eye(2)
    along = min(1.0, max(0.0, float(values[0] / values[1])) / _ROUND)
    clear: Features = vectors @ np.diag([along, 1.0]) @ vectors.T
    return clear


def agreed_motion(
    parts: Sequence[Part], chosen: int, window: Window, sights: Sequence[Features], weights: Features
) -> MotionModel:
    """The motion of a part, the chosen one, but along its edges that on which most of the others agree.

    Args:
        parts: Of the window.
        chosen: The one whose motion it is.
        window: What they are parts of.
        sights: How well each is seen to move, (2, 2).
        weights: How much each says, (n,).
    """
    model = parts[chosen].model
    (seen, _), ((along_x, across_x), (along_y, across_y)) = np.linalg.eigh(sights[chosen])
    along, across = np.array([along_x, along_y]), np.array([across_x, across_y])
    if seen > 0.9 or model.kind == "rotation":
        return model
    shifts, votes = np.zeros(len(parts)), np.array(weights)
    votes[chosen] *= max(_SELF, float(seen))
    for k, part in enumerate(parts):
        if k != chosen:
            own = window.displacement(part.model, *part.centre)
            against = own - window.displacement(model, *part.centre)
            shifts[k] = against @ along
            votes[k] *= float(along @ sights[k] @ along) * _alike(against @ across)
    agreeing = _alike(shifts[:, None] - shifts) @ votes
    shift = float(shifts[int((agreeing * np.exp(-np.abs(shifts) / _FAR)).argmax())])
    if shift == 0:
        return model
    # The first two parameters of all but rotations are a velocity.
    x, y, *others = model.params
    vx, vy = shift * along / window.duration
    return MotionModel(model.kind, (x + float(vx), y + float(vy), *others), model.label)


def _alike(apart: Features) -> Features:
    """Of velocities `apart` px over the window, 0 to 1."""
    alike: Features = np.exp(-(apart**2) / (2 * _ALIKE**2))
    return alike


def still_motion(
    parts: Sequence[Part],
    window: Window,
    ambiguous: Sequence[float] | Features,
    firm: Sequence[float] | Features,
    sights: Sequence[Features],
) -> MotionModel:
    """One planar motion for all of several parts that stand still, each weighing by its area and firmness.

    A camera before a plane, or one that only turns, sees a flow of eight parameters, second order in the
    image's coordinates.  They are fitted to the displacements of the parts at their tiles by least squares
    with Cauchy weights.  Of a part whose motion is `ambiguous` (0 to 1), what lies along that motion counts
    less, and of all parts what lies along their edges, by their `sights`.
    """
    events = window.events
    places, flows, weights, ways = [], [], [], []
    for part, doubt, trust, clear in zip(parts, ambiguous, firm, sights, strict=True):
        y, x = np.nonzero(part.tiles)
        at: Features = (np.column_stack([x, y]).astype(np.float64) + 0.5) * TILE
        at = at[:: max(1, len(at) // 12)] if len(at) else np.array([part.centre])
        places.append(at)
        flows.append(window.displacements(part.model, at))
        way = window.displacement(part.model, *part.centre)
        way = way / max(1e-6, float(np.linalg.norm(way)))
        certain = (0.01 * np.eye(2) + 0.99 * clear) @ (np.eye(2) - 0.99 * doubt * np.outer(way, way))
        ways.append(np.tile(certain, (len(at), 1, 1)))
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
