"""The losses, each with the form that emseg recommends and the thesis' own (equations 4.1 to 4.6).

Every part is a mean over pixels, and over the scales of the predictions.  docs/networks.md says what is odd
about the thesis' forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from kornia.metrics import ssim
from torch import Tensor
from torch.nn import functional

from emseg.nets.geometry import (
    Padding,
    inverse_warp,
    moving_probability,
    pixel_pose,
    reference_pose,
    scaled_intrinsics,
)
from emseg.nets.outputs import PoseOutput, depth_at
from emseg.nets.settings import LossSettings, NetworkSettings

__all__ = [
    "Batch",
    "Losses",
    "depth_loss",
    "even_pose_loss",
    "mask_loss",
    "photometric_loss",
    "pose_distance",
    "smoothness_loss",
    "total_loss",
    "total_variation",
]

SSIM_WINDOW = 11  # px; its σ is 1.5
DEPTH_RANGE = (0.1, 7.0)  # m, of true depths that count
UNKNOWN = -1  # in masks


class Batch(NamedTuple):
    """b targets with n references, and what is known of them.

    Attributes:
        target: (b, c, h, w).
        references: (b, n, c, h, w).
        offsets: Of the references' times, in widths of a slice, (b, n).
        K: (b, 3, 3).
        mask: 0 background, 1.. objects, -1 not known; int64 (b, h, w).
        depth: m, (b, h, w); 0 not known.
        poses: True poses of the references in the target's frame, m and rad, (b, n, 6); NaN: not known.
        active: Whether the target has an event there, (b, h, w).
        flow: Over the width of a slice, px, (b, 2, h, w); NaN: not known.
    """

    target: Tensor
    references: Tensor
    offsets: Tensor
    K: Tensor
    mask: Tensor
    depth: Tensor
    poses: Tensor
    active: Tensor
    flow: Tensor


class Losses(NamedTuple):
    """The parts, not yet weighted, and their weighted sum."""

    photometric: Tensor
    mask: Tensor
    smoothness: Tensor
    pose: Tensor
    depth: Tensor
    total: Tensor


def photometric_loss(
    target: Tensor,
    reference: Tensor,
    depth: Tensor,
    pose: Tensor,
    K: Tensor,
    *,
    settings: LossSettings | None = None,
    weight: Tensor | None = None,
) -> Tensor:
    """(4.1) How the reference, warped, differs from the target, over the pixels that both see.

    Args:
        target, reference: (b, c, h, w).
        depth: (b, 1, h, w).
        pose: Of the reference, (b, 6) or (b, 6, h, w).
        K: (b, 3, 3).
        settings: The form, the weight of SSIM and the padding.
        weight: Of the pixels, (b, 1, h, w).
    """
    settings = LossSettings() if settings is None else settings
    padding: Padding = settings.padding
    warped, valid = inverse_warp(reference, depth, pose, K, padding=padding)
    error = (warped - target).abs().mean(1, keepdim=True)
    if settings.ssim and min(target.shape[2:]) >= SSIM_WINDOW:  # (4.2)
        seen = torch.where(valid, warped, target)  # windows reach beyond what both see
        likeness = ssim(seen, target, SSIM_WINDOW).mean(1, keepdim=True)
        counted = likeness if settings.photometric_form == "thesis" else 1 - likeness
        error = error + settings.ssim * counted
    share = valid.to(error.dtype) if weight is None else valid * weight
    return (share * error).sum() / valid.sum().clamp(min=1)


def total_variation(maps: Tensor) -> Tensor:
    """Mean difference of neighbouring pixels of (b, c, h, w)."""
    dx, dy = _gradient(maps)
    return _mean(dx.abs()) + _mean(dy.abs())


def _gradient(maps: Tensor) -> tuple[Tensor, Tensor]:
    return maps[..., :, 1:] - maps[..., :, :-1], maps[..., 1:, :] - maps[..., :-1, :]


def _mean(values: Tensor) -> Tensor:
    """Mean, 0 of nothing: the coarsest maps may be a pixel wide."""
    return values.sum() / max(1, values.numel())


def mask_loss(background: Tensor, mask: Tensor, maps: Tensor, *, settings: LossSettings) -> Tensor:
    """(4.3) The background's share against the true mask, against ones where an image has none.

    Args:
        background: Share 0 .. 1, (b, 1, h, w).
        mask: See :class:`Batch`, (b, h, w).
        maps: All maps, (b, m, h, w), whose total variation is added.
        settings: The form.
    """
    known = mask != UNKNOWN
    without = ~known.flatten(1).any(1)[:, None, None]
    wanted = ((mask == 0) | without).to(background.dtype)
    counted = (known | without).to(background.dtype)
    share = background[:, 0].float().clamp(1e-6, 1 - 1e-6)
    if settings.mask_form == "thesis":
        return (counted * (share - wanted).abs()).sum() / counted.sum().clamp(min=1)
    entropy = -(wanted * share.log() + (1 - wanted) * (1 - share).log())
    return (counted * entropy).sum() / counted.sum().clamp(min=1) + total_variation(maps)


def smoothness_loss(depth: Tensor, *, settings: LossSettings) -> Tensor:
    """(4.4) Mean root of the second derivatives of depths (b, 1, h, w); thesis: gradient over its p-norm."""
    dx, dy = _gradient(depth)
    if settings.smoothness_form == "thesis":
        size = torch.cat([dx.flatten(1), dy.flatten(1)], dim=1).abs() + 1e-12
        p = settings.smoothness_norm
        return (size.mean(1) / size.pow(p).mean(1).pow(1 / p)).mean()
    seconds = (*_gradient(dx), _gradient(dy)[1])
    # The root is steep at zero.
    return torch.stack([_mean((each.abs() + 1e-6).sqrt()) for each in seconds]).mean()


def even_pose_loss(pose: Tensor, ego: Tensor, mask: Tensor) -> Tensor:
    """(4.5, corrected) Poses of pixels should be the camera's on the background, and one on each object.

    Args:
        pose: (b, 6, h, w).
        ego: (b, 6).
        mask: See :class:`Batch`, (b, h, w).
    """
    b, channels = pose.shape[:2]
    labels = int(mask.max()) + 1 if mask.numel() else 0
    loss = total_variation(pose)
    background = (mask == 0)[:, None]
    deviation = (pose - ego[:, :, None, None]).abs()
    loss = loss + (background * deviation).sum() / (channels * background.sum()).clamp(min=1)
    on_object = mask > 0
    if labels > 1 and bool(on_object.any()):
        image = torch.arange(b, device=mask.device)[:, None, None].expand_as(mask)
        of = (image * labels + mask)[on_object]
        poses = pose.permute(0, 2, 3, 1)[on_object]
        sums = poses.new_zeros(b * labels, channels).index_add(0, of, poses)
        counts = torch.bincount(of, minlength=b * labels).clamp(min=1)
        loss = loss + (poses - (sums / counts[:, None])[of]).abs().mean()
    return loss


def pose_distance(poses: Tensor, true: Tensor, depth: Tensor) -> Tensor:
    """(4.5, thesis) Mean L2 distance to true poses (b, n, 6), where they are known.

    True translations, m, are brought to the scale of predictions, at which disparity has a mean of 1: where
    no depth (b, h, w) is known, translations do not count.
    """
    seen = depth > 0
    scale = torch.where(seen, 1 / depth.clamp(min=1e-6), 0).sum((1, 2)) / seen.sum((1, 2)).clamp(min=1)
    scale = scale[:, None, None]
    known = torch.isfinite(true).all(2)
    wanted = torch.nan_to_num(true)
    difference = poses - torch.cat([wanted[..., :3] * scale, wanted[..., 3:]], dim=2)
    translation = difference[..., :3] * (scale > 0)
    squares = translation.square().sum(2) + difference[..., 3:].square().sum(2)
    return (known * (squares + 1e-12).sqrt()).sum() / known.sum().clamp(min=1)


def depth_loss(depth: Tensor, true: Tensor) -> Tensor:
    """Supervised depth: |d - d*| / d* + max(d / d*, d* / d), so at least 1, with the prediction scaled.

    Args:
        depth: Up to scale, (b, 1, h, w); it is given the true mean of its image.
        true: m, (b, h, w); 0.1 to 7 m count.
    """
    counted = (true > DEPTH_RANGE[0]) & (true < DEPTH_RANGE[1])
    if not bool(counted.any()):
        return depth.sum() * 0
    d, wanted = depth[:, 0], torch.where(counted, true, 1)
    scale = (counted * wanted).sum((1, 2)) / (counted * d).sum((1, 2)).clamp(min=1e-6)
    d = d * scale[:, None, None]
    ratio = d / wanted
    error = (ratio - 1).abs() + torch.maximum(ratio, 1 / ratio.clamp(min=1e-6))
    return (counted * error).sum() / counted.sum()


def total_loss(
    disparities: Sequence[Tensor],
    output: PoseOutput,
    batch: Batch,
    network: NetworkSettings,
    settings: LossSettings,
) -> Losses:
    """(4.6) The weighted sum, with the supervised depth that the thesis' figure has, its equation not."""
    levels = [
        _losses_at(level, disparity, output, batch, network, settings)
        for level, disparity in enumerate(disparities)
    ]
    parts = [torch.stack(each).mean() for each in zip(*levels, strict=True)]
    if settings.pose_form == "thesis":
        poses = _reference_poses(output, batch, network)
        parts[3] = pose_distance(poses, batch.poses, batch.depth)
    weights = (settings.photometric, settings.mask, settings.smoothness, settings.pose, settings.depth)
    # A part without weight stays out: 0 times something infinite is no number.
    total = torch.stack(
        [w * part for w, part in zip(weights, parts, strict=True) if w] or [parts[0] * 0]
    ).sum()
    photometric, mask, smoothness, pose, depth = parts
    return Losses(photometric, mask, smoothness, pose, depth, total)


def _reference_poses(output: PoseOutput, batch: Batch, network: NetworkSettings) -> Tensor:
    if network.maps in ("mixture", "pixel_pose"):
        return output.poses * batch.offsets[..., None]
    return output.poses


def _losses_at(
    level: int,
    disparity: Tensor,
    output: PoseOutput,
    batch: Batch,
    network: NetworkSettings,
    settings: LossSettings,
) -> tuple[Tensor, ...]:
    """The five parts at one scale; maps are as large as the disparity there."""
    size = (disparity.shape[2], disparity.shape[3])
    full = (batch.target.shape[2], batch.target.shape[3])
    depth = depth_at(disparity.float())
    K = scaled_intrinsics(batch.K, full, size)
    target = _area(batch.target, size)
    mask = _nearest(batch.mask[:, None].float(), size)[:, 0].long()
    true = _nearest(batch.depth[:, None], size)[:, 0]
    zero = depth.sum() * 0

    photometric = zero
    if settings.photometric:
        explained = output.maps[level] if network.maps == "explainability" else None
        count = batch.references.shape[1]
        for n in range(count):
            photometric = (
                photometric
                + photometric_loss(
                    target,
                    _area(batch.references[:, n], size),
                    depth,
                    reference_pose(output, network, n, batch.offsets, level).float(),
                    K,
                    settings=settings,
                    weight=None if explained is None else explained[:, n : n + 1],
                )
                / count
            )
    masks = zero
    if network.maps in ("mixture", "explainability", "pixel_pose"):
        background = 1 - moving_probability(output, network, depth, K, level)
        masks = mask_loss(background, mask, output.maps[level], settings=settings)
    pose = zero
    if network.maps in ("mixture", "pixel_pose") and settings.pose_form == "corrected":
        pose = even_pose_loss(pixel_pose(output, network, level).float(), output.poses[:, 0].float(), mask)
    # Coarse depth is rougher by nature.
    smoothness = smoothness_loss(depth, settings=settings) / 2**level
    return photometric, masks, smoothness, pose, depth_loss(depth, true)


def _area(images: Tensor, size: tuple[int, int]) -> Tensor:
    return images if images.shape[2:] == size else functional.interpolate(images, size=size, mode="area")


def _nearest(images: Tensor, size: tuple[int, int]) -> Tensor:
    """Masks and depths are not to be mixed with their neighbours'."""
    return (
        images
        if images.shape[2:] == size
        else functional.interpolate(images, size=size, mode="nearest-exact")
    )
