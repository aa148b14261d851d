"""What an inertial sensor at the camera's centre measures."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from emseg import _core

__all__ = ["GRAVITY", "IMU_DTYPE", "measure"]

GRAVITY: Final = (0.0, 9.81, 0.0)  # m/s², in the world: y points down

IMU_DTYPE: Final = np.dtype([("t", "i8"), ("gyro", "f8", 3), ("accel", "f8", 3)])
"""Time µs; angular velocity rad/s and specific force m/s², both in the camera's frame."""

DIFFERENCE: Final = 2e-3  # s, of the central differences


def measure(T_world_camera: _core.Path, duration: float, rate: float) -> NDArray[np.void]:
    """Exact measurements (n,) of :data:`IMU_DTYPE`, `rate` Hz, within `duration` s.

    Differences are central, over paths that are smooth to a few milliseconds; the first and last of them
    reach no further than the path.
    """
    steps = np.arange(int(duration * rate + 1e-9) + 1)
    t = steps / rate
    middle = np.clip(t, DIFFERENCE, max(duration - DIFFERENCE, DIFFERENCE))
    before, at, after = (T_world_camera.poses(middle + shift) for shift in (-DIFFERENCE, 0.0, DIFFERENCE))
    turn = np.einsum("nji,njk->nik", before[:, :3, :3], after[:, :3, :3])
    acceleration = (after[:, :3, 3] - 2 * at[:, :3, 3] + before[:, :3, 3]) / DIFFERENCE**2
    measured = np.zeros(len(t), IMU_DTYPE)
    measured["t"] = np.rint(t * 1e6).astype(np.int64)
    measured["gyro"] = _rotation_vector(turn) / (2 * DIFFERENCE)
    measured["accel"] = np.einsum("nji,nj->ni", at[:, :3, :3], acceleration - np.array(GRAVITY))
    return measured


def _rotation_vector(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vectors, rad, of rotation matrices (n, 3, 3) by much less than half a turn."""
    skew = 0.5 * (rotation - np.swapaxes(rotation, 1, 2))
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    scale = np.where(sine > 1e-12, np.arcsin(np.minimum(sine, 1)) / np.maximum(sine, 1e-12), 1.0)
    turned: NDArray[np.float64] = axis * scale
    return turned
