"""Depth and motion to flow, warped images and masks.

Pixels are (x, y), centres at whole numbers; K (b, 3, 3) is a pinhole's.  A pose (tx, ty, tz, rx, ry, rz) says
where the camera of another moment stands in the target's frame; r is a rotation vector.
"""

from __future__ import annotations

from typing import Literal

import torch
from kornia.geometry.transform import remap
from torch import Tensor

from emseg.nets.outputs import PoseOutput
from emseg.nets.settings import NetworkSettings

__all__ = [
    "Padding",
    "ego_pose",
    "instances",
    "instantaneous_flow",
    "inverse_warp",
    "moving_probability",
    "pixel_grid",
    "pixel_pose",
    "reference_pose",
    "rigid_flow",
    "scaled_intrinsics",
]

Padding = Literal["zeros", "border"]

LEAST_DEPTH = 1e-3  # in front of the camera


def pixel_grid(like: Tensor) -> Tensor:
    """Coordinates x, y of the pixels of (…, h, w), as (1, 2, h, w)."""
    h, w = like.shape[-2:]
    y, x = torch.meshgrid(
        torch.arange(h, device=like.device, dtype=torch.float32),
        torch.arange(w, device=like.device, dtype=torch.float32),
        indexing="ij",
    )
    return torch.stack([x, y])[None]


def scaled_intrinsics(K: Tensor, size: tuple[int, int], scaled: tuple[int, int]) -> Tensor:
    """K of images of a size (h, w) for the same images at another."""
    sy, sx = scaled[0] / size[0], scaled[1] / size[1]
    factor = K.new_tensor([[sx, sx, sx], [sy, sy, sy], [1, 1, 1]])
    # Centres of pixels are at whole numbers, corners at halves.
    shift = K.new_tensor([[0, 0, (sx - 1) / 2], [0, 0, (sy - 1) / 2], [0, 0, 0]])
    return K * factor + shift


def _normalised(K: Tensor, like: Tensor) -> tuple[Tensor, Tensor]:
    """Image coordinates of the pixels at depth 1, (b, h, w) each."""
    grid = pixel_grid(like)
    x = (grid[:, 0] - K[:, 0, 2, None, None]) / K[:, 0, 0, None, None]
    y = (grid[:, 1] - K[:, 1, 2, None, None]) / K[:, 1, 1, None, None]
    return x, y


def _as_map(pose: Tensor) -> Tensor:
    return pose if pose.dim() == 4 else pose[:, :, None, None]


def _in_other_camera(points: Tensor, pose: Tensor) -> Tensor:
    """Points (b, 3, h, w) of the target's frame in the frame of the camera at a pose: Rᵀ (X - t)."""
    moved = points - pose[:, :3]
    axis = -pose[:, 3:]
    angle = (axis.square().sum(1, keepdim=True) + 1e-16).sqrt()  # smooth where there is no rotation
    axis = axis.expand_as(moved)
    first = torch.linalg.cross(axis, moved, dim=1)
    second = torch.linalg.cross(axis, first, dim=1)
    turned: Tensor = (
        moved + torch.sin(angle) / angle * first + 2 * (torch.sin(angle / 2) / angle).square() * second
    )
    return turned


def _projected(depth: Tensor, pose: Tensor, K: Tensor) -> tuple[Tensor, Tensor]:
    """Where the pixels' points are seen from a pose: (b, 2, h, w), and whether they lie before it."""
    x, y = _normalised(K, depth)
    points = torch.stack([x, y, torch.ones_like(x)], dim=1) * depth
    points = _in_other_camera(points, _as_map(pose))
    ahead = points[:, 2:] > LEAST_DEPTH
    plane = points[:, :2] / points[:, 2:].clamp(min=LEAST_DEPTH)
    focal = torch.stack([K[:, 0, 0], K[:, 1, 1]], dim=1)[..., None, None]
    centre = K[:, :2, 2, None, None]
    return focal * plane + centre, ahead


def rigid_flow(depth: Tensor, pose: Tensor, K: Tensor) -> Tensor:
    """How far each pixel's point moves in the image, px (b, 2, h, w), as the camera goes to a pose.

    Args:
        depth: (b, 1, h, w).
        pose: One for the image (b, 6), or one a pixel (b, 6, h, w).
        K: (b, 3, 3).
    """
    seen, _ = _projected(depth, pose, K)
    return seen - pixel_grid(depth)


def instantaneous_flow(depth: Tensor, pose: Tensor, K: Tensor) -> Tensor:
    """The same to first order in the pose (Longuet-Higgins and Prazdny, 1980)."""
    pose = _as_map(pose).expand(-1, -1, *depth.shape[2:])
    x, y = _normalised(K, depth)
    tx, ty, tz, rx, ry, rz = pose.unbind(1)
    z = depth[:, 0]
    u = (-tx + x * tz) / z + x * y * rx - (1 + x.square()) * ry + y * rz
    v = (-ty + y * tz) / z + (1 + y.square()) * rx - x * y * ry - x * rz
    return torch.stack([K[:, 0, 0, None, None] * u, K[:, 1, 1, None, None] * v], dim=1)


def inverse_warp(
    image: Tensor, depth: Tensor, pose: Tensor, K: Tensor, *, padding: Padding = "zeros"
) -> tuple[Tensor, Tensor]:
    """The other camera's image (b, c, h, w) as the target would see it.

    Args:
        image: Seen from the pose.
        depth: Of the target, (b, 1, h, w).
        pose: Of the other camera, one (b, 6) or one a pixel (b, 6, h, w).
        K: (b, 3, 3), of both.
        padding: What there is beyond the image.

    Returns:
        The warped image, and (b, 1, h, w) whether the pixel's point is in the image and before the camera.
    """
    seen, ahead = _projected(depth, pose, K)
    h, w = image.shape[2:]
    warped = remap(image, seen[:, 0], seen[:, 1], padding_mode=padding, align_corners=True)
    inside = (seen >= 0).all(1, keepdim=True) & (seen[:, :1] <= w - 1) & (seen[:, 1:] <= h - 1)
    return warped, inside & ahead


def pixel_pose(output: PoseOutput, settings: NetworkSettings, level: int = 0) -> Tensor:
    """The pose of every pixel over the width of a slice, (b, 6, h, w), of a mixture or pixel poses.

    Raises:
        ValueError: a network that has only one for the whole image.
    """
    match settings.maps:
        case "mixture":
            return torch.einsum("bkhw,bkc->bchw", output.maps[level], output.components)
        case "pixel_pose":
            return output.maps[level] + output.poses[:, 0, :, None, None]
        case _:
            raise ValueError(f"maps are {settings.maps}, expected mixture or pixel_pose: no poses of pixels")


def ego_pose(output: PoseOutput, settings: NetworkSettings, offsets: Tensor) -> Tensor:
    """The camera's own motion over the width of a slice, (b, 6); offsets (b, n) are in such widths."""
    if settings.maps in ("mixture", "pixel_pose"):
        return output.poses[:, 0]
    return (output.poses / offsets[..., None]).mean(1)


def reference_pose(
    output: PoseOutput, settings: NetworkSettings, reference: int, offsets: Tensor, level: int = 0
) -> Tensor:
    """The pose of a reference, (b, 6) or a pixel each (b, 6, h, w)."""
    if settings.maps in ("mixture", "pixel_pose"):  # a steady motion
        return pixel_pose(output, settings, level) * offsets[:, reference, None, None, None]
    return output.poses[:, reference]


def moving_probability(
    output: PoseOutput, settings: NetworkSettings, depth: Tensor, K: Tensor, level: int = 0
) -> Tensor:
    """How surely a pixel moves on its own, 0 .. 1, (b, 1, h, w).

    Mixtures tell it by the camera's share, explainability by what is left of it; pixel poses by the flow that
    they add to the camera's: 1 - exp(-|that| / px).

    Raises:
        ValueError: a network without such maps.
    """
    match settings.maps:
        case "mixture":
            return 1 - output.maps[level][:, :1]
        case "explainability":
            return 1 - output.maps[level].mean(1, keepdim=True)
        case "pixel_pose":
            each = instantaneous_flow(depth, pixel_pose(output, settings, level), K)
            ego = instantaneous_flow(depth, output.poses[:, 0], K)
            return 1 - torch.exp(-(each - ego).square().sum(1, keepdim=True).add(1e-12).sqrt())
        case _:
            raise ValueError(
                f"maps are {settings.maps}, expected mixture, explainability or pixel_pose: no masks"
            )


def instances(output: PoseOutput, settings: NetworkSettings, moving: Tensor, *, threshold: float) -> Tensor:
    """Label of each pixel, (b, h, w): 0 background, else its greatest component, or 1 without a mixture.

    Args:
        output: Of the pose network.
        settings: Its settings.
        moving: See :func:`moving_probability`, (b, 1, h, w).
        threshold: Probability from which a pixel counts as moving.
    """
    moves = moving[:, 0] > threshold
    if settings.maps != "mixture":
        return moves.long()
    return torch.where(moves, output.maps[0][:, 1:].argmax(1) + 1, 0)
