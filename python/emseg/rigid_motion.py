"""One rigid motion of the camera past a still scene in layers, from the flows of the parts of a window.

What stands still moves, at the place x of the image, by rotation(x) + rho * translation(x): the rotation and
the direction of the translation are the same for all, the inverse depth rho >= 0 is each part's own.  So all
that stands still goes along the lines through one point of the image, at whatever speed: what lies in three
layers or more has little chance of doing so by moving itself.

Source: Longuet-Higgins & Prazdny, "The interpretation of a moving retinal image", Proc. R. Soc. B 208, 1980.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["RigidMotion", "layers_of", "fit_rigid_motion", "parallax_doubt_of_layers"]

Array = npt.NDArray[np.float64]

_NOISE_PX: Final = 0.7  # of a displacement
_NOISE_SHARE: Final = 0.08  # and this share of it
_TURN_PX: Final = 2.6  # rotation that is expected, as a displacement; a hand's is larger, and hides parallax
_ROUNDS: Final = 2

_LAYER_PX: Final = 1.5  # between layers
_LAYER_SHARE: Final = 0.22  # and this share of their inverse depths
_EXPLAINED: Final = 1.6  # standard deviations
_SLOWEST_PX: Final = 1.2  # of the background: what hardly moves has no direction
_AHEAD: Final = 0.7  # of a unit of translation: surely not to the side
_FILLED: Final = 0.2  # share of the view that layers before the background fill
_MISFIT: Final = 0.8  # from which on nothing is learnt
_GAP: Final = 0.9  # between layers, and
_NEARER: Final = 0.9  # beyond this of the background, as the logarithm of depth
_DOUBT: Final = 8.0  # logit for every layer beyond the second


@dataclass(frozen=True)
class RigidMotion:
    """A camera's motion over a window, and how it explains p parts.

    Attributes:
        direction: Of the camera's translation, unit vector (3,): right, down, ahead.
        rotation: Of the scene about these axes, as displacements, px: radians times the focal length (3,).
        depths: Inverse depths (p,), as displacements, px: translation times focal length by depth; negative
            where a part goes the wrong way.
        errors: What the motion leaves unexplained of each part's flow, in its standard deviations, (p,).
        misfit: Weighted mean of log(1 + error^2 / 4), and what the rotation is more than expected.
    """

    direction: Array
    rotation: Array
    depths: Array
    errors: Array
    misfit: float


def fit_rigid_motion(places: Array, flows: Array, weights: Array, focal_length: float) -> RigidMotion:
    """The rigid motion that explains most parts.

    Directions are tried that explain a part or two exactly; the best is refined by least squares with Cauchy
    weights, direction and rotation by turns.

    Args:
        places: Places in each of p parts (p, k, 2), px from the principal point.
        flows: Their displacements over the window (p, k, 2), px.
        weights: Of the parts (p,), positive.
        focal_length: px.

    Raises:
        ValueError: there is no part.
    """
    parts, samples = places.shape[:2]
    if not parts:
        raise ValueError("places has no parts, expected at least one")
    points, moves = places.reshape(-1, 2), flows.reshape(-1, 2)
    fit = _Fit(points, moves, np.repeat(weights / (weights.sum() * samples), samples), focal_length)
    tried = fit(_directions(places.mean(axis=1), flows.mean(axis=1), focal_length))
    best = int(tried.misfit.argmin())
    direction = tried.direction[best]
    found = tried
    for _ in range(_ROUNDS):
        direction = fit.refined(direction, found.rotation[best], found.robust[best])
        found, before = fit(direction[None]), found
        if found.misfit[0] >= before.misfit[best]:
            found = before
            break
        best = 0
    depths, errors = found.depth[best].reshape(parts, samples), found.error[best].reshape(parts, samples)
    return RigidMotion(
        found.direction[best],
        found.rotation[best],
        depths.mean(axis=1),
        np.sqrt((errors**2).mean(axis=1)),
        float(found.misfit[best]),
    )


def _directions(places: Array, flows: Array, focal_length: float) -> Array:
    """Directions (m, 3) by which a part's flow is a translation to the side, or two parts' flows are one's."""
    ones, zeros = np.full(len(places), focal_length), np.zeros(len(places))
    planes = np.cross(np.column_stack([places, ones]), np.column_stack([flows, zeros]))
    first, second = np.triu_indices(len(places), 1)
    found = np.concatenate([np.column_stack([-flows, zeros]), np.cross(planes[first], planes[second])])
    length = np.linalg.norm(found, axis=1)
    found = found[length > 1e-9] / length[length > 1e-9, None]
    return found if len(found) else np.array([[1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class _Tried:
    """Of m directions and n points."""

    direction: Array  # (m, 3)
    rotation: Array  # (m, 3)
    depth: Array  # (m, n)
    error: Array  # (m, n)
    robust: Array  # (m, n)
    misfit: Array  # (m,)


class _Fit:
    """The rotation that goes best with each of some directions.

    Args:
        points: (n, 2), px from the principal point.
        flows: (n, 2), px.
        weights: (n,), of sum 1.
        focal_length: px.
    """

    def __init__(self, points: Array, flows: Array, weights: Array, focal_length: float) -> None:
        x, y = points.T / focal_length
        self._x, self._y, self._flows, self._focal_length = x, y, flows, focal_length
        self._turns = np.stack(
            [np.stack([x * y, -1 - x * x, y], axis=-1), np.stack([1 + y * y, -x * y, -x], axis=-1)], axis=1
        )  # (n, 2, 3)
        self._weights = weights
        self._noise = np.hypot(_NOISE_PX, _NOISE_SHARE * np.hypot(*flows.T))
        # Rolling turns no place further from the axis than others, by as many px.
        self._calm = np.diag([1.0, 1.0, 0.25]) / _TURN_PX**2

    def __call__(self, directions: Array) -> _Tried:
        """Fit with each of the directions (m, 3), of either sign."""
        right, down, ahead = directions.T[..., None]
        lines = np.stack([self._x * ahead - right, self._y * ahead - down], axis=-1)  # (m, n, 2)
        reach = np.hypot(lines[..., 0], lines[..., 1]) + 1e-3
        along = lines / reach[..., None]
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        aside = (across * self._flows).sum(axis=-1)
        turned = np.einsum("mni,nij->mnj", across, self._turns)
        robust = np.ones_like(aside)
        for _ in range(2):
            scale = self._weights * robust / self._noise**2
            scaled = turned * scale[..., None]
            normal = scaled.transpose(0, 2, 1) @ turned + self._calm
            rotation = np.linalg.solve(normal, (scaled * aside[..., None]).sum(axis=1)[..., None])[..., 0]
            rest = self._flows - np.einsum("nij,mj->mni", self._turns, rotation)
            forth = (along * rest).sum(axis=-1)
            sign = np.where((forth * self._weights * robust).sum(axis=-1) < 0, -1.0, 1.0)
            depth = forth * sign[:, None] / reach
            error = np.hypot((across * rest).sum(axis=-1), np.minimum(forth * sign[:, None], 0)) / self._noise
            robust = 1 / (1 + error**2 / 4)
        turn = 0.5 * np.einsum("mj,jk,mk->m", rotation, self._calm, rotation)
        misfit = (self._weights * np.log1p(error**2 / 4)).sum(axis=-1) + turn
        return _Tried(directions * sign[:, None], rotation, depth, error, robust, misfit)

    def refined(self, direction: Array, rotation: Array, robust: Array) -> Array:
        """The direction (3,) nearest to all planes through a ray and where it goes when not turned."""
        rest = self._flows - self._turns @ rotation
        rays = np.column_stack([self._x, self._y, np.ones_like(self._x)])
        planes = np.cross(rays, np.column_stack([rest, np.zeros(len(rest))]))
        reach = np.hypot(self._x * direction[2] - direction[0], self._y * direction[2] - direction[1]) + 1e-3
        planes *= np.sqrt(self._weights * robust)[:, None] / (self._noise * reach)[:, None]
        found: Array = np.linalg.eigh(planes.T @ planes)[1][:, 0]
        return found if found @ direction > 0 else -found


def layers_of(depths: Array) -> Array:
    """The inverse depths (l,) of the layers that those of some parts (n,), px, fall into, farthest first."""
    layers: list[list[float]] = []
    for depth in sorted(depths.tolist()):
        if layers and depth - layers[-1][0] <= max(_LAYER_PX, _LAYER_SHARE * depth):
            layers[-1].append(depth)
        else:
            layers.append([depth])
    return np.array([np.mean(layer) for layer in layers])


def parallax_doubt_of_layers(motion: RigidMotion, areas: Array, clear: npt.NDArray[np.bool_], background: int) -> Array:
    """Logits to take from each of p parts that it moves: the likelier, the more layers one motion explains.

    Less where a part would be much nearer than the background, or than any other layer: objects are.

    Args:
        motion: Of the camera.
        areas: Of the parts, shares of the view (p,).
        clear: Parts that are large and firm enough to be seen as a layer, (p,).
        background: The part that surely stands still.
    """
    nothing = np.zeros(len(motion.depths))
    explained = motion.errors < _EXPLAINED
    if not (explained[background] and motion.depths[background] > _SLOWEST_PX):
        return nothing
    layers = layers_of(motion.depths[explained & clear])
    # Any two parts lie in layers of a motion to the side, any three in layers of one ahead.
    free = 2 + min(1.0, float(motion.direction[2] / _AHEAD) ** 2)
    if len(layers) <= free or motion.misfit >= _MISFIT:
        return nothing
    filled = float(areas[explained & clear].sum() - areas[background])
    sure = min(len(layers) - free, 2) * (1 - motion.misfit / _MISFIT) * min(1.0, max(0, filled) / _FILLED)
    depths = np.maximum(motion.depths, _SLOWEST_PX)
    apart = np.abs(np.log(depths[:, None] / np.maximum(layers, _SLOWEST_PX)))
    apart[np.abs(depths[:, None] - layers) <= np.maximum(_LAYER_PX, _LAYER_SHARE * depths[:, None])] = np.inf
    nearer = np.maximum(0, np.log(depths / depths[background]) - _NEARER)
    strange = (motion.errors**2 + (np.min(apart, axis=1) / _GAP) ** 2 + (nearer / _GAP) ** 2) / 2
    doubt: Array = _DOUBT * sure * np.exp(-strange)
    return doubt
