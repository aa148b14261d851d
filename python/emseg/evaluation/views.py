"""Pictures of the best and the worst windows: truth beside labels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.datasets import LabelledRecording
from emseg.evaluation.protocols import event_truth
from emseg.evaluation.segmented import SegmentedRecording, SegmentedWindow
from emseg.metrics import detected_boxes, event_figures, object_boxes
from emseg.render import BOX_DTYPE, Picture, label_picture, polarity_picture, side_by_side

__all__ = ["View", "extreme_views"]

LONGER_SIDE: Final = 480
"""px of each half of a picture."""
SMALL: Final = 200


@dataclass(frozen=True)
class View:
    """A window's picture, with its score (NaN without truth) and what the score is."""

    recording: str
    score: float
    caption: str
    picture: Picture


def extreme_views(recording: LabelledRecording, found: SegmentedRecording, *, count: int = 2) -> list[View]:
    """Pictures of a recording's worst and best windows, `count` of each at most, the worst first.

    Scored by the mean of moving and object IoU, or by the share of annotated boxes that is found; without
    such a truth, the windows with most and fewest events in moving labels are shown, those with most first.
    """
    truth = event_truth(recording)
    scored = [(_score(recording, found, window, truth), window) for window in found.windows]
    if any(score == score for score, _ in scored):
        ranked = sorted((pair for pair in scored if pair[0] == pair[0]), key=lambda pair: pair[0])
    else:
        ranked = sorted(scored, key=lambda pair: -_moving_share(found, pair[1]))
    chosen = [*ranked[:count], *ranked[max(count, len(ranked) - count) :]]
    return [_draw(recording, found, window, truth, score) for score, window in chosen]


def _score(
    recording: LabelledRecording,
    found: SegmentedRecording,
    window: SegmentedWindow,
    truth: npt.NDArray[np.int64] | None,
) -> float:
    part = slice(window.start, window.stop)
    if truth is not None and recording.truth.scene != "still":
        figures = event_figures(truth[part], found.labels[part])
        if figures["object_events"] < SMALL:
            return float("nan")
        known = [figures[name] for name in ("moving_iou_deployed", "object_iou")]
        return float(np.nanmean(known)) if np.isfinite(known).any() else float("nan")
    if recording.truth.scene == "still":
        return 1 - _moving_share(found, window)
    boxes = _boxes_of(recording, window)
    if not len(boxes):
        return float("nan")
    own = recording.events[part]
    detections = list(object_boxes(own.x, own.y, own.t, found.labels[part], window.t_ref).values())
    return float(detected_boxes(boxes, detections).mean())


def _moving_share(found: SegmentedRecording, window: SegmentedWindow) -> float:
    return float(np.mean(found.labels[window.start : window.stop] > 0))


def _boxes_of(recording: LabelledRecording, window: SegmentedWindow) -> npt.NDArray[np.float64]:
    """The annotated boxes nearest in time to the window's middle, of those in the window."""
    track, events = recording.truth.boxes, recording.events
    if track is None:
        return np.empty((0, 4))
    inside = (track.t >= events.t[window.start]) & (track.t <= events.t[window.stop - 1])
    if not inside.any():
        return np.empty((0, 4))
    t = track.t[inside]
    nearest = t[np.abs(t - window.t_ref).argmin()]
    return np.asarray(track.boxes[track.t == nearest])


def _draw(
    recording: LabelledRecording,
    found: SegmentedRecording,
    window: SegmentedWindow,
    truth: npt.NDArray[np.int64] | None,
    score: float,
) -> View:
    part = slice(window.start, window.stop)
    events = recording.events[part]
    scale = max(1, round(LONGER_SIDE / max(events.width, events.height)))
    since = 1e-3 * (int(events.t[0]) - int(recording.events.t[0]))
    span = f"{since:.0f} to {since + 1e-3 * events.duration:.0f} ms"
    boxes = [(k + 1, *box) for k, box in enumerate(_boxes_of(recording, window).tolist())]
    true_boxes: npt.NDArray[Any] = np.array(boxes, BOX_DTYPE)
    if truth is not None:
        left = label_picture(events, truth[part], boxes=true_boxes, caption=f"truth, {span}", scale=scale)
    elif len(true_boxes):
        unlabelled = np.zeros(len(events), np.int64)
        left = label_picture(events, unlabelled, boxes=true_boxes, caption=f"boxes, {span}", scale=scale)
    else:
        left = polarity_picture(events, caption=f"events, {span}", scale=scale)
    text = "no truth" if score != score else f"score {score:.2f}"
    right = label_picture(events, found.labels[part], boxes=window.boxes, caption=text, scale=scale)
    return View(recording.name, score, f"{recording.name}, {span}: {text}", side_by_side(left, right))
