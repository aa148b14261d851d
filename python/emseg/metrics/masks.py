"""Figures of masks: moving pixels of an image, at the pixels with events or at all."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["dice", "filled_hulls", "mask_iou", "moving_pixels", "pixel_accuracy", "point_iou"]

Mask = NDArray[np.bool_]

SPIKEMS_MIN_PIXELS: Final = 30
SPIKEMS_MAX_RATIO: Final = 2.0
SPIKEMS_DILATION: Final = 5  # px, both ways


def mask_iou(truth: ArrayLike, prediction: ArrayLike, *, where: ArrayLike | None = None) -> float:
    """Intersection over union of two masks (h, w): at the pixels `where` (event-masked), or at all (dense).

    NaN where nothing moves in either.
    """
    true, found = _chosen(truth, prediction, where)
    union = np.count_nonzero(true | found)
    return np.count_nonzero(true & found) / union if union else float("nan")


def dice(truth: ArrayLike, prediction: ArrayLike, *, where: ArrayLike | None = None) -> float:
    """Twice the intersection over the sum of the sizes of two masks; NaN where both are empty."""
    true, found = _chosen(truth, prediction, where)
    total = np.count_nonzero(true) + np.count_nonzero(found)
    return 2 * np.count_nonzero(true & found) / total if total else float("nan")


def pixel_accuracy(truth: ArrayLike, prediction: ArrayLike, *, where: ArrayLike | None = None) -> float:
    """Share of the pixels at which two masks agree; NaN without pixels."""
    true, found = _chosen(truth, prediction, where)
    return float(np.mean(true == found)) if true.size else float("nan")


def moving_pixels(x: ArrayLike, y: ArrayLike, moving: ArrayLike, *, shape: tuple[int, int]) -> Mask:
    """The pixels more than half of whose events move, bool (h, w); x, y, moving: (n,)."""
    moving = np.asarray(moving, dtype=bool)
    pixel = np.asarray(y, dtype=np.int64) * shape[1] + np.asarray(x, dtype=np.int64)
    size = shape[0] * shape[1]
    count = np.bincount(pixel, minlength=size)
    found = 2 * np.bincount(pixel[moving], minlength=size) > count
    return np.asarray(found.reshape(shape))


def filled_hulls(x: ArrayLike, y: ArrayLike, labels: ArrayLike, *, shape: tuple[int, int]) -> Mask:
    """The pixels in the convex hull of any label above 0, bool (h, w): how EMSGC makes dense masks of labels.

    Fewer than three pixels, or pixels in a line, fill themselves only.  x, y, labels: (n,).
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    x, y, labels = (np.asarray(column, dtype=np.int64) for column in (x, y, labels))
    mask = np.zeros(shape, dtype=bool)
    for label in np.unique(labels[labels > 0]):
        points = np.unique(np.column_stack([x, y])[labels == label], axis=0)
        mask[points[:, 1], points[:, 0]] = True
        try:
            hull = ConvexHull(points)
        except (QhullError, ValueError):
            continue
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        columns, rows = np.meshgrid(np.arange(left, right + 1), np.arange(top, bottom + 1))
        inside = np.ones(columns.shape, dtype=bool)
        for a, b, c in hull.equations:
            inside &= a * columns + b * rows + c <= 1e-9
        mask[top : bottom + 1, left : right + 1] |= inside
    return mask


def point_iou(
    mask_at_start: ArrayLike, mask_at_end: ArrayLike, x: ArrayLike, y: ArrayLike, moving: ArrayLike
) -> float:
    """IoU of the pixels with moving events, over one interval between two ground-truth masks; SpikeMS's.

    The truth are the pixels with events in the masks' union, dilated by 5x5.  NaN, to be skipped, where a
    mask has fewer than 30 pixels or where the events off the dilated union are more than twice those on it.

    mask_at_start, mask_at_end: (h, w), not 0 where something moves; x, y, moving: (n,), of the interval's
    events.

    Source: Parameshwara, Li, Fermuller, Sanket, Evanusa, Aloimonos, "SpikeMS: Deep spiking neural network for
    motion segmentation", IROS 2021, and its code's evaluation.
    """
    masks = [np.asarray(mask) != 0 for mask in (mask_at_start, mask_at_end)]
    if masks[0].shape != masks[1].shape:
        raise ValueError(f"masks of shapes {masks[0].shape} and {masks[1].shape}; expected one shape")
    if min(np.count_nonzero(mask) for mask in masks) < SPIKEMS_MIN_PIXELS:
        return float("nan")
    union = _dilated(masks[0] | masks[1], SPIKEMS_DILATION // 2)
    x, y = np.asarray(x, dtype=np.int64), np.asarray(y, dtype=np.int64)
    on_object = union[y, x]
    objects = np.count_nonzero(on_object)
    if len(x) - objects > SPIKEMS_MAX_RATIO * objects or not objects:
        return float("nan")
    truth, found = np.zeros_like(union), np.zeros_like(union)
    truth[y[on_object], x[on_object]] = True
    moving = np.asarray(moving, dtype=bool)
    found[y[moving], x[moving]] = True
    return mask_iou(truth, found)


def _chosen(truth: ArrayLike, prediction: ArrayLike, where: ArrayLike | None) -> tuple[Mask, Mask]:
    true, found = np.asarray(truth) != 0, np.asarray(prediction) != 0
    if true.shape != found.shape or true.ndim != 2:
        raise ValueError(f"masks of shapes {true.shape} and {found.shape}; expected (h, w) of both")
    if where is None:
        return true.ravel(), found.ravel()
    chosen = np.asarray(where, dtype=bool)
    if chosen.shape != true.shape:
        raise ValueError(f"pixels to score of shape {chosen.shape}; expected the masks' {true.shape}")
    return true[chosen], found[chosen]


def _dilated(mask: Mask, radius: int) -> Mask:
    height, width = mask.shape
    padded = np.pad(mask, radius)
    grown = np.zeros_like(mask)
    for row in range(2 * radius + 1):
        for column in range(2 * radius + 1):
            grown |= padded[row : row + height, column : column + width]
    return grown
