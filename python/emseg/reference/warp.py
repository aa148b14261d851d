"""The five motion models: where an event that was seen at x at time t_ref + dt was at t_ref.

Parameters are rates in px/s, rad/s and 1/s, so that the identity is the zero vector of every model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emseg.reference.window import ImageFrame, Window

Floats = NDArray[np.float64]

DEGREES_OF_FREEDOM = {"translation": 2, "rotation": 3, "similarity": 4, "affine": 6, "homography": 8}


@dataclass(frozen=True)
class MotionModel:
    """One parametric motion: its kind, a key of `DEGREES_OF_FREEDOM`, and its parameters."""

    kind: str
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.kind not in DEGREES_OF_FREEDOM:
            raise ValueError(f"motion model {self.kind!r}; expected one of {', '.join(DEGREES_OF_FREEDOM)}")
        if len(self.params) != DEGREES_OF_FREEDOM[self.kind]:
            expected = DEGREES_OF_FREEDOM[self.kind]
            raise ValueError(f"{self.kind} with {len(self.params)} parameters; expected {expected}")

    @classmethod
    def identity(cls, kind: str) -> MotionModel:
        """The motion that leaves every event in its place."""
        return cls(kind, (0.0,) * DEGREES_OF_FREEDOM[kind])


def warp(model: MotionModel, window: Window) -> Floats:
    """Places x' (n, 2), px, of the events at t_ref; NaN where a rotation turns one behind the camera."""
    return warp_points(model, window.position, window.dt, window.frame)


def warp_points(model: MotionModel, x: Floats, dt: Floats, frame: ImageFrame) -> Floats:
    """Places x' (n, 2) at t_ref of points x (n, 2) seen dt (n,) seconds after it."""
    params = np.array(model.params)
    if model.kind == "rotation":
        return _rotate(params, x, dt, frame)
    return x - dt[:, None] * _velocity_field(model.kind, params, x, frame)


def _velocity_field(kind: str, params: Floats, x: Floats, frame: ImageFrame) -> Floats:
    """Image velocity (n, 2), px/s, of a model whose events move in straight lines."""
    v = params[:2]
    arm = x - frame.pivot
    match kind:
        case "translation":  # x' = x - v dt
            return np.broadcast_to(v, x.shape)
        case "similarity":  # x' = x - dt (v + ((1 + s) R(theta) - I)(x - c))
            s, theta = params[2:]
            rotation = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
            matrix: Floats = (1 + s) * rotation - np.eye(2)
            return v + arm @ matrix.T
        case "affine":  # x' = x - dt (v + A (x - c))
            return v + arm @ params[2:].reshape(2, 2).T
        case "homography":  # x' = x - dt (v + A (x - c) + (x - c)(g r_x + h r_y)), r = (x - c) / f0
            slope = (arm / frame.focal_scale) @ params[6:]
            return v + arm @ params[2:6].reshape(2, 2).T + arm * slope[:, None]
        case _:
            raise ValueError(f"{kind} has no velocity field")


def _rotate(omega: Floats, x: Floats, dt: Floats, frame: ImageFrame) -> Floats:
    """x' = K f' / f'_z with f' = exp(-dt [omega]x) K^-1 (x, y, 1), by Rodrigues' formula."""
    camera = frame.pinhole
    f = np.column_stack([camera.bearing(x), np.ones(len(x))])
    speed = np.linalg.norm(omega)
    if speed == 0.0:
        return x.copy()
    axis = omega / speed
    angle = (-dt * speed)[:, None]
    turned = (
        f * np.cos(angle)
        + np.cross(axis, f) * np.sin(angle)
        + axis * (f @ axis)[:, None] * (1 - np.cos(angle))
    )
    depth = np.where(turned[:, 2:] > 0, turned[:, 2:], np.nan)
    return camera.project(turned[:, :2] / depth)
