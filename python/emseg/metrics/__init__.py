"""How results are scored against the truth: one function per figure, independent of the native engine.

`events`: labels per event.  `boxes`: detections.  `tracks`: identities through a recording.  `masks`:
moving pixels of an image.  `fields`: depth and flow.  A figure that is not defined, for lack of anything to
score, is NaN: leave it out of an average and say how many were left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from emseg.metrics.boxes import detected_boxes, detection_rate, object_boxes
from emseg.metrics.events import (
    clusters_per_motion,
    event_figures,
    event_moving_iou,
    event_object_iou,
    matched_labels,
    one_to_one_accuracy,
    without_noise,
)
from emseg.metrics.fields import depth_figures, flow_figures
from emseg.metrics.masks import dice, filled_hulls, mask_iou, moving_pixels, pixel_accuracy, point_iou
from emseg.metrics.tracks import Identities, identity_switches

__all__ = [
    "Identities",
    "clusters_per_motion",
    "depth_figures",
    "detected_boxes",
    "detection_rate",
    "dice",
    "evaluate",
    "event_figures",
    "event_moving_iou",
    "event_object_iou",
    "filled_hulls",
    "flow_figures",
    "identity_switches",
    "mask_iou",
    "matched_labels",
    "moving_pixels",
    "object_boxes",
    "one_to_one_accuracy",
    "pixel_accuracy",
    "point_iou",
]


def evaluate(
    truth: ArrayLike,
    prediction: ArrayLike,
    *,
    pixels: ArrayLike | None = None,
    boxes: tuple[ArrayLike, ArrayLike] | None = None,
) -> dict[str, float]:
    """All figures of one window, by name, with the counts they rest on.

    Args:
        truth: Integers (n,): -1 noise, 0 background, 1.. objects.
        prediction: Integers (n,): -1 noise, 0 background, 1.. labelled moving.
        pixels: Pixel (x, y) of each event, (n, 2); with it the figures of the event-masked moving mask are
            given too: a pixel moves, in truth or by label, if most of its events do.
        boxes: True boxes (m, 4) and detections (k, 4) x, y, w, h; with them the share detected is given too.

    Raises:
        ValueError: lengths differ, or labels are not integers.
    """
    figures = event_figures(truth, prediction)
    if pixels is not None:
        place = np.asarray(pixels)
        labels = np.asarray(truth), np.asarray(prediction)
        if place.shape != (len(labels[0]), 2):
            raise ValueError(f"pixels of shape {place.shape}; expected ({len(labels[0])}, 2), one an event")
        place = place[labels[0] >= 0]
        kept_truth, kept_prediction = without_noise(*labels)
        shape = (int(place[:, 1].max()) + 1, int(place[:, 0].max()) + 1) if len(place) else (1, 1)
        true_mask = moving_pixels(place[:, 0], place[:, 1], kept_truth > 0, shape=shape)
        mask = moving_pixels(place[:, 0], place[:, 1], kept_prediction > 0, shape=shape)
        where = np.zeros(shape, dtype=bool)
        where[place[:, 1], place[:, 0]] = True
        figures |= {
            "mask_iou_event_masked": mask_iou(true_mask, mask, where=where),
            "dice": dice(true_mask, mask, where=where),
            "pixel_accuracy": pixel_accuracy(true_mask, mask, where=where),
        }
    if boxes is not None:
        figures["detection_rate"] = detection_rate([boxes])
    return figures
