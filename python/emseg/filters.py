"""Filters of events that pass through a recording chunk by chunk: noise, hot pixels, a part of the sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.events import EventArray

__all__ = ["Crop", "count_events", "crop_events", "drop_noise", "drop_pixels", "hot_pixels"]

NOISE_DURATION_US: Final = 10_000
"""How long before an event a neighbour must have fired for it to be no noise."""

HOT_RATIO: Final = 10.0
HOT_EVENTS: Final = 20


@dataclass(frozen=True)
class Crop:
    """A part of the sensor, px: its first column and row, and its size.

    Raises:
        ValueError: where it is empty or begins outside of any sensor.
    """

    x: int
    y: int
    width: int
    height: int

    def __post_init__(self) -> None:
        if min(self.x, self.y) < 0 or min(self.width, self.height) < 1:
            raise ValueError(
                f"crop is {self.width}x{self.height} at ({self.x}, {self.y}), "
                "expected a size of at least 1x1 at a place of at least (0, 0)"
            )

    def check_inside(self, width: int, height: int) -> None:
        """Refuse a part that is not wholly on a sensor of this size."""
        if self.x + self.width > width or self.y + self.height > height:
            raise ValueError(
                f"crop of {self.width}x{self.height} at ({self.x}, {self.y}) reaches beyond the sensor of "
                f"{width}x{height}"
            )


def crop_events(chunks: Iterable[EventArray], crop: Crop) -> Iterator[EventArray]:
    """The events on a part of the sensor, which becomes their sensor.

    Raises:
        ValueError: where the part is not wholly on the sensor.
    """
    for events in chunks:
        crop.check_inside(events.width, events.height)
        # As unsigned numbers, columns left of the part are large.
        x, y = events.x - np.uint16(crop.x), events.y - np.uint16(crop.y)
        inside = (x < crop.width) & (y < crop.height)
        if inside.any():
            yield EventArray(
                x[inside], y[inside], events.t[inside], events.p[inside], width=crop.width, height=crop.height
            )


def drop_noise(chunks: Iterable[EventArray], *, duration_us: int = NOISE_DURATION_US) -> Iterator[EventArray]:
    """The events with company: one at any of the eight neighbouring pixels not long before.

    After Delbruck, "Frame-free dynamic digital vision", 2008.

    Args:
        chunks: Events of one sensor, in order.
        duration_us: How long before, µs.
    """
    company: _core.BackgroundActivityFilter | None = None
    for events in chunks:
        if company is None:
            company = _core.BackgroundActivityFilter(events.width, events.height, duration_us)
        kept = company.keep(events.x, events.y, events.t, events.p).astype(bool)
        if kept.any():
            yield events[kept]


def count_events(chunks: Iterable[EventArray]) -> npt.NDArray[np.int64]:
    """Events of each pixel, (height, width); (0, 0) where there are none."""
    counts = np.zeros((0, 0), np.int64)
    for events in chunks:
        if not counts.size:
            counts = np.zeros((events.height, events.width), np.int64)
        pixels = events.y.astype(np.int64) * events.width + events.x
        counts += np.bincount(pixels, minlength=counts.size).reshape(counts.shape)
    return counts


def hot_pixels(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which pixels fire on their own: far more often than those around them.

    A pixel is hot with at least 20 events, and more than ten times as many as the third busiest of its eight
    neighbours and one.  Edges that pass over the sensor make several neighbours fire alike, however often.

    Args:
        counts: Events of each pixel, (h, w).

    Returns:
        (h, w), True where a pixel is hot.
    """
    height, width = counts.shape
    if not counts.size:
        return np.zeros(counts.shape, np.bool_)
    padded = np.pad(counts, 1)
    around = [
        padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
        if (dx, dy) != (0, 0)
    ]
    third_busiest = np.sort(np.stack(around), axis=0)[-3]
    hot: npt.NDArray[np.bool_] = (counts >= HOT_EVENTS) & (counts > HOT_RATIO * (third_busiest + 1))
    return hot


def drop_pixels(chunks: Iterable[EventArray], dropped: npt.NDArray[np.bool_]) -> Iterator[EventArray]:
    """The events of all pixels but some.

    Args:
        chunks: Events of one sensor.
        dropped: (height, width), True for a pixel to leave out.
    """
    for events in chunks:
        kept = ~dropped[events.y, events.x]
        if kept.any():
            yield events[kept]
