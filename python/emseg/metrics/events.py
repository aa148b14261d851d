"""Figures per event: labels against true motions.

Labels are integers per event.  Truth: -1 sensor noise, 0 background, 1 and up true objects.  Prediction: -1
noise, 0 the engine's own background, 1 and up labelled moving.  Every figure is taken over the events that
are not noise in the truth; an event that the prediction calls noise belongs to no label there.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "MIN_EVENTS",
    "clusters_per_motion",
    "event_figures",
    "event_moving_iou",
    "event_object_iou",
    "large_labels",
    "matched_labels",
    "one_to_one_accuracy",
    "without_noise",
]

Labels = NDArray[np.int64]

MIN_EVENTS: Final = 50
"""Events of a true motion or a label that counts."""


def event_figures(truth: ArrayLike, prediction: ArrayLike) -> dict[str, float]:
    """All per-event figures of one window, by name, with the counts they rest on.

    truth, prediction: integers (n,).  Raises ValueError where they differ in length or are not integers.
    """
    truth, prediction = without_noise(truth, prediction)
    return {
        "moving_iou_oracle": event_moving_iou(truth, prediction, background="oracle"),
        "moving_iou_deployed": event_moving_iou(truth, prediction, background="deployed"),
        "object_iou": event_object_iou(truth, prediction),
        "clusters_per_motion": clusters_per_motion(truth, prediction),
        "one_to_one_accuracy": one_to_one_accuracy(truth, prediction),
        "events": float(len(truth)),
        "object_events": float(np.count_nonzero(truth > 0)),
        "objects": float(np.count_nonzero(large_labels(truth) > 0)),
        "labels": float(len(large_labels(prediction))),
    }


def event_moving_iou(
    truth: ArrayLike, prediction: ArrayLike, *, background: Literal["deployed", "oracle"] = "deployed"
) -> float:
    """Intersection over union of the events labelled moving and the events truly moving.

    background="deployed": label 0 is the background.  "oracle": each label is the background if at least half
    of its events truly are.  NaN where no event moves, neither in truth nor by label.
    """
    truth, prediction = without_noise(truth, prediction)
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
    matched = matched_labels(truth, prediction, min_events=min_events)
    return float(np.mean([iou for _, iou, _ in matched.values()])) if matched else float("nan")


def matched_labels(
    truth: ArrayLike, prediction: ArrayLike, *, min_events: int = MIN_EVENTS
) -> dict[int, tuple[int, float, int]]:
    """The label of each true object of at least min_events events, their IoU and the events they share.

    Matched one to one as :func:`event_object_iou` says.  An object without a label has label -1, IoU 0 and no
    events.
    """
    truth, prediction = without_noise(truth, prediction)
    objects = [int(motion) for motion in large_labels(truth, min_events) if motion > 0]
    motions = [*([0] if (truth == 0).any() else []), *objects]
    if not objects:
        return {}
    labels = np.unique(prediction[prediction >= 0])
    shared, motion_sizes, label_sizes = _overlaps(truth, prediction, motions)
    iou = shared / (motion_sizes[:, None] + label_sizes - shared)
    found = {
        motions[row]: (int(labels[column]), float(iou[row, column]), int(shared[row, column]))
        for row, column in zip(*(index.tolist() for index in _one_to_one(iou)), strict=True)
        if shared[row, column]
    }
    return {motion: found.get(motion, (-1, 0.0, 0)) for motion in objects}


def clusters_per_motion(truth: ArrayLike, prediction: ArrayLike, *, min_events: int = MIN_EVENTS) -> float:
    """Labels of at least min_events events over true motions, the background among them, of as many; 1 is
    right.

    NaN without such a motion.
    """
    truth, prediction = without_noise(truth, prediction)
    motions = len(large_labels(truth, min_events))
    return len(large_labels(prediction, min_events)) / motions if motions else float("nan")


def one_to_one_accuracy(truth: ArrayLike, prediction: ArrayLike) -> float:
    """Share of the events whose label is the one matched to their true motion.

    Labels are matched one to one so that the share is largest: what is split off a motion counts as wrong.
    NaN without events.
    """
    truth, prediction = without_noise(truth, prediction)
    if len(truth) == 0:
        return float("nan")
    shared, _, _ = _overlaps(truth, prediction, np.unique(truth).tolist())
    rows, columns = _one_to_one(shared)
    return float(shared[rows, columns].sum() / len(truth))


def without_noise(truth: ArrayLike, prediction: ArrayLike) -> tuple[Labels, Labels]:
    """Both without the events that are noise in the truth; ValueError where they do not fit."""
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


def large_labels(labels: Labels, min_events: int = MIN_EVENTS) -> Labels:
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
