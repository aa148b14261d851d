"""One recording or window, segmented and scored against its truth."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import emseg
from bench import recordings, windows
from bench.recordings import Recording
from emseg.metrics import Identities, detected_boxes, event_figures, object_boxes
from emseg.presets import PRESETS
from emseg.render import BOX_DTYPE, label_picture, side_by_side
from emseg.writers import write_png

SMALL = 200  # events of objects below which a window is reported apart
LABEL_FIGURES = ("one_to_one_accuracy", "clusters_per_motion")
FIGURES = ("moving_iou_deployed", "moving_iou_oracle", "object_iou", *LABEL_FIGURES)
WARM_UP_EVENTS = 5000

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class Task:
    """A recording to score: `span` is the middle seconds taken, None for all."""

    path: Path
    name: str
    span: float | None = None
    pictures: Path | None = None
    worst: int = 3
    peer: int = 0


@dataclass(frozen=True)
class Window:
    """A window's events in the recording, what it was given, and its true and detected boxes."""

    start: int
    stop: int
    labels: Labels
    true_boxes: NDArray[Any]  # of BOX_DTYPE
    boxes: NDArray[Any]
    figures: dict[str, float]
    detected: NDArray[np.bool_]

    @property
    def small(self) -> bool:
        """Whether too few events are of objects for the window to count."""
        return self.figures["object_events"] < SMALL


def score_window(path: Path) -> dict[str, Any]:
    """A reference window, cold, beside what the published code made of it."""
    window = windows.load(str(path))
    assert window.truth is not None
    emseg.segment(window.events[:WARM_UP_EVENTS], window.camera)
    start = time.process_time()
    seg = emseg.segment(window.events, window.camera)
    spent = time.process_time() - start
    figures = event_figures(window.truth, seg.labels)
    return {
        "window": path.stem.removeprefix("syn_"),
        **figures,
        "motions": len(np.unique(window.truth[window.truth >= 0])),
        "cpu_s": spent,
        "published": {
            pool: {name: event_figures(window.truth, published.labels)[name] for name in LABEL_FIGURES}
            for pool, published in window.published.items()
        },
    }


def score_scene(task: Task) -> dict[str, Any]:
    """A recording by `Segmenter.run` with defaults and one thread: its row of the table."""
    recording = recordings.load_file(task.path, middle=task.span)
    if recording.truth is None:
        raise ValueError("holds no label, expected the truth per event")
    found, spent = segment_scored(recording, emseg.Config(threads=1))
    if task.pictures is not None:
        draw_worst(recording, found, task.pictures, task.worst)
    return {
        **summary(recording, found, spent),
        "peer": score_peer(recording, task.peer) if task.peer else None,
    }


def segment_scored(
    recording: Recording, config: emseg.Config, *, most_cpu_s: float = float("inf")
) -> tuple[list[Window], float]:
    """The windows of `Segmenter.run`, each beside its truth, and the CPU seconds of segmenting alone.

    While one window is scored the next is being segmented: scoring is told apart by its thread's time.
    Once `most_cpu_s` are spent the rest of the recording is left out.
    """
    events = recording.events
    list(emseg.Segmenter(events.width, events.height, config=config).run(events[:WARM_UP_EVENTS]))
    found: list[Window] = []
    spent = scoring = 0.0
    start = time.process_time()
    for seg in emseg.Segmenter(events.width, events.height, config=config).run(events):
        begin = time.thread_time()
        found.append(scored(recording, seg.start, seg.stop, seg.labels, seg.boxes, seg.t_ref))
        scoring += time.thread_time() - begin
        spent = time.process_time() - start - scoring
        if spent > most_cpu_s:
            break
    return found, spent


def scored(
    recording: Recording, start: int, stop: int, labels: NDArray[Any], boxes: NDArray[Any], t_ref: float
) -> Window:
    """A window beside its truth."""
    assert recording.truth is not None
    events, truth = recording.events[start:stop], recording.truth[start:stop]
    of_object = object_boxes(events.x, events.y, events.t, truth, t_ref)
    true_boxes = np.array([(k, *box) for k, box in of_object.items()], BOX_DTYPE)
    corners = ("x", "y", "w", "h")
    detections = np.array([[box[corner] for corner in corners] for box in boxes])
    detected = detected_boxes(list(of_object.values()), detections)
    figures = event_figures(truth, labels)
    return Window(start, stop, labels.astype(np.int64), true_boxes, boxes, figures, detected)


def summary(recording: Recording, found: Sequence[Window], cpu_s: float) -> dict[str, Any]:
    """The figures of a recording.

    Means are over the windows that are not small and where a figure is defined; `skipped` counts those not
    small where the object IoU is not defined.  Boxes are counted over all these windows together, switches
    and the share tracked over all windows.  `falsely_moving` is the share of the background's events labelled
    moving in the small windows.
    """
    assert recording.truth is not None
    kept = [window for window in found if not window.small]
    small = [window for window in found if window.small]
    identities = Identities()
    for window in found:
        identities.add(recording.truth[window.start : window.stop], window.labels)
    still = moving = 0
    for window in small:
        own = recording.truth[window.start : window.stop] == 0
        still += int(np.count_nonzero(own))
        moving += int(np.count_nonzero(own & (window.labels > 0)))
    events = sum(window.stop - window.start for window in found)
    boxes = [window.detected for window in kept]
    tracked = identities.tracked
    return {
        "scene": recording.name,
        "events": events,
        "seconds": 1e-6 * recording.events.duration,
        "windows": len(found),
        "skipped": sum(window.figures["object_iou"] != window.figures["object_iou"] for window in kept),
        **{name: _mean([window.figures[name] for window in kept]) for name in FIGURES},
        "boxes": sum(map(len, boxes)),
        "detection_rate": float(np.concatenate(boxes).mean()) if sum(map(len, boxes)) else None,
        "switches": identities.switches,
        "most_switches": max(identities.switches.values(), default=0),
        "tracked": statistics.fmean(tracked.values()) if tracked else None,
        "small": {
            "windows": len(small),
            **{name: _mean([window.figures[name] for window in small]) for name in FIGURES},
            "falsely_moving": moving / still if still else None,
        },
        "cpu_s": cpu_s,
        "mega_events_a_cpu_second": 1e-6 * events / cpu_s if cpu_s else None,
        "each": [
            {"start": w.start, "stop": w.stop, "detected": w.detected.tolist(), **_plain(w.figures)}
            for w in found
        ],
    }


def score_peer(recording: Recording, count: int) -> dict[str, Any]:
    """The NumPy reference with published settings on `count` windows, evenly apart, each by itself.

    The settings are those published for the scene where there are, else those of the reference windows; the
    windows hold as many events as these say, 30,000 where they do not.  The label with most events is the
    background, as in the published figures; boxes are drawn about the other labels' events at t_ref.
    """
    from emseg import reference as numpy_reference  # numba takes longer to import than some scenes to segment

    known = {name.partition("/")[2]: preset for name, preset in PRESETS.items()}
    preset = known.get(recording.name, PRESETS["published"])
    size = min(preset["num_events_per_image"] or 30_000, len(recording.events))
    settings = numpy_reference.SegmentOptions(
        bracket_row=preset["bracket_row"],
        lambda_data=preset["lambda_data"],
        lambda_smooth=round(preset["lambda_smooth"]),
        lambda_label=round(preset["lambda_label"]),
    )
    found = []
    start = time.process_time()
    for begin in np.linspace(0, len(recording.events) - size, count + 2).round().astype(int)[1:-1].tolist():
        events = recording.events[begin : begin + size]
        frame = numpy_reference.make_window(
            events.x, events.y, events.t, width=events.width, height=events.height
        )
        labels = _by_size(numpy_reference.segment(frame, settings).labels)
        t_ref = 0.5 * float(events.t[0] + events.t[-1])
        own = object_boxes(events.x, events.y, events.t, labels, t_ref)
        boxes = np.array([(k, *box) for k, box in own.items()], BOX_DTYPE)
        found.append(scored(recording, begin, begin + size, labels, boxes, t_ref))
    row = summary(recording, found, time.process_time() - start)
    # The windows are apart from each other and each was labelled by itself.
    return row | {"switches": {}, "most_switches": 0, "tracked": None, "settings": preset}


def draw_worst(recording: Recording, found: Sequence[Window], folder: Path, count: int) -> None:
    """Pictures of the windows with the lowest sum of moving and object IoU: truth left, labels right."""
    assert recording.truth is not None
    folder.mkdir(parents=True, exist_ok=True)

    def score(window: Window) -> float:
        return float(np.nansum([window.figures[name] for name in ("moving_iou_deployed", "object_iou")]))

    worst = sorted((window for window in found if not window.small), key=score)[:count]
    for rank, window in enumerate(worst, 1):
        events = recording.events[window.start : window.stop]
        truth = recording.truth[window.start : window.stop]
        first, last = (1e-3 * int(t) for t in (events.t[0], events.t[-1]))
        captions = (
            f"truth, {recording.name}, {first:.0f} to {last:.0f} ms",
            f"moving IoU {window.figures['moving_iou_deployed']:.2f}, "
            f"object IoU {window.figures['object_iou']:.2f}, "
            f"found {window.detected.sum()} of {len(window.detected)}",
        )
        left = label_picture(events, truth, boxes=window.true_boxes, caption=captions[0])
        right = label_picture(events, window.labels, boxes=window.boxes, caption=captions[1])
        write_png(folder / f"{recording.name}_{rank}.png", side_by_side(left, right))


def _by_size(labels: Labels) -> Labels:
    """Labels numbered by events, the largest 0."""
    values, index, counts = np.unique(labels, return_inverse=True, return_counts=True)
    rank = np.empty(len(values), np.int64)
    rank[np.argsort(-counts, kind="stable")] = np.arange(len(values))
    return np.asarray(rank[index])


def _mean(values: Sequence[float]) -> float | None:
    defined = [value for value in values if value == value]
    return statistics.fmean(defined) if defined else None


def _plain(figures: dict[str, float]) -> dict[str, float | None]:
    """Figures as JSON knows them: nothing for NaN."""
    return {name: value if value == value else None for name, value in figures.items()}
