"""One rigid motion of the camera past a still scene in layers, from the flows of the parts of a window.

What stands still moves, at the place x of the image, by rotation(x) + rho * translation(x): the rotation and
the direction of the translation are the same for all, the inverse depth rho >= 0 is each part's own.  But for
the rotation, all that stands still goes along the lines through one point of the image, at whatever speed.
One object may do so by chance; that parts of three speeds or more do is likelier to be the camera's doing.

Source: Longuet-Higgins & Prazdny, "The interpretation of a moving retinal image", Proc. R. Soc. B 208, 1980.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["RigidMotion", "doubt_of_layers", "fit_rigid_motion", "layers_of"]

Array = npt.NDArray[np.float64]

_NOISE_PX: Final = 0.7  # of a displacement
_NOISE_SHARE: Final = 0.08  # and this share of it
_TURN_PX: Final = 2.6  # rotation that is expected, as a displacement: with any, all flows could be parallax
_NO_LENGTH: Final = 1e-9
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # of three axes, for a cross product
_TRIED: Final = 6  # parts by which directions are guessed

_LAYER_PX: Final = 1.5  # between layers
_LAYER_SHARE: Final = 0.22  # and this share of their inverse depths
_EXPLAINED: Final = 1.6  # standard deviations
_SLOWEST_PX: Final = 1.2  # of the background: what hardly moves has no direction
_AHEAD: Final = 0.7  # of a unit of translation: surely not to the side
_FILLED: Final = 0.2  # share of the view that layers before the background fill
_MISFIT: Final = 0.8  # from which on nothing is learnt
_NEARER: Final = 0.9  # logarithm of depth against the background's, from which on it is strange
_SPREAD: Final = 0.9  # standard deviation of such logarithms, between layers and beyond that
_DOUBT: Final = 8.0  # logit for every layer beyond the second


@dataclass(frozen=True)
class RigidMotion:
    """A camera's motion over a window, and how it explains p parts.

    Attributes:
        direction: Of the camera's translation, unit vector (3,): right, down, ahead.
        rotation: Of the camera about these axes, as displacements, px: radians times the focal length (3,).
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
    some = np.argsort(-weights, kind="stable")[:_TRIED]
    tried = fit(_directions(places[some].mean(axis=1), flows[some].mean(axis=1), focal_length))
    best = int(tried.misfit.argmin())
    refined = fit(fit.refined(tried.direction[best], tried.rotation[best], tried.robust[best])[None])
    found, best = (refined, 0) if refined.misfit[0] < tried.misfit[best] else (tried, best)
    return RigidMotion(
        found.direction[best],
        found.rotation[best],
        found.depth[best].reshape(parts, samples).mean(axis=1),
        np.sqrt(found.error[best].reshape(parts, samples).mean(axis=1)),
        float(found.misfit[best]),
    )


def _directions(places: Array, flows: Array, focal_length: float) -> Array:
    """Directions (m, 3) by which a part moves if the camera moves to the side, or two parts if ahead."""
    planes = _planes(places / focal_length, flows)
    first, second = (planes[at] for at in np.triu_indices(len(places), 1))
    both = first[:, _NEXT] * second[:, _LAST] - first[:, _LAST] * second[:, _NEXT]
    found = np.concatenate([np.column_stack([-flows, np.zeros(len(flows))]), both])
    length = np.sqrt((found * found).sum(axis=1))
    found = found[length > _NO_LENGTH] / length[length > _NO_LENGTH, None]
    return found if len(found) else np.array([[1.0, 0.0, 0.0]])


def _planes(rays: Array, flows: Array) -> Array:
    """Normals (n, 3) of the planes through the rays (n, 2), at depth 1, and where flows (n, 2) take them."""
    (x, y), (right, down) = rays.T, flows.T
    return np.column_stack([-down, right, x * down - y * right])


@dataclass(frozen=True)
class _Tried:
    """Of m directions and n points."""

    direction: Array  # (m, 3)
    rotation: Array  # (m, 3)
    depth: Array  # (m, n)
    error: Array  # (m, n), squared
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
        self._rays, self._flows = points / focal_length, flows
        self._x, self._y = x, y = self._rays.T
        self._turns = np.array([[x * y, -1 - x * x, y], [1 + y * y, -x * y, -x]]).swapaxes(1, 2)  # (2, n, 3)
        self._weights = weights
        self._noise = np.hypot(_NOISE_PX, _NOISE_SHARE * np.hypot(*flows.T))
        # Rolling turns no place further from the axis than others, by as many px.
        self._calm = np.diag([1.0, 1.0, 0.25]) / _TURN_PX**2

    def __call__(self, directions: Array) -> _Tried:
        """Fit with each of the directions (m, 3), of either sign."""
        right, down, ahead = directions.T[..., None]
        x, y = self._x * ahead - right, self._y * ahead - down  # (m, n)
        reach = np.sqrt(x * x + y * y) + 1e-3
        x, y = x / reach, y / reach
        (flow_x, flow_y), (turn_x, turn_y) = self._flows.T, self._turns
        went_along, went_aside = x * flow_x + y * flow_y, x * flow_y - y * flow_x
        turned_along = x[..., None] * turn_x + y[..., None] * turn_y  # (m, n, 3)
        turned_aside = x[..., None] * turn_y - y[..., None] * turn_x
        scale = np.broadcast_to(self._weights / self._noise**2, x.shape)
        robust = np.ones(1)
        for _ in range(2):
            scaled = turned_aside * (scale * robust)[..., None]
            normal = scaled.transpose(0, 2, 1) @ turned_aside + self._calm
            rotation = np.linalg.solve(normal, scaled.transpose(0, 2, 1) @ went_aside[..., None])
            forth = went_along - (turned_along @ rotation)[..., 0]
            sign = np.where((forth * scale * robust).sum(axis=-1) < 0, -1.0, 1.0)
            forth *= sign[:, None]
            aside, back = went_aside - (turned_aside @ rotation)[..., 0], np.minimum(forth, 0)
            error = (aside * aside + back * back) / self._noise**2
            robust = 1 / (1 + error / 4)
        rotation = rotation[..., 0]
        misfit = np.log1p(error / 4) @ self._weights + 0.5 * ((rotation @ self._calm) * rotation).sum(axis=-1)
        return _Tried(directions * sign[:, None], rotation, forth / reach, error, robust, misfit)

    def refined(self, direction: Array, rotation: Array, robust: Array) -> Array:
        """The direction (3,) nearest to all planes through a ray and where it goes when not turned."""
        planes = _planes(self._rays, self._flows - (self._turns @ rotation).T)
        reach = np.hypot(self._x * direction[2] - direction[0], self._y * direction[2] - direction[1]) + 1e-3
        planes *= (np.sqrt(self._weights * robust) / (self._noise * reach))[:, None]
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
    return np.array([sum(layer) / len(layer) for layer in layers])


def doubt_of_layers(
    motion: RigidMotion, areas: Array, *, clear: npt.NDArray[np.bool_], background: int
) -> Array:
    """Logits (p,) to take from parts that they move, for what the camera's motion explains of them.

    The more layers it explains and the more of the view they fill, the surer; less where a part would be much
    nearer than the background or than any other layer, as objects may seem.

    Args:
        motion: Of the camera.
        areas: Of the parts, shares of the view (p,).
        clear: Which parts are large and firm enough to be a layer by themselves, (p,).
        background: The part that surely stands still.
    """
    nothing = np.zeros(len(areas))
    explained = motion.errors < _EXPLAINED
    if not (explained[background] and motion.depths[background] > _SLOWEST_PX):
        return nothing
    layers = layers_of(motion.depths[explained & clear])
    # Any two parts lie in layers of some motion to the side, any three in layers of one ahead.
    free = 2 + min(1.0, float(motion.direction[2] / _AHEAD) ** 2)
    if len(layers) <= free or motion.misfit >= _MISFIT:
        return nothing
    before = explained & clear & (np.arange(len(areas)) != background)
    filled = min(1.0, float(areas[before].sum()) / _FILLED)
    sure = min(len(layers) - free, 2) * (1 - motion.misfit / _MISFIT) * filled
    depths = np.maximum(motion.depths, _SLOWEST_PX)
    gaps = np.abs(np.log(depths[:, None] / np.maximum(layers, _SLOWEST_PX)))
    own = np.abs(depths[:, None] - layers) <= np.maximum(_LAYER_PX, _LAYER_SHARE * depths[:, None])
    gap = np.where(own, np.inf, gaps).min(axis=1)
    nearer = np.maximum(0, np.log(depths / depths[background]) - _NEARER)
    doubt: Array = _DOUBT * sure * np.exp(-(motion.errors**2 + (gap**2 + nearer**2) / _SPREAD**2) / 2)
    return doubt
