"""Contrast maximisation: the model whose image of warped events is sharpest.

Source: Gallego, Rebecq, Scaramuzza, "A Unifying Contrast Maximization Framework for Event
Cameras", CVPR 2018.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from emseg.reference.contrast import CONTRASTS
from emseg.reference.iwe import iwe
from emseg.reference.search import SearchOptions, half_range, search
from emseg.reference.warp import MotionModel
from emseg.reference.window import Window

Floats = NDArray[np.float64]

PROBE = 0.1  # px that central differences move an event: a bilinear vote is only piecewise smooth below that


@dataclass(frozen=True)
class FitOptions:
    """What to fit, and when to stop.  Iterations and tolerance are the published code's."""

    kind: str = "similarity"
    contrast: str = "variance"
    sigma: float = 1.0  # px
    search: SearchOptions = field(default_factory=SearchOptions)
    max_iterations: int = 50
    tolerance: float = 1e-2  # gradient of the contrast, relative to the contrast, per px


def fit_motion(window: Window, options: FitOptions | None = None) -> tuple[MotionModel, float]:
    """The model of one motion and its contrast: search, then refinement."""
    options = options or FitOptions()
    start = search(
        window, options.kind, contrast=options.contrast, sigma=options.sigma, options=options.search
    )
    return refine(start, window, options)


def refine(
    start: MotionModel, window: Window, options: FitOptions | None = None
) -> tuple[MotionModel, float]:
    """Conjugate gradients from a start: the best model met on the way, the start included, and its contrast.

    Parameters are held within the reach of the published grid: beyond it the sharpest image is that of events
    drawn together into a point (event collapse: Shiba, Aoki, Gallego, Sensors 2022).
    """
    options = options or FitOptions()
    measure = CONTRASTS[options.contrast]
    unit = one_pixel_step(start.kind, window)
    limit = 2 * half_range(start.kind, window.frame, options.search)
    start_contrast = measure(iwe(start, window, sigma=options.sigma))
    if start_contrast <= 0:
        return start, start_contrast
    best, best_contrast = start, start_contrast

    def loss(pixels: Floats) -> float:
        nonlocal best, best_contrast
        params = np.clip(np.array(start.params) + pixels * unit, -limit, limit)
        model = MotionModel(start.kind, tuple(params.tolist()))
        contrast = measure(iwe(model, window, sigma=options.sigma))
        if contrast > best_contrast:
            best, best_contrast = model, contrast
        return -contrast / start_contrast

    optimize.minimize(
        loss,
        np.zeros(len(unit)),
        jac=lambda pixels: central_difference(loss, pixels, PROBE),
        method="CG",
        options={"maxiter": options.max_iterations, "gtol": options.tolerance},
    )
    return best, best_contrast


def one_pixel_step(kind: str, window: Window) -> Floats:
    """Change of each parameter (dof,) that moves the window's events by about one pixel.

    It makes px/s, rad/s and 1/s commensurable, so that one step length and one tolerance serve them all.
    """
    time = max(float(np.sqrt(np.mean(window.dt**2))) if len(window) else 0.0, 1e-6)
    offset = window.position - window.frame.pivot
    arm = max(float(np.sqrt(np.mean(np.sum(offset**2, axis=1)))) if len(window) else 0.0, 1.0)
    shift, turn = 1 / time, 1 / (time * arm)
    projective = turn * window.frame.focal_scale / arm
    pan = 1 / (time * window.frame.pinhole.fx)
    steps: dict[str, tuple[float, ...]] = {
        "translation": (shift, shift),
        "rotation": (pan, pan, turn),
        "similarity": (shift, shift, turn, turn),
        "affine": (shift, shift, turn, turn, turn, turn),
        "homography": (shift, shift, turn, turn, turn, turn, projective, projective),
    }
    return np.array(steps[kind])


def central_difference(function: Callable[[Floats], float], x: Floats, step: float) -> Floats:
    """Gradient (dof,) of a scalar function at x (dof,)."""
    return np.array(
        [(function(x + step * axis) - function(x - step * axis)) / (2 * step) for axis in np.eye(len(x))]
    )
