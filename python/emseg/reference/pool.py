"""The model pool: one candidate motion for every sub-volume of the window that holds enough events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from emseg.reference.fit import FitOptions, fit_motion
from emseg.reference.warp import MotionModel
from emseg.reference.window import Window

MIN_RELATIVE_DENSITY = 0.75  # of the whole image's events per pixel


def sub_volumes(window: Window, *, bracket_row: int) -> list[NDArray[np.bool_]]:
    """Masks (n,) of the events of each kept sub-volume: h x h blocks of the sensor for h = 1 .. bracket_row.

    The last row and column of blocks take the remainder.  A block is kept if its events per pixel are at
    least `MIN_RELATIVE_DENSITY` of the whole image's, and if it holds any.
    """
    width, height = window.frame.width, window.frame.height
    least_density = MIN_RELATIVE_DENSITY * len(window) / (width * height)
    kept = []
    for h in range(1, bracket_row + 1):
        columns = np.minimum(window.pixel[:, 0] // max(width // h, 1), h - 1)
        rows = np.minimum(window.pixel[:, 1] // max(height // h, 1), h - 1)
        for row in range(h):
            for column in range(h):
                area = _block_length(column, width, h) * _block_length(row, height, h)
                mask = (columns == column) & (rows == row)
                if mask.any() and mask.sum() >= least_density * area:
                    kept.append(mask)
    return kept


def _block_length(index: int, length: int, count: int) -> int:
    side = length // count
    return side if index < count - 1 else length - side * (count - 1)


def model_pool(window: Window, *, bracket_row: int, fit: FitOptions | None = None) -> list[MotionModel]:
    """One fitted model for every kept sub-volume, in `sub_volumes`' order."""
    fit = fit or FitOptions()
    return [fit_motion(window.select(mask), fit)[0] for mask in sub_volumes(window, bracket_row=bracket_row)]
