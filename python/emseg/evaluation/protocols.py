"""The protocols by which a segmented recording is scored, each where the truth that it needs is known.

A figure is a list of values, one per window, frame, interval, box or object; NaN where it is not defined,
which is counted as skipped.  Figures of different protocols must never be compared.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.datasets import ImageTrack, LabelledRecording
from emseg.evaluation.segmented import SegmentedRecording
from emseg.events import EventArray
from emseg.metrics import (
    Identities,
    detected_boxes,
    dice,
    event_figures,
    filled_hulls,
    flow_figures,
    mask_iou,
    moving_pixels,
    object_boxes,
    pixel_accuracy,
    point_iou,
)
from emseg.motion import MotionModel, warp

__all__ = ["PROTOCOLS", "Figure", "Protocol", "event_truth", "score_recording"]

SMALL: Final = 200
"""Events of objects below which a window is not scored by its objects."""
FRAME_US: Final = 25_000
"""Between frames that are scored, µs: 40 Hz; a frame has the events of the 25 ms about it."""
NEAREST_MASK_US: Final = 25_000
"""How far in time the mask may be that an event takes its truth from, µs."""

Labels = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Figure:
    """One figure of one recording by one protocol: a value per item, NaN where the item is skipped."""

    protocol: str
    name: str
    values: tuple[float, ...]


Score = Callable[[LabelledRecording, SegmentedRecording], list[Figure]]


@dataclass(frozen=True)
class Protocol:
    """How figures come about; `item` is what has a value each."""

    name: str
    title: str
    item: str


def score_recording(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    """The figures of every protocol that the recording's truth allows."""
    return [figure for score in _SCORES for figure in score(recording, found)]


def event_truth(recording: LabelledRecording) -> Labels | None:
    """The true label of every event, (n,), -1 where it is noise or not known; None where there is no truth.

    Where there are only masks, an event takes that of its pixel in the mask nearest in time, up to 25 ms off.
    """
    if recording.truth.labels is not None:
        return recording.truth.labels
    masks = recording.truth.masks
    if masks is None or not len(masks):
        return None
    events = recording.events
    labels = np.full(len(events), -1, np.int64)
    middles = (masks.t[1:] + masks.t[:-1]) // 2
    starts = np.maximum(masks.t - NEAREST_MASK_US, np.concatenate([masks.t[:1] - NEAREST_MASK_US, middles]))
    stops = np.minimum(masks.t + NEAREST_MASK_US, np.concatenate([middles, masks.t[-1:] + NEAREST_MASK_US]))
    for k, (first, last) in enumerate(np.searchsorted(events.t, np.stack([starts, stops], 1)).tolist()):
        if first < last:
            labels[first:last] = _mask(recording, k)[events.y[first:last], events.x[first:last]]
    return labels


def _mask(recording: LabelledRecording, k: int) -> npt.NDArray[Any]:
    """The k-th mask, which must be as large as the sensor."""
    assert recording.truth.masks is not None
    mask, size = recording.truth.masks[k], (recording.events.height, recording.events.width)
    if mask.shape != size:
        raise ValueError(f"{recording.name}: mask {k} has shape {mask.shape}, expected the sensor's {size}")
    return mask


# --- labels per event --------------------------------------------------------------------------------------

EVENT_FIGURES: Final = {
    "moving_iou_deployed": "moving IoU",
    "moving_iou_oracle": "moving IoU, oracle",
    "object_iou": "object IoU",
    "clusters_per_motion": "clusters per motion",
    "one_to_one_accuracy": "one-to-one accuracy",
}


def _score_events(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    truth = event_truth(recording)
    if truth is None or recording.truth.scene == "still":
        return []
    values: dict[str, list[float]] = {name: [] for name in EVENT_FIGURES}
    identities = Identities()
    for window in found.windows:
        part = slice(window.start, window.stop)
        identities.add(truth[part], found.labels[part])
        figures = event_figures(truth[part], found.labels[part])
        small = figures["object_events"] < SMALL
        for name, column in values.items():
            column.append(float("nan") if small else figures[name])
    rows = [Figure("events", title, tuple(values[name])) for name, title in EVENT_FIGURES.items()]
    switches = tuple(float(count) for count in identities.switches.values())
    return [*rows, Figure("tracks", "identity switches", switches)]


def _score_owner_boxes(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    if recording.truth.labels is None or recording.truth.scene == "still":
        return []
    events, values = recording.events, []
    for window in found.windows:
        part = slice(window.start, window.stop)
        truth = recording.truth.labels[part]
        if np.count_nonzero(truth > 0) < SMALL:
            continue
        own = events[part]
        true_boxes = object_boxes(own.x, own.y, own.t, truth, window.t_ref)
        boxes = np.array([[box[corner] for corner in ("x", "y", "w", "h")] for box in window.boxes])
        values += detected_boxes(list(true_boxes.values()), boxes).astype(float).tolist()
    return [Figure("owner boxes", "detection rate", tuple(values))]


def _score_still(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    if recording.truth.scene != "still":
        return []
    shares = [float(np.mean(found.labels[window.start : window.stop] > 0)) for window in found.windows]
    return [Figure("still", "events in moving labels", tuple(shares))]


def _score_labels(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    used = [len(window.models) for window in found.windows]
    moving = [float(np.mean(found.labels[window.start : window.stop] > 0)) for window in found.windows]
    return [
        Figure("labels", "labels in a window", tuple(map(float, used))),
        Figure("labels", "events in moving labels", tuple(moving)),
    ]


# --- boxes -------------------------------------------------------------------------------------------------


def _score_boxes(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    track = recording.truth.boxes
    if track is None:
        return []
    events, values = recording.events, []
    for t in np.unique(track.t).tolist():
        true_boxes = track.boxes[track.t == t]
        window = _window_at(recording.events, found, t)
        if window is None:
            values += [float("nan")] * len(true_boxes)
            continue
        part = slice(window.start, window.stop)
        own = events[part]
        boxes = object_boxes(own.x, own.y, own.t, found.labels[part], t)
        values += detected_boxes(true_boxes, list(boxes.values())).astype(float).tolist()
    return [Figure("eed", "detection rate", tuple(values))]


def _window_at(events: EventArray, found: SegmentedRecording, t: int) -> Any:
    """The window that spans a moment, or None."""
    starts = np.array([window.start for window in found.windows], dtype=np.int64)
    if not len(starts) or not events.t[0] <= t <= events.t[-1]:
        return None
    return found.windows[int(np.searchsorted(events.t[starts], t, side="right")) - 1]


# --- masks -------------------------------------------------------------------------------------------------


def _frames(recording: LabelledRecording) -> Iterator[tuple[npt.NDArray[Any], slice]]:
    """Masks at no more than 40 Hz, and the events about each; frames beyond the events are left out."""
    masks, events = recording.truth.masks, recording.events
    if masks is None or not len(events):
        return
    last = -(2**62)
    for k, t in enumerate(masks.t.tolist()):
        if t < last + FRAME_US - 1000:  # poses come a millisecond early or late
            continue
        if t - FRAME_US // 2 < events.t[0] or t + FRAME_US // 2 > events.t[-1]:
            continue
        last = t
        first, stop = np.searchsorted(events.t, [t - FRAME_US // 2, t + FRAME_US // 2]).tolist()
        yield _mask(recording, k), slice(first, stop)


def _score_masks(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    if recording.truth.masks is None:
        return []
    masked: dict[str, list[float]] = {"mask IoU": [], "Dice": [], "pixel accuracy": []}
    dense: list[float] = []
    for mask, part in _frames(recording):
        events, labels = recording.events[part], found.labels[part]
        shape = mask.shape
        moving = moving_pixels(events.x, events.y, labels > 0, shape=shape)
        with_events = np.zeros(shape, dtype=bool)
        with_events[events.y, events.x] = True
        scored = with_events & (mask >= 0)
        masked["mask IoU"].append(mask_iou(mask > 0, moving, where=scored))
        masked["Dice"].append(dice(mask > 0, moving, where=scored))
        masked["pixel accuracy"].append(pixel_accuracy(mask > 0, moving, where=scored))
        hulls = filled_hulls(events.x, events.y, labels, shape=shape)
        dense.append(mask_iou(mask > 0, hulls, where=mask >= 0))
    rows = [Figure("mask 40 Hz", name, tuple(values)) for name, values in masked.items()]
    return [*rows, Figure("mask dense", "mask IoU, hulls filled", tuple(dense))]


def _score_points(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    masks, events = recording.truth.masks, recording.events
    if masks is None:
        return []
    chosen = _every(masks, FRAME_US)
    values = []
    for start, end in itertools.pairwise(chosen):
        first, stop = np.searchsorted(events.t, masks.t[[start, end]]).tolist()
        if first == stop:
            continue
        part = events[first:stop]
        values.append(
            point_iou(
                _mask(recording, start) > 0,
                _mask(recording, end) > 0,
                part.x,
                part.y,
                found.labels[first:stop] > 0,
            )
        )
    return [Figure("points", "point IoU", tuple(values))]


def _every(masks: ImageTrack, interval_us: int) -> list[int]:
    """Masks at least an interval apart."""
    chosen: list[int] = []
    for k, t in enumerate(masks.t.tolist()):
        if not chosen or t >= masks.t[chosen[-1]] + interval_us - 1000:
            chosen.append(k)
    return chosen


# --- flow --------------------------------------------------------------------------------------------------


def _score_flow(recording: LabelledRecording, found: SegmentedRecording) -> list[Figure]:
    track, events = recording.truth.flow, recording.events
    if track is None or (recording.camera is not None and recording.camera.distortion):
        return []  # models move undistorted pixels, the truth those of the sensor
    errors, outliers = [], []
    for k, (start, end) in enumerate(zip(track.t_from.tolist(), track.t_to.tolist(), strict=True)):
        window = _window_at(events, found, (start + end) // 2)
        first, stop = np.searchsorted(events.t, [start, end]).tolist()
        if window is None or first == stop:
            continue
        part, labels = events[first:stop], found.labels[first:stop]
        truth = track.load(k)
        flow = np.full(truth.shape, np.nan)
        for model in window.models:
            own = labels == model.label
            if own.any():
                velocity = _velocity(part[own], model, recording)
                flow[part.y[own], part.x[own]] = 1e-6 * (end - start) * velocity
        known = np.isfinite(flow).all(axis=-1)
        figures = flow_figures(truth, np.nan_to_num(flow), where=known)
        errors.append(figures["epe"])
        outliers.append(figures["3pe"])
    return [Figure("flow", "end-point error, px", tuple(errors)), Figure("flow", "3PE, %", tuple(outliers))]


def _velocity(
    events: EventArray, model: MotionModel, recording: LabelledRecording
) -> npt.NDArray[np.float64]:
    """Velocity of a motion at the pixels of events, px/s, (n, 2): the change of where they are warped to."""
    step_us = 500
    t = np.zeros(len(events), np.int64)
    still = EventArray(events.x, events.y, t, events.p, width=events.width, height=events.height)
    later, earlier = (warp(still, model, dt, camera=recording.camera) for dt in (step_us, -step_us))
    return (later.astype(np.float64) - earlier) / (2e-6 * step_us)


_SCORES: Final[tuple[Score, ...]] = (
    _score_events,
    _score_owner_boxes,
    _score_boxes,
    _score_masks,
    _score_points,
    _score_flow,
    _score_still,
    _score_labels,
)

PROTOCOLS: Final = {
    protocol.name: protocol
    for protocol in (
        Protocol("events", "labels per event, in windows with 200 events of objects or more", "window"),
        Protocol("tracks", "identities through the recording", "object"),
        Protocol("owner boxes", "EED's criterion, true boxes about the events' owners", "box"),
        Protocol("eed", "EED's criterion, annotated boxes", "box"),
        Protocol("mask 40 Hz", "moving mask at pixels with events, 40 Hz", "frame"),
        Protocol("mask dense", "moving mask at all pixels, labels' convex hulls filled, 40 Hz", "frame"),
        Protocol("points", "SpikeMS's point IoU, over intervals of 25 ms or more", "interval"),
        Protocol("flow", "flow of the labels' motions at pixels with events", "interval"),
        Protocol("still", "nothing but the camera moves: all that is found is false", "window"),
        Protocol("labels", "what is found, without truth", "window"),
        Protocol("mIoU", "mIoU as its authors score it: not ours to compare with", "frame"),
    )
}
"""By name, in the order of the report."""
