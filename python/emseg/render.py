"""Pictures of events, labels and images of warped events: pure functions to uint8 RGB arrays (h, w, 3).

Objects are coloured by track from a palette that colour-blind readers can tell apart (Okabe & Ito 2008), the
background is grey and noise is faint.  Small sensors are enlarged by whole factors.
"""

from __future__ import annotations

from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray
from emseg.glyphs import GLYPH_HEIGHT, text_mask

__all__ = [
    "BOX_DTYPE",
    "Picture",
    "fitting_scale",
    "iwe_picture",
    "label_picture",
    "motion_picture",
    "polarity_picture",
    "side_by_side",
    "track_colour",
]

Picture = npt.NDArray[np.uint8]
"""RGB, (h, w, 3)."""

BOX_DTYPE: Final = np.dtype([("track", "i4"), ("x", "f4"), ("y", "f4"), ("w", "f4"), ("h", "f4")])
"""A box: its track, its left upper corner and its size, px."""

_PALETTE: Final = np.array(
    [
        (230, 159, 0),  # orange
        (86, 180, 233),  # sky blue
        (0, 158, 115),  # bluish green
        (240, 228, 66),  # yellow
        (204, 121, 167),  # reddish purple
        (213, 94, 0),  # vermilion
        (60, 130, 220),  # blue, lighter than theirs, to stand out from a dark ground
    ],
    np.uint8,
)
_GROUND: Final = (16, 16, 18)
_BACKGROUND_EVENT: Final = (118, 118, 122)
_BACKGROUND_INK: Final = (165, 165, 170)  # lighter, since most of an image of warped events is faint
_NOISE_EVENT: Final = (52, 52, 56)
_RISE: Final = (236, 236, 230)
_FALL: Final = (74, 128, 196)
_INK: Final = (225, 225, 225)
_STRIP: Final = (34, 34, 38)

_LONGER_SIDE: Final = 960  # px that a picture should have at least
_GAP: Final = 8  # px between pictures side by side


class SegmentedWindow(Protocol):
    """What pictures need of a segmentation."""

    @property
    def models(self) -> list[Any]:
        """A model per label, with its `label`."""

    def iwe(self, label: int | None = None) -> npt.NDArray[np.float32]:
        """Image of the warped events of one label, or of all, (h, w)."""


def track_colour(track: int) -> tuple[int, int, int]:
    """The colour of a track (1, 2, …): always the same, and recurring after seven."""
    red, green, blue = _PALETTE[(track - 1) % len(_PALETTE)]
    return int(red), int(green), int(blue)


def fitting_scale(width: int, height: int, *, longer_side: int = _LONGER_SIDE) -> int:
    """The least whole factor that brings the longer side to `longer_side` px."""
    return max(1, -(-longer_side // max(width, height)))


def polarity_picture(events: EventArray, *, caption: str = "", scale: int | None = None) -> Picture:
    """Events by polarity: rises light, falls blue; the latest event of a pixel is seen.

    Args:
        events: The events to show.
        caption: Line of text under the picture; none if empty.
        scale: Whole factor of enlargement; None for one that brings the longer side to 960 px.
    """
    picture = _blank(events.width, events.height)
    picture[events.y, events.x] = np.array([_FALL, _RISE], np.uint8)[events.p]
    return _finish(picture, scale, caption)


def label_picture(
    events: EventArray,
    labels: npt.ArrayLike,
    *,
    boxes: npt.NDArray[Any] | None = None,
    caption: str = "",
    scale: int | None = None,
) -> Picture:
    """Events by label: 0 grey, 1 and more coloured by track, -1 faint; with boxes and the tracks' numbers.

    Args:
        events: The events to show.
        labels: Label of each event, (n,).
        boxes: Boxes to draw, structured array of :data:`BOX_DTYPE`, px of the sensor.
        caption: Line of text under the picture; none if empty.
        scale: Whole factor of enlargement; None for one that brings the longer side to 960 px.
    """
    labels = np.asarray(labels)
    if labels.shape != (len(events),):
        raise ValueError(f"labels have shape {labels.shape}, expected ({len(events)},): one an event")
    picture = _blank(events.width, events.height)
    for chosen, colour in ((labels < 0, _NOISE_EVENT), (labels == 0, _BACKGROUND_EVENT)):
        picture[events.y[chosen], events.x[chosen]] = colour
    moving = labels > 0
    picture[events.y[moving], events.x[moving]] = _PALETTE[(labels[moving] - 1) % len(_PALETTE)]
    scale = fitting_scale(events.width, events.height) if scale is None else scale
    picture = _enlarged(picture, scale)
    for box in () if boxes is None else boxes:
        _draw_box(picture, box, scale)
    return _captioned(picture, caption)


def iwe_picture(iwe: npt.ArrayLike, *, caption: str = "", scale: int | None = None) -> Picture:
    """An image of warped events in greys; all-zero images are dark.

    Args:
        iwe: Image of warped events, (h, w), never negative.
        caption: Line of text under the picture; none if empty.
        scale: Whole factor of enlargement; None for one that brings the longer side to 960 px.
    """
    grey = _tone(np.asarray(iwe, dtype=np.float32))
    return _finish(_ground_to(grey[..., None], np.array(_INK, np.float32)), scale, caption)


def motion_picture(window: SegmentedWindow, *, caption: str = "", scale: int | None = None) -> Picture:
    """Every label's events moved to the reference time by its own motion, in its own colour: sharp is right.

    Args:
        window: A segmentation.
        caption: Line of text under the picture; none if empty.
        scale: Whole factor of enlargement; None for one that brings the longer side to 960 px.
    """
    images = {int(model.label): np.asarray(window.iwe(int(model.label))) for model in window.models}
    if not images:
        return iwe_picture(window.iwe(), caption=caption, scale=scale)
    # One tone for all labels, so that brightness compares.
    tones = dict(zip(images, _tone(np.stack(list(images.values()))), strict=True))
    ink = np.zeros((*next(iter(images.values())).shape, 3), np.float32)
    for label, tone in tones.items():
        colour = track_colour(label) if label > 0 else _BACKGROUND_INK if label == 0 else _NOISE_EVENT
        ink = np.maximum(ink, tone[..., None] * np.array(colour, np.float32))
    return _finish(np.maximum(ink, np.array(_GROUND)).astype(np.uint8), scale, caption)


def side_by_side(left: Picture, right: Picture) -> Picture:
    """Two pictures beside each other, with a gap; the lower one is filled up below."""
    height = max(left.shape[0], right.shape[0])
    joined = np.full((height, left.shape[1] + _GAP + right.shape[1], 3), _STRIP, np.uint8)
    joined[: left.shape[0], : left.shape[1]] = left
    joined[: right.shape[0], left.shape[1] + _GAP :] = right
    return joined


def _blank(width: int, height: int) -> Picture:
    return np.full((height, width, 3), _GROUND, np.uint8)


def _tone(images: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Values to 0..1: the square root, cut at the brightest thousandth, shows faint edges too."""
    lit = images[images > 0]
    top = float(np.quantile(lit, 0.999)) if lit.size else 1.0
    tone: npt.NDArray[np.float32] = np.sqrt(np.clip(images / top, 0.0, 1.0), dtype=np.float32)
    return tone


def _ground_to(share: npt.NDArray[np.float32], colour: npt.NDArray[np.float32]) -> Picture:
    ground = np.array(_GROUND, np.float32)
    return (ground + share * (colour - ground)).astype(np.uint8)


def _enlarged(picture: Picture, scale: int) -> Picture:
    if scale < 1:
        raise ValueError(f"scale is {scale}, expected 1 or more")
    return picture.repeat(scale, axis=0).repeat(scale, axis=1)


def _finish(picture: Picture, scale: int | None, caption: str) -> Picture:
    height, width = picture.shape[:2]
    return _captioned(_enlarged(picture, fitting_scale(width, height) if scale is None else scale), caption)


def _text_scale(picture: Picture) -> int:
    height, width = picture.shape[:2]
    return max(1, round(int(max(height, width)) / 480))


def _captioned(picture: Picture, caption: str) -> Picture:
    if not caption:
        return picture
    scale = _text_scale(picture)
    strip = np.full(((GLYPH_HEIGHT + 8) * scale, picture.shape[1], 3), _STRIP, np.uint8)
    _draw_text(strip, caption, left=4 * scale, top=4 * scale, scale=scale, colour=_INK)
    return np.concatenate([picture, strip])


def _draw_text(
    picture: Picture, text: str, *, left: int, top: int, scale: int, colour: tuple[int, int, int]
) -> None:
    """Ink a line of text in place, cut where it leaves the picture."""
    mask = text_mask(text, scale)
    area = picture[top : top + mask.shape[0], left : left + mask.shape[1]]
    area[mask[: area.shape[0], : area.shape[1]]] = colour


def _draw_box(picture: Picture, box: Any, scale: int) -> None:
    """Outline a box in place, with its track's number on a tag at its upper edge."""
    height, width = picture.shape[:2]
    left, top, right, bottom = (
        int(np.clip(round(float(edge) * scale), 0, limit - 1))
        for edge, limit in (
            (box["x"], width),
            (box["y"], height),
            (box["x"] + box["w"], width),
            (box["y"] + box["h"], height),
        )
    )
    colour = track_colour(int(box["track"]))
    line = max(1, scale // 2)
    for rows, columns in (
        (slice(top, top + line), slice(left, right + 1)),
        (slice(max(0, bottom + 1 - line), bottom + 1), slice(left, right + 1)),
        (slice(top, bottom + 1), slice(left, left + line)),
        (slice(top, bottom + 1), slice(max(0, right + 1 - line), right + 1)),
    ):
        picture[rows, columns] = colour
    text_scale = _text_scale(picture)
    number = str(int(box["track"]))
    mask = text_mask(number, text_scale)
    tag_height, tag_width = mask.shape[0] + 2 * text_scale, mask.shape[1] + 2 * text_scale
    tag_top = top - tag_height if top >= tag_height else top
    tag_left = min(left, max(0, width - tag_width))
    picture[tag_top : tag_top + tag_height, tag_left : tag_left + tag_width] = colour
    _draw_text(
        picture,
        number,
        left=tag_left + text_scale,
        top=tag_top + text_scale,
        scale=text_scale,
        colour=_GROUND,
    )
