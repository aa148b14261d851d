"""Which parts of a window may be layers of the still scene, by one rigid motion of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from emseg.motion import undistorted
from emseg.parts import TILE, Features, Part, Window
from emseg.rigid_motion import doubt_of_layers, fit_rigid_motion, layers_of

__all__ = ["SURELY_STILL", "layer_doubt"]

SURELY_STILL: Final = -1.0
"""Logit below which a part gives the motion of the still scene."""

_EVENTS: Final = 100  # of a part whose flow says something of the camera's motion
_AREA: Final = 0.015  # share of the view from which on a part is a layer of its own
_MOST: Final = 12  # parts that the camera's motion is taken from
_STRANGE: Final = 2.5  # standard deviations that no motion of the camera explains
_COMPANY: Final = 2.0  # how much the area of what is strange counts against that of what it touches


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
    known = [k for k, part in enumerate(parts) if len(part.own) >= _EVENTS and firm[k] > 0.1]
    used = sorted(known, key=lambda k: -parts[k].area)[:_MOST]
    areas = np.array([parts[k].area for k in used])
    clear = (areas >= _AREA) & (firm[used] > 0.3)
    if clear.sum() < 3 or background not in used or np.delete(logits, background).max() < SURELY_STILL:
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
    return (np.column_stack([x[some], y[some]]).astype(np.float64) + 0.5) * TILE
