"""The image of warped events: bilinear votes, then a Gaussian blur; and its bilinear lookup."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from emseg.reference.warp import MotionModel, warp
from emseg.reference.window import Region, Window

Floats = NDArray[np.float64]


@njit(cache=True)
def bilinear_votes(points: Floats, width: int, height: int) -> Floats:
    """Image (height, width) in which every point (n, 2) has shared a vote of 1 among its four pixels.

    Each of the four shares that falls outside the image is dropped by itself, and so are points that are NaN.
    """
    image = np.zeros((height, width))
    for k in range(len(points)):
        x, y = points[k]
        if not (-1 < x < width and -1 < y < height):
            continue
        left, top = int(np.floor(x)), int(np.floor(y))
        for row, row_share in ((top, top + 1 - y), (top + 1, y - top)):
            for column, column_share in ((left, left + 1 - x), (left + 1, x - left)):
                if 0 <= row < height and 0 <= column < width:
                    image[row, column] += row_share * column_share
    return image


def gaussian_kernel(sigma: float) -> Floats:
    """Samples of a Gaussian at -r .. r with r = int(4 sigma + 0.5), normalised to sum 1."""
    radius = int(4 * sigma + 0.5)
    if radius == 0:
        return np.ones(1)
    samples = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    return np.asarray(samples / samples.sum(), dtype=np.float64)


def blur(image: Floats, sigma: float) -> Floats:
    """The image convolved with `gaussian_kernel` along both axes; outside the image is zero."""
    kernel = gaussian_kernel(sigma)
    down = ndimage.correlate1d(image, kernel, axis=0, mode="constant", cval=0.0)
    return np.asarray(ndimage.correlate1d(down, kernel, axis=1, mode="constant", cval=0.0))


def iwe(model: MotionModel, window: Window, *, sigma: float = 1.0, region: Region | None = None) -> Floats:
    """Image (height, width) of the window's events warped to t_ref by the model, blurred by sigma px.

    It covers the region, the sensor by default; votes beyond it are dropped.
    """
    region = region or window.frame.sensor
    points = warp(model, window) - [region.x0, region.y0]
    return blur(bilinear_votes(points, region.width, region.height), sigma)


@njit(cache=True)
def bilinear_lookup(image: Floats, points: Floats) -> Floats:
    """The image's value (n,) at points (n, 2) between pixels, zero outside it: the votes' adjoint."""
    height, width = image.shape
    values = np.zeros(len(points))
    for k in range(len(points)):
        x, y = points[k]
        if not (-1 < x < width and -1 < y < height):
            continue
        left, top = int(np.floor(x)), int(np.floor(y))
        for row, row_share in ((top, top + 1 - y), (top + 1, y - top)):
            for column, column_share in ((left, left + 1 - x), (left + 1, x - left)):
                if 0 <= row < height and 0 <= column < width:
                    values[k] += row_share * column_share * image[row, column]
    return values
