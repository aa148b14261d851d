"""Warp and bilinear vote in numba, one thread: the pace that the native kernel is held against."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]


@njit(cache=True, fastmath=True)
def warp_and_vote(x: Floats, y: Floats, dt: Floats, field: Floats, centre: Floats, image: Floats) -> Any:
    """Clear the image (height, width), then let every event vote for the four pixels about its warped place.

    field: vx, vy, a11, a12, a21, a22 of x' = x - dt (v + A (x - c)); centre: c.
    """
    image[:] = 0
    height, width = image.shape
    one = np.float32(1)
    vx, vy, a11, a12, a21, a22 = field[0], field[1], field[2], field[3], field[4], field[5]
    cx, cy = centre[0], centre[1]
    for k in range(len(x)):
        rx, ry = x[k] - cx, y[k] - cy
        u = x[k] - dt[k] * (vx + a11 * rx + a12 * ry)
        v = y[k] - dt[k] * (vy + a21 * rx + a22 * ry)
        if 0 <= u < width - 1 and 0 <= v < height - 1:
            left, top = int(u), int(v)
            fu, fv = u - np.float32(left), v - np.float32(top)
            image[top, left] += (one - fu) * (one - fv)
            image[top, left + 1] += fu * (one - fv)
            image[top + 1, left] += (one - fu) * fv
            image[top + 1, left + 1] += fu * fv
        elif -1 < u < width and -1 < v < height:  # shares that fall outside are dropped one by one
            left, top = int(np.floor(u)), int(np.floor(v))
            fu, fv = u - np.float32(left), v - np.float32(top)
            for row, row_share in ((top, one - fv), (top + 1, fv)):
                for column, column_share in ((left, one - fu), (left + 1, fu)):
                    if 0 <= row < height and 0 <= column < width:
                        image[row, column] += row_share * column_share
    return image
