"""Sensor sizes, for recordings that do not say theirs."""

from __future__ import annotations

import logging
from os import PathLike
from typing import Final

__all__ = ["KNOWN_SENSORS", "guess_size"]

_log = logging.getLogger(__name__)

KNOWN_SENSORS: Final[dict[tuple[int, int], str]] = {
    (128, 128): "DVS128",
    (240, 180): "DAVIS240",
    (304, 240): "ATIS",
    (320, 320): "GenX320",
    (346, 260): "DAVIS346",
    (640, 480): "DVXplorer, Gen3",
    (1280, 720): "Gen4, EVK4",
}
"""Width and height in px of common sensors, smallest first."""


def guess_size(right: float, bottom: float, path: str | PathLike[str]) -> tuple[int, int]:
    """A sensor size that holds all coordinates, for a file that names none.

    The smallest known sensor that holds them; where none does, one more than the largest coordinates.  It is
    a guess, and logged as a warning: the far edge of the sensor may have seen no event.

    Args:
        right: Largest column of an event, px; negative where there is no event.
        bottom: Largest row of an event, px.
        path: The file, for the warning.

    Raises:
        ValueError: without events, or where no sensor holds them.
    """
    if right < 0 and bottom < 0:
        raise ValueError("holds no events and no sensor size: give width and height")
    if not all(0 <= side < 65536 for side in (right, bottom)):
        raise ValueError(f"no sensor holds coordinates up to ({right:g}, {bottom:g}), expected 0..65535")
    used = int(right) + 1, int(bottom) + 1
    fitting = [size for size in KNOWN_SENSORS if size[0] >= used[0] and size[1] >= used[1]]
    size = fitting[0] if fitting else used
    known = f" ({KNOWN_SENSORS[size]})" if size in KNOWN_SENSORS else ""
    _log.warning("%s names no sensor size: taken to be %dx%d%s", path, *size, known)
    return size
