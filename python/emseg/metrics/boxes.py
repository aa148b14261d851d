"""Figures of boxes: what is detected, by the criterion of the EED data set."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emseg.metrics.events import MIN_EVENTS

__all__ = ["detected_boxes", "detection_rate", "object_boxes"]

NEAREST_SHARE: Final = 0.25
"""Share of an object's events, nearest in time to the reference, that its true box holds."""


def detected_boxes(truth: ArrayLike, detections: ArrayLike) -> NDArray[np.bool_]:
    """Which of the true boxes (n, 4) of a frame some detection (m, 4) finds, bool (n,); boxes are x, y, w, h
    in px.

    A detection D finds a box G if area(D and G) > 0.5 area(G) and area(D and G) > area(D outside G): the
    criterion of the EED data set (Mitrokhin, Fermuller, Parameshwara, Aloimonos, IROS 2018).  The detection
    rate is the mean of this over all boxes of all frames.
    """
    g, d = _boxes(truth)[:, None], _boxes(detections)[None]
    overlap_size = np.minimum(g[..., :2] + g[..., 2:], d[..., :2] + d[..., 2:]) - np.maximum(
        g[..., :2], d[..., :2]
    )
    shared = np.maximum(overlap_size, 0).prod(axis=-1)
    found = (shared > 0.5 * g[..., 2:].prod(axis=-1)) & (shared > d[..., 2:].prod(axis=-1) - shared)
    return np.asarray(found.any(axis=1))


def detection_rate(frames: Iterable[tuple[ArrayLike, ArrayLike]]) -> float:
    """Share of the true boxes of all frames that are found; frames are pairs (true boxes, detections).

    Boxes are counted, not frames.  NaN where no frame has a true box.
    """
    found = [detected_boxes(truth, detections) for truth, detections in frames]
    return float(np.concatenate(found).mean()) if sum(map(len, found)) else float("nan")


def object_boxes(
    x: ArrayLike, y: ArrayLike, t: ArrayLike, truth: ArrayLike, t_ref: float, *, min_events: int = MIN_EVENTS
) -> dict[int, NDArray[np.float64]]:
    """True boxes (x, y, w, h) at t_ref, px, from the events' owners, by object of min_events events or more.

    An object moves while its events come in, so that a box about all of them would be too large.  Its box
    holds the quarter of its events that is nearest in time to t_ref, but at least min_events, and of them all
    but the outermost hundredth on each side.  x, y, t, truth: (n,); t and t_ref in one unit.
    """
    x, y, t, truth = (np.asarray(column) for column in (x, y, t, truth))
    boxes = {}
    for number in np.unique(truth[truth > 0]):
        own = np.flatnonzero(truth == number)
        if len(own) < min_events:
            continue
        nearest = np.argsort(np.abs(t[own] - t_ref), kind="stable")
        own = own[nearest[: max(min_events, round(NEAREST_SHARE * len(own)))]]
        low, high = np.quantile(np.column_stack([x[own], y[own]]), (0.01, 0.99), axis=0)
        boxes[int(number)] = np.concatenate([low, high - low + 1])
    return boxes


def _boxes(boxes: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(boxes, dtype=np.float64).reshape(-1, 4) if np.size(boxes) else np.empty((0, 4))
    if not np.isfinite(array).all() or (array[:, 2:] < 0).any():
        raise ValueError("boxes; expected finite rows x, y, w, h with w, h >= 0")
    return array
