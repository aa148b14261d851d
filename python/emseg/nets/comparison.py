"""The engine and networks on the same held-out recordings: one protocol, one table, pictures.

Each method labels the events and pixels of the same slices; each works in a process of its own, with one
thread, so that its time and memory are its own.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import resource
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

import emseg
from emseg.batch import source_commit
from emseg.metrics import detected_boxes, event_moving_iou
from emseg.metrics.events import MIN_EVENTS
from emseg.nets.pictures import captioned, mask_picture, row
from emseg.nets.recordings import SimulatedRecording
from emseg.nets.settings import SliceSettings
from emseg.nets.teacher import label_image
from emseg.render import Picture, polarity_picture
from emseg.writers import write_png

__all__ = ["CLAIMS", "Row", "compare_methods", "mask_figures", "object_boxes", "table_of"]

CLAIMS: Final = (
    "The thesis says: IoU 76.81 % for the graph cut, 77 % for networks, and that networks are faster.  "
    "Both figures are of EV-IMO, by other protocols and on other machines; nothing in this table was "
    "measured on EV-IMO, so that it neither confirms nor refutes them."
)

ENGINE: Final = "engine"
BASELINES: Final = ("all background", "all moving")
FIGURES: Final = ("event_iou", "mask_iou", "dice", "accuracy", "detection")
SMALLEST_BOX: Final = 30  # px that an object, or a part of a network's mask, must have

Labels = NDArray[np.integer[Any]]
Labelled = list[tuple[Labels, Labels]]  # events and pixels, slice by slice


@dataclass(frozen=True)
class Row:
    """One slice of one recording by one method; NaN where a figure is not defined.

    Attributes:
        recording: Its name.
        time: Of the slice's middle, µs.
        event_iou: Of moving events.
        mask_iou, dice, accuracy: Of moving pixels, at the pixels with events.
        detection: Share of the true objects' boxes that are found.
    """

    recording: str
    time: int
    event_iou: float
    mask_iou: float
    dice: float
    accuracy: float
    detection: float


@dataclass(frozen=True, eq=False)
class _Outcome:
    method: str
    rows: list[Row]
    cpu_seconds: float  # for all windows
    peak_mb: float
    pictures: dict[tuple[str, int], Picture]


def mask_figures(truth: Labels, predicted: Labels, active: NDArray[np.bool_]) -> tuple[float, float, float]:
    """IoU, Dice and accuracy of moving pixels among those that are active and known in truth, (h, w) each."""
    counted = active & (truth >= 0)
    moves, said = truth[counted] > 0, predicted[counted] > 0
    hit, union = np.count_nonzero(moves & said), np.count_nonzero(moves | said)
    if not union:
        iou = dice = float("nan")
    else:
        iou = hit / union
        dice = 2 * hit / (np.count_nonzero(moves) + np.count_nonzero(said))
    accuracy = float(np.mean(moves == said)) if len(moves) else float("nan")
    return iou, dice, accuracy


def object_boxes(labels: Labels, *, parts: Literal["whole", "connected"]) -> NDArray[np.float64]:
    """Boxes x, y, w, h of the labels above 0, or of their connected parts, of 30 px at least; (n, 4)."""
    boxes = []
    for label in np.unique(labels[labels > 0]).tolist():
        pixels = labels == label
        pieces = ndimage.label(pixels, np.ones((3, 3)))[0] if parts == "connected" else pixels.astype(int)
        counts = np.bincount(pieces.ravel())
        for number, place in enumerate(ndimage.find_objects(pieces), start=1):
            if place is not None and counts[number] >= SMALLEST_BOX:
                y, x = place
                boxes.append((x.start, y.start, x.stop - x.start, y.stop - y.start))
    return np.array(boxes, np.float64).reshape(-1, 4)


class _Slices:
    """The slices of a recording that are compared, with their truth."""

    def __init__(self, recording: SimulatedRecording, settings: SliceSettings, references: int) -> None:
        self.recording = recording
        self.half = round(5e5 * settings.width)
        margin = self.half + round(1e6 * settings.step * (references - references // 2))
        times = recording.times
        inside = np.flatnonzero((times >= times[0] + margin) & (times <= times[-1] - margin))
        self.moments: list[int] = []
        for moment in inside.tolist():
            if not self.moments or times[moment] - times[self.moments[-1]] >= 1e6 * settings.stride - 1:
                self.moments.append(moment)

    def __iter__(self) -> Iterator[tuple[int, int, slice]]:
        """Moment of the truth, time µs, and the events."""
        t = self.recording.events.t
        for moment in self.moments:
            time_us = int(self.recording.times[moment])
            begin, end = np.searchsorted(t, [time_us - self.half, time_us + self.half])
            yield moment, time_us, slice(int(begin), int(end))


def _scored(
    recording: SimulatedRecording,
    moment: int,
    time_us: int,
    events: slice,
    event_labels: Labels,
    pixel_labels: Labels,
    *,
    parts: Literal["whole", "connected"],
) -> Row:
    truth = recording.mask(moment)
    window = recording.events[events]
    owners = recording.owners()[events]
    active = np.zeros(truth.shape, bool)
    active[window.y, window.x] = True
    large = [k for k in np.unique(owners[owners > 0]).tolist() if np.count_nonzero(owners == k) >= MIN_EVENTS]
    boxes = object_boxes(np.where(np.isin(truth, large), truth, 0), parts="whole")
    found = detected_boxes(boxes, object_boxes(pixel_labels, parts=parts))
    return Row(
        recording.name,
        time_us,
        event_moving_iou(owners, event_labels),
        *mask_figures(truth, pixel_labels, active),
        float(found.mean()) if len(boxes) else float("nan"),
    )


def _run(
    method: str,
    checkpoint: str | None,
    paths: Sequence[str],
    settings: SliceSettings,
    references: int,
    drawn: Sequence[tuple[str, int]],
) -> _Outcome:
    """One method on all recordings, in this process."""
    rows: list[Row] = []
    pictures: dict[tuple[str, int], Picture] = {}
    cpu = 0.0
    label = _labeller(method, checkpoint)
    for path in paths:
        recording = SimulatedRecording(path)
        slices = _Slices(recording, settings, references)
        if not slices.moments:
            continue
        recording.mask(slices.moments[0])  # read now, since reading is no method's business
        start = time.process_time()
        labelled = label(recording, list(slices))
        cpu += time.process_time() - start
        for (moment, time_us, events), (event_labels, pixel_labels) in zip(slices, labelled, strict=True):
            rows.append(
                _scored(
                    recording,
                    moment,
                    time_us,
                    events,
                    event_labels,
                    pixel_labels,
                    parts="whole" if method == ENGINE else "connected",
                )
            )
            if (recording.name, time_us) in drawn:
                window = recording.events[events]
                active = np.zeros(pixel_labels.shape, bool)
                active[window.y, window.x] = True
                picture = mask_picture(pixel_labels, active)
                scale = max(1, 480 // picture.shape[1])
                pictures[recording.name, time_us] = captioned(picture, method, scale=scale)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return _Outcome(method, rows, cpu, peak, pictures)


def _labeller(method: str, checkpoint: str | None) -> Any:
    """A function from a recording and its slices to labels of events and pixels, slice by slice."""
    if method in BASELINES:
        return lambda recording, slices: [_constant(recording, events, method) for _, _, events in slices]
    if checkpoint is None:
        return _by_engine
    import torch

    torch.set_num_threads(1)
    from emseg.nets.checkpoints import load_networks
    from emseg.nets.prediction import SlicePredictor

    trained = load_networks(checkpoint)

    def by_networks(recording: SimulatedRecording, slices: Any) -> Labelled:
        predictor = SlicePredictor(trained, recording.events, recording.K)
        results: Labelled = []
        for _, time_us, events in slices:
            image = predictor.on_sensor(predictor.labels(predictor.at(time_us)))
            window = recording.events[events]
            results.append((image[window.y, window.x], image))
        return results

    return by_networks


def _constant(recording: SimulatedRecording, events: slice, method: str) -> tuple[Labels, Labels]:
    value = BASELINES.index(method)
    size = (recording.events.height, recording.events.width)
    return np.full(events.stop - events.start, value), np.full(size, value)


def _by_engine(recording: SimulatedRecording, slices: Any) -> Labelled:
    """Labels of the engine as it runs through a recording, with windows of its own choice."""
    from emseg.config import Config
    from emseg.segmentation import Segmenter

    stream = recording.events
    labels = np.full(len(stream), -1, np.int32)
    for window in Segmenter(stream.width, stream.height, config=Config(threads=1)).run(stream):
        labels[window.start : window.stop] = window.labels
    return [(labels[events], label_image(stream[events], labels[events])) for _, _, events in slices]


def compare_methods(
    recordings: Sequence[SimulatedRecording], checkpoints: Sequence[Path], out: Path, *, pictures: int
) -> str:
    """Run everything, write compare.md, compare.json and pictures; returns the table.

    Slices are those of the networks, which must agree on them; without networks the defaults.

    Raises:
        ValueError: networks trained on other slices than the first.
    """
    settings, references = _common_slices(checkpoints)
    names = _method_names(checkpoints)
    jobs = [(ENGINE, None), *zip(names, map(str, checkpoints), strict=True), *((b, None) for b in BASELINES)]
    paths = [str(recording.path) for recording in recordings]
    drawn = _chosen(recordings, settings, references, pictures)
    context = multiprocessing.get_context("spawn")
    outcomes = []
    for method, checkpoint in jobs:
        if method in BASELINES:
            outcomes.append(_run(method, checkpoint, paths, settings, references, drawn))
            continue
        with ProcessPoolExecutor(1, mp_context=context) as process:  # its own, for its memory
            job = process.submit(_run, method, checkpoint, paths, settings, references, drawn)
            outcomes.append(job.result())
    seconds = sum(1e-6 * float(recording.times[-1] - recording.times[0]) for recording in recordings)
    windows = len(outcomes[0].rows)
    table = table_of({o.method: o.rows for o in outcomes}, _costs(outcomes, seconds, settings))
    scenes = _scene_table({o.method: o.rows for o in outcomes})
    out.mkdir(parents=True, exist_ok=True)
    text = (
        f"{windows} slices of {1e3 * settings.width:g} ms from {len(recordings)} simulated recordings.\n\n"
        f"{table}\n\nMask IoU at events, by scene:\n\n{scenes}\n\n{CLAIMS}\n"
    )
    (out / "compare.md").write_text(text, encoding="utf-8")
    _write_json(out / "compare.json", outcomes, settings, seconds)
    _draw(out / "pictures", recordings, outcomes, drawn, settings, references)
    return text


def _common_slices(checkpoints: Sequence[Path]) -> tuple[SliceSettings, int]:
    from emseg.nets.checkpoints import load_networks

    found = []
    for path in checkpoints:
        settings = load_networks(path).settings
        found.append((settings.slices, settings.network.references))
        first, each = found[0][0], settings.slices
        if (first.width, first.step, first.stride) != (each.width, each.step, each.stride):
            raise ValueError(f"{path}: trained on other slices than {checkpoints[0]}, expected the same")
    if not found:
        return SliceSettings(), 2
    return found[0][0], max(references for _, references in found)


def _method_names(checkpoints: Sequence[Path]) -> list[str]:
    """The folders' names, as a run has one to itself."""
    return [path.resolve().parent.name if path.stem == "best" else path.stem for path in checkpoints]


def _chosen(
    recordings: Sequence[SimulatedRecording], settings: SliceSettings, references: int, count: int
) -> list[tuple[str, int]]:
    """Slices to draw: the middle ones of recordings spread evenly."""
    places = np.linspace(0, len(recordings) - 1, min(count, len(recordings))).round().astype(int)
    chosen = []
    for place in sorted(set(places.tolist())):
        times = [time_us for _, time_us, _ in _Slices(recordings[place], settings, references)]
        if times:
            chosen.append((recordings[place].name, times[len(times) // 2]))
    return chosen


def _mean(rows: Sequence[Row], figure: str) -> tuple[float, int]:
    """Mean over the rows that have a figure, and how many have none."""
    values = np.array([getattr(each, figure) for each in rows], np.float64)
    known = np.isfinite(values)
    return (float(values[known].mean()) if known.any() else float("nan")), int((~known).sum())


def _costs(
    outcomes: Sequence[_Outcome], seconds: float, settings: SliceSettings
) -> Mapping[str, tuple[float, float]]:
    """CPU ms per window of each method, and its process' peak in MB.

    The engine labels every event once: what it takes is spread over the recordings' length.
    """
    costs = {}
    for outcome in outcomes:
        if outcome.method in BASELINES:
            continue
        windows = seconds / settings.width if outcome.method == ENGINE else len(outcome.rows)
        costs[outcome.method] = (1e3 * outcome.cpu_seconds / windows, outcome.peak_mb)
    return costs


def table_of(rows: Mapping[str, Sequence[Row]], costs: Mapping[str, tuple[float, float]]) -> str:
    """The table in Markdown; figures in %, means over the slices where they are defined."""
    lines = [
        "| method | event IoU | mask IoU | Dice | pixel accuracy | detection | CPU ms a window | peak MB |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for method, its in rows.items():
        figures = " | ".join(_percent(_mean(its, figure)[0]) for figure in FIGURES)
        cost = " | ".join(f"{value:.0f}" for value in costs[method]) if method in costs else "– | –"
        lines.append(f"| {method} | {figures} | {cost} |")
    skipped = {figure: _mean(next(iter(rows.values())), figure)[1] for figure in FIGURES}
    lines.append("")
    lines.append(
        "Left out by the first method, for want of anything that moves or is called so: "
        + ", ".join(f"{figure} {count}" for figure, count in skipped.items())
        + " slices."
    )
    return "\n".join(lines)


def _percent(value: float) -> str:
    return f"{100 * value:.1f}" if np.isfinite(value) else "–"


def _scene_table(rows: Mapping[str, Sequence[Row]]) -> str:
    methods = list(rows)
    names = list(dict.fromkeys(each.recording for each in rows[methods[0]]))
    lines = [f"| recording | {' | '.join(methods)} |", f"|---|{'---:|' * len(methods)}"]
    for name in names:
        figures = [
            _percent(_mean([each for each in rows[method] if each.recording == name], "mask_iou")[0])
            for method in methods
        ]
        lines.append(f"| {name} | {' | '.join(figures)} |")
    return "\n".join(lines)


def _write_json(path: Path, outcomes: Sequence[_Outcome], settings: SliceSettings, seconds: float) -> None:
    content = {
        "version": emseg.__version__,
        "commit": source_commit(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, one thread a method",
        "slices": settings.model_dump(mode="json"),
        "seconds_of_recording": seconds,
        "columns": [field.name for field in fields(Row)],
        "methods": [
            {
                "method": outcome.method,
                "cpu_seconds": round(outcome.cpu_seconds, 3),
                "peak_mb": round(outcome.peak_mb, 1),
                "means": {figure: _mean(outcome.rows, figure)[0] for figure in FIGURES},
                "skipped": {figure: _mean(outcome.rows, figure)[1] for figure in FIGURES},
                "rows": [[_short(value) for value in astuple(each)] for each in outcome.rows],
            }
            for outcome in outcomes
        ],
    }
    path.write_text(json.dumps(content) + "\n", encoding="utf-8")


def _short(value: Any) -> Any:
    """A figure to four digits; JSON has no NaN."""
    if not isinstance(value, float):
        return value
    return round(value, 4) if np.isfinite(value) else None


def _draw(
    folder: Path,
    recordings: Sequence[SimulatedRecording],
    outcomes: Sequence[_Outcome],
    drawn: Sequence[tuple[str, int]],
    settings: SliceSettings,
    references: int,
) -> None:
    """Events, truth, and every method's mask beside each other."""
    by_name = {recording.name: recording for recording in recordings}
    for name, wanted in drawn:
        recording = by_name[name]
        for moment, time_us, events in _Slices(recording, settings, references):
            if time_us != wanted:
                continue
            window = recording.events[events]
            scale = max(1, 480 // window.width)
            truth = captioned(mask_picture(recording.mask(moment)), "truth", scale=scale)
            panels = [polarity_picture(window, caption=name, scale=scale), truth]
            panels += [o.pictures[name, time_us] for o in outcomes if o.method not in BASELINES]
            folder.mkdir(parents=True, exist_ok=True)
            write_png(folder / f"{name}_{time_us}.png", row(panels))
