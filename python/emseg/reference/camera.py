"""Pinhole cameras with lens distortion, and the table that undistorts every pixel once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels and distortion coefficients.

    ``radtan`` is Brown-Conrady (k1, k2, p1, p2[, k3]); ``equidistant`` is Kannala-Brandt (k1, k2, k3, k4).
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: Literal["radtan", "equidistant"] = "radtan"

    def bearing(self, points: Floats) -> Floats:
        """Normalised image coordinates (n, 2) of undistorted pixels (n, 2)."""
        return (points - [self.cx, self.cy]) / [self.fx, self.fy]

    def project(self, normalised: Floats) -> Floats:
        """Undistorted pixels (n, 2) of normalised image coordinates (n, 2)."""
        return normalised * [self.fx, self.fy] + [self.cx, self.cy]

    def distort(self, points: Floats) -> Floats:
        """Pixels (n, 2) at which the lens shows the undistorted pixels (n, 2)."""
        return self.project(self._distort_normalised(self.bearing(points)))

    def undistort(self, points: Floats) -> Floats:
        """Undistorted pixels (n, 2) of the sensor's pixels (n, 2); inverts `distort`.

        Newton's method with a numerical Jacobian.  Raises ValueError where it does not converge, which is
        where the polynomial folds back and the pixel has no undistorted place.
        """
        target = self.bearing(np.asarray(points, dtype=np.float64))
        guess = target.copy()
        step = 1e-6
        for _ in range(50):
            residual = self._distort_normalised(guess) - target
            if np.abs(residual).max(initial=0.0) < 1e-12:
                return self.project(guess)
            along_x, along_y = (
                (
                    self._distort_normalised(guess + step * axis)
                    - self._distort_normalised(guess - step * axis)
                )
                / (2 * step)
                for axis in np.eye(2)
            )
            jacobian = np.stack([along_x, along_y], axis=-1)
            guess -= np.linalg.solve(jacobian, residual[..., None])[..., 0]
        raise ValueError(
            f"distortion {self.distortion} cannot be inverted over the image; expected a lens model "
            "that is one-to-one there"
        )

    def _distort_normalised(self, normalised: Floats) -> Floats:
        x, y = normalised.T
        r2 = x * x + y * y
        if self.model == "equidistant":
            r = np.sqrt(r2)
            theta = np.arctan(r)
            powers = sum(k * theta ** (2 * i + 3) for i, k in enumerate(self.distortion))
            scale = np.where(r > 1e-12, (theta + powers) / np.maximum(r, 1e-12), 1.0)
            return normalised * scale[:, None]
        k1, k2, p1, p2, k3 = (*self.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )


@lru_cache(maxsize=4)
def undistortion_table(camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """Undistorted position of every pixel of the sensor, float32 (height, width, 2), read-only."""
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1)
    table = camera.undistort(pixels).reshape(height, width, 2).astype(np.float32)
    table.setflags(write=False)
    return table
