"""Contrast (focus measures) of an image of warped events: the sharper the image, the larger.

Sources: Gallego, Rebecq, Scaramuzza, CVPR 2018 (variance); Gallego, Gehrig, Scaramuzza, CVPR 2019
(the others).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def variance(image: Floats) -> float:
    """Mean over the pixels of (I - mean I)^2."""
    return float(np.mean((image - image.mean()) ** 2))


def mean_square(image: Floats) -> float:
    """Mean over the pixels of I^2."""
    return float(np.mean(image**2))


def gradient_magnitude(image: Floats) -> float:
    """Mean over the pixels of I_x^2 + I_y^2, by central differences; outside the image is zero."""
    padded = np.pad(image, 1)
    along_x = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    along_y = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    return float(np.mean(along_x**2 + along_y**2))


CONTRASTS: dict[str, Callable[[Floats], float]] = {
    "variance": variance,
    "mean_square": mean_square,
    "gradient_magnitude": gradient_magnitude,
}
