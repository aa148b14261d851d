"""Pictures of depth, flow and masks: pure functions of NumPy arrays to uint8 RGB (h, w, 3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from emseg.render import Picture, iwe_picture, side_by_side, track_colour

__all__ = [
    "Wheel",
    "captioned",
    "depth_picture",
    "flow_picture",
    "mask_picture",
    "row",
    "slice_picture",
    "wheel_picture",
]

Wheel = Literal["thesis", "middlebury"]

# By the angle, counted from the right to up; the thesis' table.
_THESIS_ANCHORS: Final = np.array(
    [
        (255, 0, 0),  # right: red
        (255, 0, 255),  # upper right: magenta
        (0, 255, 0),  # up: green
        (128, 0, 128),  # upper left: purple
        (0, 0, 255),  # left: blue
        (255, 255, 0),  # lower left: yellow
        (0, 255, 255),  # down: cyan
        (255, 165, 0),  # lower right: orange
    ],
    np.float64,
)

# How many steps the Middlebury wheel takes from a pure colour to the next (Baker et al., "A database and
# evaluation methodology for optical flow", IJCV 2011): red, yellow, green, cyan, blue, magenta.
_MIDDLEBURY_STEPS: Final = ((15, (255, 0, 0)), (6, (255, 255, 0)), (4, (0, 255, 0)), (11, (0, 255, 255)),
                            (13, (0, 0, 255)), (6, (255, 0, 255)))  # fmt: skip

_UNKNOWN: Final = (40, 40, 44)
_GREY: Final = 118


def depth_picture(
    depth: NDArray[Any], *, nearest: float | None = None, farthest: float | None = None
) -> Picture:
    """Depth (h, w) in greys of its inverse: near bright, far dark; what is not known (0) has a tint.

    Args:
        depth: Any unit.
        nearest, farthest: What is white and black; None: the 2nd and 98th percentile.
    """
    known = np.isfinite(depth) & (depth > 0)
    inverse = np.divide(1.0, depth, out=np.zeros(depth.shape), where=known)
    low, high = np.percentile(inverse[known], (2, 98)) if known.any() else (0.0, 1.0)
    low = low if farthest is None else 1 / farthest
    high = high if nearest is None else 1 / nearest
    grey = np.clip((inverse - low) / max(high - low, 1e-12), 0, 1)
    picture = np.repeat(np.rint(255 * grey).astype(np.uint8)[..., None], 3, axis=2)
    picture[~known] = _UNKNOWN
    return picture


def _wheel_colours(angle: NDArray[np.float64], wheel: Wheel) -> NDArray[np.float64]:
    """Colours 0 .. 255 of directions, rad from the right to up."""
    turn = np.mod(angle / (2 * np.pi), 1)
    if wheel == "thesis":
        anchors = _THESIS_ANCHORS
    else:
        steps = [
            np.array(colour) + (np.array(following) - np.array(colour)) * k / count
            for (count, colour), (_, following) in zip(
                _MIDDLEBURY_STEPS, (*_MIDDLEBURY_STEPS[1:], _MIDDLEBURY_STEPS[0]), strict=True
            )
            for k in range(count)
        ]
        # Its hues begin on the right and run on downwards.
        anchors = np.array(steps)
        turn = np.mod(-turn, 1)
    place = turn * len(anchors)
    before = np.floor(place).astype(np.int64)
    share = (place - before)[..., None]
    count = len(anchors)
    colours: NDArray[np.float64] = (1 - share) * anchors[before % count] + share * anchors[
        (before + 1) % count
    ]
    return colours


def flow_picture(flow: NDArray[Any], *, wheel: Wheel = "thesis", most: float | None = None) -> Picture:
    """Flow (2, h, w), px to the right and down: colour by direction, brightness by magnitude.

    Args:
        flow: NaN: not known.
        wheel: thesis: no motion is black; middlebury: no motion is white.
        most: Magnitude of the full colour; None: the 98th percentile.
    """
    known = np.isfinite(flow).all(axis=0)
    u, v = np.where(known, flow, 0.0)
    size = np.hypot(u, v)
    if most is None:
        most = float(np.percentile(size[known], 98)) if known.any() else 1.0
    share = np.clip(size / max(most, 1e-9), 0, 1)[..., None]
    full = _wheel_colours(np.arctan2(-v, u), wheel)
    colours = share * full if wheel == "thesis" else 255 - share * (255 - full)
    picture: Picture = np.rint(colours).astype(np.uint8)
    picture[~known] = _UNKNOWN
    return picture


def wheel_picture(wheel: Wheel, *, side: int = 129) -> Picture:
    """The colours of all directions, out to a magnitude of 1 at the rim."""
    axis = np.linspace(-1, 1, side)
    flow = np.stack(np.meshgrid(axis, axis))
    flow[:, np.hypot(*flow) > 1] = np.nan
    return flow_picture(flow, wheel=wheel, most=1.0)


def mask_picture(labels: NDArray[Any], active: NDArray[np.bool_] | None = None) -> Picture:
    """Labels (h, w): 0 grey, 1.. coloured as tracks are, -1 dark; at active pixels alone if given."""
    picture = np.full((*labels.shape, 3), 16, np.uint8)
    seen = np.ones(labels.shape, bool) if active is None else active
    picture[seen & (labels == 0)] = _GREY
    for label in np.unique(labels[labels > 0]).tolist():
        picture[seen & (labels == label)] = track_colour(label)
    return picture


def slice_picture(images: NDArray[Any]) -> Picture:
    """An event slice (3, h, w), bytes: rises red, mean time green, falls blue; (1, h, w): counts in greys."""
    planes = np.moveaxis(np.asarray(images, np.uint8), 0, -1)
    return planes if planes.shape[2] == 3 else np.repeat(planes, 3, axis=2)


def captioned(picture: Picture, caption: str, *, scale: int = 2) -> Picture:
    """The picture enlarged by a whole factor, with a line of text under it."""
    strip = iwe_picture(np.zeros((1, picture.shape[1]), np.float32), caption=caption, scale=scale)[scale:]
    large = picture.repeat(scale, axis=0).repeat(scale, axis=1)
    return np.concatenate([large, strip])


def row(pictures: Sequence[Picture]) -> Picture:
    """Pictures beside each other."""
    joined = pictures[0]
    for picture in pictures[1:]:
        joined = side_by_side(joined, picture)
    return joined
