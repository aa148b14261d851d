"""Segmentation of windows and of whole recordings: the engine's public face."""

from __future__ import annotations

import copy
import itertools
import os
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import Any, Final, TypedDict

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.camera import Camera, shared_undistortion_table
from emseg.config import Config
from emseg.event_buffer import EventBuffer
from emseg.events import EventArray
from emseg.motion import MotionModel, iwe, middle_time, warp
from emseg.tracking import BOX_DTYPE, Objects, TrackedMotion, Tracker, bounding_box
from emseg.window_length import FIRST_TRIAL_US, MOST_EVENTS, next_duration

__all__ = ["Segmentation", "Segmenter", "segment"]

# HybridModelCombination as the motion models that a label may have.
_KINDS: Final[dict[str, list[str]]] = {
    "2d": ["translation"],
    "3d": ["rotation"],
    "4d": ["similarity"],
    "2d+3d": ["translation", "rotation"],
    "2d+4d": ["translation", "similarity"],
    "3d+4d": ["rotation", "similarity"],
    "all": ["translation", "rotation", "similarity"],
    "affine": ["affine"],
    "homography": ["homography"],
    "auto": ["translation", "similarity", "affine"],
}

# Durations tried before the first window of a recording is taken.
_TRIALS: Final = 5

_WINDOWS_AT_A_TIME: Final = 2

# Logit from which on a part of a lone window moves: no other window is there to find what this one misses.
_ALONE: Final = -0.5


def engine_options(config: Config) -> _core.SegmenterOptions:
    """The engine's settings of a config."""
    return _core.SegmenterOptions(
        data_term=config.data_term,
        lambda_data=config.lambda_data,
        lambda_smooth=config.lambda_smooth,
        lambda_label=config.lambda_label,
        bracket_row=config.bracket_row,
        bracket_col=config.bracket_col,
        affine_trans2d_max=config.affine_trans2d_max,
        affine_scale_max=config.affine_scale_max,
        affine_theta_max=config.affine_theta_max,
        kinds=_KINDS[config.hybrid_model_combination],
        num_iter_segmentation=config.num_iter_segmentation,
        num_iter_labeling=config.num_iter_labeling,
        polarity=config.polarity,
        footprint=config.footprint,
        flicker=config.flicker,
        lambda_speed=config.lambda_speed,
        lambda_edge=config.lambda_edge,
        labelling=config.labelling,
        sigma=config.sigma,
        max_events=config.max_events_per_window,
        mark_noise=config.noise_label == "auto",
        threads=config.threads,
    )


class Segmentation:
    """What was found in one window of n events.

    Attributes:
        events: The window's events.
        labels: int32 (n,): 0 the background (the camera's own motion), 1.. moving objects, -1 noise.  From
            `Segmenter.run` the numbers above 0 are track ids; from `segment` they run from 1, largest first.
        models: One MotionModel per label, the background's first; `model.label` is the label.
        parts: int32 (n,): as labels, but an articulated body's parts, which move differently, have numbers of
            their own, from 1 in every window.
        part_models: One MotionModel per part, the background's first.
        energy: Energy of the labelling, before events were marked as noise.
        energy_trace: Energy after every step of the alternation; it never rises.
        reference_sharpness: Sharpness that the data term calls free of cost.
        timings: Wall-clock seconds per stage.
        thinned: Events left out when motions and labels were found; they follow the labels of the others near
            them (see Config.max_events_per_window).
        start: First event of the window in the recording.
        stop: One past the last.
        t_ref: Time that events are warped to, µs.
        camera: The camera, if one was given.
    """

    def __init__(
        self,
        events: EventArray,
        labels: npt.NDArray[np.int32],
        models: Sequence[MotionModel],
        *,
        energy: float,
        energy_trace: list[float],
        reference_sharpness: float,
        timings: dict[str, float],
        t_ref: int,
        thinned: int = 0,
        start: int = 0,
        camera: Camera | None = None,
    ) -> None:
        self.events = events
        self.labels = labels
        self.models = list(models)
        self.parts = labels
        self.part_models = self.models
        self.energy = energy
        self.energy_trace = energy_trace
        self.reference_sharpness = reference_sharpness
        self.timings = timings
        self.t_ref = t_ref
        self.thinned = thinned
        self.start = start
        self.stop = start + len(events)
        self.camera = camera

    def __repr__(self) -> str:
        sizes = ", ".join(f"{m.label}: {int((self.labels == m.label).sum())}" for m in self.models)
        return f"Segmentation({len(self.events)} events at {self.t_ref} µs; events by label {{{sizes}}})"

    def relabelled(self, objects: Objects, *, start: int) -> Segmentation:
        """The same window by objects instead of motions, at another place in the recording."""
        other = copy.copy(self)
        other.__dict__.pop("boxes", None)
        other.labels, other.models = objects.labels, objects.models
        other.parts, other.part_models = objects.parts, objects.part_models
        other.start, other.stop = start, start + len(objects.labels)
        return other

    @property
    def duration(self) -> int:
        """From the first event to the last, µs; at least 1."""
        return max(1, int(self.events.t[-1] - self.events.t[0])) if len(self.events) else 1

    def model_of(self, label: int) -> MotionModel:
        """The motion of a label.

        Raises:
            KeyError: no such label here.
        """
        for model in self.models:
            if model.label == label:
                return model
        raise KeyError(f"no label {label}, there are {[model.label for model in self.models]}")

    def events_of(self, label: int) -> EventArray:
        """The events of a label, in time order."""
        return self.events[self.labels == label]

    def iwe(self, label: int | None = None, *, sigma: float = 1.0) -> npt.NDArray[np.float32]:
        """Image of warped events, float32 (height, width).

        Args:
            label: Of this label's events under its motion; None: of all labels, each under its own.
            sigma: Gaussian blur, px.

        Raises:
            KeyError: no such label here.
        """
        chosen = self.models if label is None else [self.model_of(label)]
        image = np.zeros((self.events.height, self.events.width), np.float32)
        for model in chosen:
            assert model.label is not None
            image += iwe(self.events_of(model.label), model, self.t_ref, sigma, camera=self.camera)
        return image

    def label_image(self) -> npt.NDArray[np.int32]:
        """Label of the last event at every pixel, int32 (height, width); -1 where there is none."""
        image = np.full((self.events.height, self.events.width), -1, np.int32)
        image[self.events.y, self.events.x] = self.labels
        return image

    @cached_property
    def boxes(self) -> npt.NDArray[Any]:
        """Boxes of the moving labels at t_ref on the sensor: array of (track, x, y, w, h), px, by track."""
        rows = []
        for model in self.models:
            if model.label is None or model.label <= 0:
                continue
            own = self.events_of(model.label)
            if len(own):
                rows.append((model.label, *bounding_box(self._on_sensor(own, model))))
        return np.array(sorted(rows), dtype=BOX_DTYPE)

    def _on_sensor(self, own: EventArray, model: MotionModel) -> npt.NDArray[np.float32]:
        """Places of events at t_ref as the lens shows them, but for the distortion's change on the way."""
        still = MotionModel("translation")
        moved, place = (warp(own, m, self.t_ref, camera=self.camera) for m in (model, still))
        return np.column_stack([own.x, own.y]).astype(np.float32) + (moved - place)


class Segmenter:
    """Segments recordings of one sensor, window after window.

    Args:
        width: Width of the sensor, px.
        height: Height of the sensor, px.
        camera: Undistorts events and gives rotations their intrinsics; optional.
        config: Settings; the defaults need none.

    Raises:
        ValueError: the camera's size is not the sensor's, or a setting is out of range.
    """

    def __init__(
        self, width: int, height: int, camera: Camera | None = None, config: Config | None = None
    ) -> None:
        self.width = width
        self.height = height
        self.camera = camera
        self.config = config or Config()
        self._engine = self._new_engine(engine_options(self.config))

    def _new_engine(self, options: _core.SegmenterOptions) -> _core.Segmenter:
        if self.camera is None:
            return _core.Segmenter(self.width, self.height, options)
        table = shared_undistortion_table(self.camera) if self.camera.distortion else None
        return _core.Segmenter(self.width, self.height, options, self.camera.to_native(), table)

    def segment(
        self,
        events: EventArray,
        *,
        pool: Sequence[MotionModel] = (),
        candidates: Sequence[MotionModel] = (),
        t_ref: int | None = None,
    ) -> Segmentation:
        """Segment one window, cold: the whole array given.

        Args:
            events: The window.
            pool: The only motions to choose from (and to refine); empty: they are searched for.
            candidates: Further candidates of the search, such as the last window's motions.
            t_ref: Time to warp to, µs; the middle of the window if None.

        Raises:
            ValueError: the events' sensor is not this segmenter's.
        """
        found = self.find_motions(events, pool=pool, candidates=candidates, t_ref=t_ref)
        if self.config.background == "widest":
            return found
        tracker = self.tracker(least_evidence=_ALONE)
        return found.relabelled(
            tracker.assign(found.events, found.labels, found.models, found.t_ref), start=0
        )

    def find_motions(
        self,
        events: EventArray,
        *,
        pool: Sequence[MotionModel] = (),
        candidates: Sequence[MotionModel] = (),
        tracked: Sequence[TrackedMotion] = (),
        t_ref: int | None = None,
    ) -> Segmentation:
        """As `segment`, but labels are motions: label 0 is the most widely spread, and no part is judged.

        `tracked` are motions of objects that are known to be there: their labels cost less, since what was
        seen before need not prove itself again, and most where the objects are expected.
        """
        self._check_sensor(events)
        return self._segment_by(
            self._engine, events, pool=pool, candidates=candidates, tracked=tracked, t_ref=t_ref
        )

    def tracker(self, *, least_evidence: float = 0.0) -> Tracker:
        """What makes objects of the motions of successive windows; see Tracker."""
        judged = self.config.background == "scene"
        return Tracker(
            self.width,
            self.height,
            self.camera,
            self.motion_losses if judged else None,
            least_evidence=least_evidence,
        )

    def motion_losses(
        self,
        events: EventArray,
        own: MotionModel,
        other: MotionModel,
        offsets: Sequence[tuple[float, float]],
        *,
        t_ref: int,
        duration: float,
    ) -> list[float]:
        """Nats an event that another motion loses against the events' own, once for every offset of it.

        Args:
            events: The events to be explained, a part of a window.
            own: Their motion.
            other: The motion that they are held against.
            offsets: Displacements (x, y) added to the other motion's, px over the window.
            t_ref: The window's reference time, µs.
            duration: The window's, s.

        Raises:
            ValueError: the events' sensor is not this segmenter's.
        """
        self._check_sensor(events)
        losses: list[float] = self._engine.motion_losses(
            events.x, events.y, events.t, events.p, t_ref, duration, own.native(), other.native(), offsets
        )
        return losses

    def _check_sensor(self, events: EventArray) -> None:
        if (events.width, events.height) != (self.width, self.height):
            raise ValueError(
                f"the events' sensor is {events.width}x{events.height}, "
                f"the segmenter's {self.width}x{self.height}"
            )

    def _segment_by(
        self,
        engine: _core.Segmenter,
        events: EventArray,
        *,
        pool: Sequence[MotionModel] = (),
        candidates: Sequence[MotionModel] = (),
        tracked: Sequence[TrackedMotion] = (),
        t_ref: int | None = None,
    ) -> Segmentation:
        middle = middle_time(events) if t_ref is None else t_ref
        found = engine.segment(
            events.x,
            events.y,
            events.t,
            events.p,
            middle,
            [model.native() for model in pool],
            [model.native() for model in candidates],
            [(known.model.native(), known.places, 1e-6 * (known.t - middle)) for known in tracked],
        )
        models = [
            MotionModel(kind, params, label)  # type: ignore[arg-type]
            for label, (kind, params) in enumerate(found.models)
        ]
        return Segmentation(
            events,
            found.labels,
            models,
            energy=float(found.energy),
            energy_trace=[float(energy) for energy in found.energy_trace],
            reference_sharpness=found.reference_sharpness,
            timings=dict(found.timings),
            t_ref=found.t_ref,
            thinned=found.thinned,
            camera=self.camera,
        )

    def run(self, events: EventArray | Iterable[EventArray]) -> Iterator[Segmentation]:
        """Segment a recording: windows in order, each starting from what the last one found.

        Without a count or a duration in the config, a window lasts until the events of most motions have
        moved some pixels: long enough to tell motions apart, short enough for them to be uniform.

        Args:
            events: The recording, whole or in chunks.  In chunks it may be of any length, since nothing is
                kept of what is done; how it is cut changes nothing.

        Yields:
            A Segmentation a window, whose labels above 0 are track ids: an object keeps its id from window
            to window, and parts of one motion that lie apart are objects of their own.

        Raises:
            ValueError: the events' sensor is not this segmenter's, or chunks overlap in time.
        """
        buffer = EventBuffer(events, width=self.width, height=self.height)
        tracker = self.tracker(least_evidence=1.5)
        wanted, first = self._first_trial(buffer)
        threads = self.config.threads or len(os.sched_getaffinity(0))
        options = engine_options(replace(self.config, threads=max(1, threads // _WINDOWS_AT_A_TIME)))
        engines = itertools.cycle([self._new_engine(options) for _ in range(_WINDOWS_AT_A_TIME)])
        running: deque[tuple[int, Future[Segmentation]]] = deque()
        known: KnownMotions = {}
        # Two windows are worked on at a time, on an engine each.  A window starts from what the last but one
        # found, whatever the number of threads, so that the labels do not depend on it.
        with ThreadPoolExecutor(min(threads, _WINDOWS_AT_A_TIME)) as executor:
            while True:
                done = None
                if len(running) == _WINDOWS_AT_A_TIME:
                    start, future = running.popleft()
                    found = future.result()
                    objects = tracker.assign(found.events, found.labels, found.models, found.t_ref)
                    known = known_motions(found, tracker.motions())
                    if wanted is not None:
                        wanted = next_duration(found.duration, objects)
                    done = found.relabelled(objects, start=start)
                window = buffer.take(self._next_size(buffer, wanted) if first is None else len(first.events))
                if len(window):
                    if first is None:
                        task = executor.submit(self._segment_by, next(engines), window, **known)
                    else:
                        task = _finished(first)
                        first = None
                    running.append((buffer.taken - len(window), task))
                if done is not None:
                    yield done
                elif not len(window):
                    break
            for start, future in running:
                found = future.result()
                objects = tracker.assign(found.events, found.labels, found.models, found.t_ref)
                yield found.relabelled(objects, start=start)

    def _first_trial(self, buffer: EventBuffer) -> tuple[int | None, Segmentation | None]:
        """How long a window is to last, µs, by trying, and the first one if a trial has lasted about as long.

        None for the duration: windows have no adaptive one.
        """
        if self.config.num_events_per_image is not None or self.config.window_duration is not None:
            return None, None
        wanted = FIRST_TRIAL_US
        for _ in range(_TRIALS):
            size = self._next_size(buffer, wanted)
            if not size:
                return None, None
            found = self.find_motions(buffer.look_ahead(count=size)[:size])
            objects = self.tracker().assign(found.events, found.labels, found.models, found.t_ref)
            tried, wanted = found.duration, next_duration(found.duration, objects)
            if 0.7 * wanted < tried < 1.4 * wanted:
                return wanted, found
        return wanted, None

    def _next_size(self, buffer: EventBuffer, wanted: int | None) -> int:
        """As `window_size`, of a recording whose end can be seen ahead."""
        return self.window_size(buffer) if wanted is None else buffer.count_to_end(wanted, most=MOST_EVENTS)

    def window_size(self, buffer: EventBuffer, duration_us: int | None = None) -> int:
        """How many of the events to come the next window takes; 0 where none is left.

        Args:
            buffer: What is to come; it is looked ahead into.
            duration_us: How long a window is to last, µs, where the config does not say.
        """
        if self.config.num_events_per_image is not None:
            count = self.config.num_events_per_image
            return min(count, len(buffer.look_ahead(count=count)))
        if self.config.window_duration is not None:
            return buffer.count_to_multiple(max(1, round(self.config.window_duration * 1e6)))
        return buffer.count_within(duration_us or FIRST_TRIAL_US, most=MOST_EVENTS)


def _finished(found: Segmentation) -> Future[Segmentation]:
    task: Future[Segmentation] = Future()
    task.set_result(found)
    return task


class KnownMotions(TypedDict, total=False):
    """What is known of a window beforehand, as `Segmenter.find_motions` takes it."""

    candidates: list[MotionModel]
    tracked: list[TrackedMotion]


def known_motions(found: Segmentation, tracked: list[TrackedMotion]) -> KnownMotions:
    """What a later window may start from, as `find_motions` takes it: motions of objects, and the others."""
    moving = [known.model.native() for known in tracked]
    return {"candidates": [m for m in found.models if m.native() not in moving], "tracked": tracked}


def segment(
    events: EventArray,
    camera: Camera | None = None,
    config: Config | None = None,
    *,
    pool: Sequence[MotionModel] = (),
    t_ref: int | None = None,
) -> Segmentation:
    """Segment one window of events: the whole array given.

    Args:
        events: The window, n events.
        camera: Undistorts events and gives rotations their intrinsics; optional.
        config: Settings; the defaults need none.
        pool: The only motions to choose from (and to refine); empty: they are searched for.
        t_ref: Time to warp to, µs; the middle of the window if None.

    Returns:
        Labels and motions; see Segmentation.

    Raises:
        ValueError: the camera's size is not the sensor's, or a setting is out of range.

    Source: Zhou et al., "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts", TNNLS 2021.
    """
    return Segmenter(events.width, events.height, camera, config).segment(events, pool=pool, t_ref=t_ref)
