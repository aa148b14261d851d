"""First guesses of a motion: the published grid search, and a coarse-to-fine search that can be afforded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import ceil, log2
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from emseg.reference.contrast import CONTRASTS
from emseg.reference.iwe import iwe
from emseg.reference.warp import DEGREES_OF_FREEDOM, MotionModel, warp_points
from emseg.reference.window import ImageFrame, Window

Floats = NDArray[np.float64]

CELL = 2.0  # px; at this size the coarse-to-fine search needs no blur
COARSEST_REACH = 32.0  # px that the fastest motion moves events within the first slice of the window
COARSEST_STEP = 4.0  # px between trials within a slice: two cells
FINEST_STEP = 1.0  # px between the last trials within the whole window


@dataclass(frozen=True)
class SearchOptions:
    """How and how far to search.  The defaults are the published code's most frequent values."""

    method: Literal["coarse_to_fine", "published"] = "coarse_to_fine"
    translation_max: float = 5000.0  # px/s (Affine_trans2d_max)
    scale_max: float = 0.5  # 1/s (Affine_scale_max)
    theta_max: float = 1.5  # rad/s (Affine_theta_max)
    levels: int = 7  # halvings of the published grid (division_exponent)


def search(
    window: Window,
    kind: str,
    *,
    contrast: str = "variance",
    sigma: float = 1.0,
    options: SearchOptions | None = None,
) -> MotionModel:
    """A model of the kind whose image of the window's events is sharp: a start for `fit.refine`."""
    options = options or SearchOptions()
    if options.method == "published":

        def score(params: Floats) -> float:
            return CONTRASTS[contrast](iwe(MotionModel(kind, tuple(params)), window, sigma=sigma))

        best = grid_search(score, half_range(kind, window.frame, options), levels=options.levels)
        return MotionModel(kind, tuple(best.tolist()))
    velocity = coarse_to_fine_velocity(window, translation_max=options.translation_max)
    return model_of_velocity(velocity, kind, window)


# The published search ---------------------------------------------------------------------------------------


def grid_search(score: Callable[[Floats], float], reach: Floats, *, levels: int) -> Floats:
    """The best of 5^dof trials a level around the best of the level before; a tie keeps the earlier trial.

    Level l = 1 .. levels tries -2, -1, 0, 1, 2 steps of reach / 2^l in every parameter, so that the first
    level spans the reach (dof,) both ways.
    """
    best = np.zeros(len(reach))
    best_score = score(best)
    for level in range(1, levels + 1):
        around = best
        step = reach / 2**level
        for offset in product((-2, -1, 0, 1, 2), repeat=len(reach)):
            trial = around + np.array(offset) * step
            trial_score = score(trial)
            if trial_score > best_score:
                best, best_score = trial, trial_score
    return best


def half_range(kind: str, frame: ImageFrame, options: SearchOptions) -> Floats:
    """How far the first level of the published grid goes in each parameter (dof,); all go twice as far.

    It is published for translation and similarity; the other models take the range nearest in meaning.
    """
    shift, scale, theta = options.translation_max, options.scale_max, options.theta_max
    pan = shift / frame.pinhole.fx
    ranges: dict[str, tuple[float, ...]] = {
        "translation": (shift, shift),
        "rotation": (pan, pan, theta),
        "similarity": (shift, shift, scale, theta),
        "affine": (shift, shift, scale, theta, theta, scale),
        "homography": (shift, shift, scale, theta, theta, scale, scale, scale),
    }
    return np.array(ranges[kind])


# The coarse-to-fine search ----------------------------------------------------------------------------------


def coarse_to_fine_velocity(window: Window, *, translation_max: float) -> Floats:
    """The velocity (2,), px/s, at which most pairs of the window's events meet in a cell.

    A short slice in the middle of the window tries the whole disc of velocities; each next level doubles the
    slice and halves the step around the best, until the slice is the window; then the step alone is halved.
    """
    if len(window) == 0 or window.duration == 0:
        return np.zeros(2)
    middle = (window.dt[0] + window.dt[-1]) / 2
    doublings = max(0, ceil(log2(translation_max * window.duration / COARSEST_REACH)))
    duration = window.duration / 2**doublings
    step = COARSEST_STEP / duration
    rings = int(translation_max / step)
    axis = np.arange(-rings, rings + 1) * step
    trials = np.array([(vx, vy) for vy in axis for vx in axis if np.hypot(vx, vy) <= translation_max])
    best = np.zeros(2)
    while True:
        in_slice = np.abs(window.dt - middle) <= duration / 2 * (1 + 1e-9)
        best = _best_velocity(window.position[in_slice], window.dt[in_slice] - middle, trials)
        if step * window.duration <= FINEST_STEP:
            return best
        duration = min(2 * duration, window.duration)
        step /= 2
        around = np.arange(-2, 3) * step
        trials = best + np.array([(vx, vy) for vy in around for vx in around])


def _best_velocity(position: Floats, dt: Floats, trials: Floats) -> Floats:
    """The trial velocity with the most pairs; the slower one of equals."""
    pairs = [meeting_pairs(position, dt, velocity) for velocity in trials]
    speeds = np.hypot(*trials.T)
    return np.asarray(trials[np.lexsort((speeds, -np.array(pairs)))[0]])


def meeting_pairs(position: Floats, dt: Floats, velocity: Floats) -> int:
    """Ordered pairs of events that a velocity brings into the same cell: the sum over cells of n (n - 1)."""
    if len(dt) == 0:
        return 0
    warped = position - dt[:, None] * velocity
    cells = np.floor(warped / CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    columns, rows = cells.max(axis=0) + 1
    return int(_count_pairs(cells, int(columns), int(rows)))


@njit(cache=True)
def _count_pairs(cells: NDArray[np.int64], columns: int, rows: int) -> int:
    counts = np.zeros((rows, columns), dtype=np.int64)
    pairs = 0
    for k in range(len(cells)):
        column, row = cells[k]
        pairs += 2 * counts[row, column]
        counts[row, column] += 1
    return pairs


def model_of_velocity(velocity: Floats, kind: str, window: Window) -> MotionModel:
    """The model of the kind that moves the window's centroid with the velocity and does no more."""
    if kind == "rotation":
        centroid = window.position.mean(axis=0)
        omega = np.linalg.pinv(_rotation_flow(centroid, window.frame)) @ velocity
        return MotionModel(kind, tuple(omega.tolist()))
    rest = DEGREES_OF_FREEDOM[kind] - 2
    return MotionModel(kind, (*velocity.tolist(), *(0.0,) * rest))


def _rotation_flow(point: Floats, frame: ImageFrame) -> Floats:
    """Matrix (2, 3) from a small angular velocity, rad/s, to the image velocity, px/s, at a point (2,)."""
    second = 1e-6
    moved = [
        warp_points(MotionModel("rotation", tuple(unit)), point[None], np.array([second]), frame)[0]
        for unit in np.eye(3).tolist()
    ]
    return np.stack([(point - at) / second for at in moved], axis=-1)
