"""How a segmentation is scored against the truth: one function per figure, independent of the native engine.

Labels are integers per event.  Truth: -1 sensor noise, 0 background, 1 and up true objects.  Prediction: -1
noise, 0 the engine's own background, 1 and up labelled moving.  Every figure is taken over the events that
are not noise in the truth; an event that the prediction calls noise belongs to no label there.  A figure that
is not defined, for lack of anything to score, is NaN: leave it out of an average and say how many were left
out.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Labels = NDArray[np.int64]

MIN_EVENTS = 50  # of a true motion or a label that counts


def evaluate(truth: ArrayLike, prediction: ArrayLike) -> dict[str, float]:
    """All per-event figures of one window, by name, with the counts they rest on.

    truth, prediction: integers (n,).  Raises ValueError where they differ in length or are not integers.
    """
    truth, prediction = _without_noise(truth, prediction)
    return {
        "moving_iou_oracle": event_moving_iou(truth, prediction, background="oracle"),
        "moving_iou_deployed": event_moving_iou(truth, prediction, background="deployed"),
        "object_iou": event_object_iou(truth, prediction),
        "clusters_per_motion": clusters_per_motion(truth, prediction),
        "one_to_one_accuracy": one_to_one_accuracy(truth, prediction),
        "events": float(len(truth)),
        "objects": float(np.count_nonzero(_large(truth) > 0)),
        "labels": float(len(_large(prediction))),
    }


def event_moving_iou(
    truth: ArrayLike, prediction: ArrayLike, *, background: Literal["deployed", "oracle"] = "deployed"
) -> float:
    """Intersection over union of the events labelled moving and the events truly moving.

    background="deployed": label 0 is the background.  "oracle": each label is the background if at least half
    of its events truly are.  NaN where no event moves, neither in truth nor by label.
    """
    truth, prediction = _without_noise(truth, prediction)
    moving = truth > 0
    if background == "deployed":
        labelled_moving = prediction > 0
    elif background == "oracle":
        labelled_moving = np.zeros(len(truth), dtype=bool)
        for label in np.unique(prediction[prediction >= 0]):
            members = prediction == label
            labelled_moving[members] = np.count_nonzero(moving[members]) * 2 > np.count_nonzero(members)
    else:
        raise ValueError(f"background {background!r}; expected 'deployed' or 'oracle'")
    union = np.count_nonzero(moving | labelled_moving)
    return np.count_nonzero(moving & labelled_moving) / union if union else float("nan")


def event_object_iou(truth: ArrayLike, prediction: ArrayLike, *, min_events: int = MIN_EVENTS) -> float:
    """Mean over the true objects of at least min_events events of the IoU with the label matched to each.

    Labels are matched one to one so that the IoUs add up to the most; the true background takes part in the
    matching, so that an object cannot have the label that is the background's.  An object left without a
    label scores 0.  NaN without objects.
    """
    truth, prediction = _without_noise(truth, prediction)
    objects = [int(motion) for motion in _large(truth, min_events) if motion > 0]
    if not objects:
        return float("nan")
    motions = [*([0] if (truth == 0).any() else []), *objects]
    shared, motion_sizes, label_sizes = _overlaps(truth, prediction, motions)
    iou = shared / (motion_sizes[:, None] + label_sizes - shared)
    rows, columns = _one_to_one(iou)
    matched = dict(zip(rows.tolist(), iou[rows, columns].tolist(), strict=True))
    return float(np.mean([matched.get(motions.index(motion), 0.0) for motion in objects]))


def clusters_per_motion(truth: ArrayLike, prediction: ArrayLike, *, min_events: int = MIN_EVENTS) -> float:
    """Labels of at least min_events events over true motions, the background among them, of as many; 1 is
    right.

    NaN without such a motion.
    """
    truth, prediction = _without_noise(truth, prediction)
    motions = len(_large(truth, min_events))
    return len(_large(prediction, min_events)) / motions if motions else float("nan")


def one_to_one_accuracy(truth: ArrayLike, prediction: ArrayLike) -> float:
    """Share of the events whose label is the one matched to their true motion.

    Labels are matched one to one so that the share is largest: what is split off a motion counts as wrong.
    NaN without events.
    """
    truth, prediction = _without_noise(truth, prediction)
    if len(truth) == 0:
        return float("nan")
    shared, _, _ = _overlaps(truth, prediction, np.unique(truth).tolist())
    rows, columns = _one_to_one(shared)
    return float(shared[rows, columns].sum() / len(truth))


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


def _without_noise(truth: ArrayLike, prediction: ArrayLike) -> tuple[Labels, Labels]:
    truth, prediction = np.asarray(truth), np.asarray(prediction)
    for name, labels in (("truth", truth), ("prediction", prediction)):
        if labels.ndim != 1 or (labels.size and labels.dtype.kind not in "iu"):
            raise ValueError(
                f"{name} of shape {labels.shape} and type {labels.dtype}; expected integers, one per event"
            )
    if len(truth) != len(prediction):
        raise ValueError(
            f"{len(truth)} true and {len(prediction)} predicted labels; expected as many of both"
        )
    kept = truth >= 0
    return truth[kept].astype(np.int64), prediction[kept].astype(np.int64)


def _large(labels: Labels, min_events: int = MIN_EVENTS) -> Labels:
    """Labels 0 and up that hold at least min_events events."""
    values, counts = np.unique(labels[labels >= 0], return_counts=True)
    return values[counts >= min_events]


def _overlaps(
    truth: Labels, prediction: Labels, motions: list[int]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Events shared by each motion and each label (motions, labels), and the events of either."""
    labels = np.unique(prediction[prediction >= 0])
    in_motion = np.stack([truth == motion for motion in motions]).astype(np.float64)
    in_label = (prediction[None] == labels[:, None]).astype(np.float64)
    return in_motion @ in_label.T, in_motion.sum(axis=1), in_label.sum(axis=1)


def _one_to_one(gain: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the assignment with the largest total gain."""
    from scipy.optimize import linear_sum_assignment  # slow to import, and few commands score anything

    rows, columns = linear_sum_assignment(gain, maximize=True)
    return rows, columns


def _boxes(boxes: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(boxes, dtype=np.float64).reshape(-1, 4) if np.size(boxes) else np.empty((0, 4))
    if not np.isfinite(array).all() or (array[:, 2:] < 0).any():
        raise ValueError("boxes; expected finite rows x, y, w, h with w, h >= 0")
    return array
