"""The live loop: windows as they come in, thinned to what the machine can do, never more than one behind.

A window is taken up when all its events have come.  Where it holds more of them than can be done in its time,
it is thinned (see :mod:`emseg.live.thinning`).  If all the same more than one further window's time has come
behind it by then, it is taken from the newest events instead, and those before are counted as skipped.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from array import array
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from emseg.camera import Camera
from emseg.config import Config
from emseg.event_buffer import EventBuffer
from emseg.events import EventArray
from emseg.live.event_queue import EventQueue
from emseg.live.sources import LiveSource
from emseg.live.thinning import Thinning, even_sample
from emseg.segmentation import KnownMotions, Segmentation, Segmenter, known_motions
from emseg.tracking import TrackedMotion, Tracker
from emseg.window_length import FIRST_TRIAL_US, next_duration

__all__ = ["LiveFigures", "LiveSegmenter", "LiveWindow"]

_AT_A_TIME: Final = 2


@dataclass(frozen=True)
class LiveWindow:
    """A window that was segmented as it came.

    Attributes:
        number: Of the window, from 0 on.
        segmentation: Of the events that were kept; its labels above 0 are track ids.
        t_first, t_last: Times of the window's first and last event, µs.
        events: Number of its events.
        thinned: How many of them were left out.
        skipped: Events before it that were left out because it was late.
        lasts_us: How long it was to last, µs.
        behind_us: Time of the stream that was waiting behind it when it was taken up, µs; no more than it
            was to last.
        latency_s: From its last event's coming to its labels.
    """

    number: int
    segmentation: Segmentation
    t_first: int
    t_last: int
    events: int
    thinned: int
    skipped: int
    lasts_us: int
    behind_us: int
    latency_s: float


@dataclass
class LiveFigures:
    """What became of the events so far.

    Every event received is labelled, thinned or skipped, but for those of windows that are still open.

    Attributes:
        received: Events that came.
        labelled: Events with a label.
        thinned: Events left out of windows that held too many.
        skipped: Events left out between windows, or pushed out of the queue, because the machine was late.
        windows: Windows done.
        windows_late: Of these, those taken up with more than another window's time waiting behind them.
        span_s: Time of the stream from its first event to the last one done.
        latencies_s: Of every window.
    """

    received: int = 0
    labelled: int = 0
    thinned: int = 0
    skipped: int = 0
    windows: int = 0
    windows_late: int = 0
    span_s: float = 0.0
    latencies_s: array[float] = field(default_factory=lambda: array("f"))

    @property
    def rate(self) -> float:
        """Events that came in a second of the stream."""
        return (self.labelled + self.thinned + self.skipped) / self.span_s if self.span_s > 0 else 0.0

    def latency_s(self, quantile: float, *, windows: int | None = None) -> float:
        """A quantile (0..1) of the last windows' latencies, s; of all of them where `windows` is None."""
        chosen = self.latencies_s if windows is None else self.latencies_s[-windows:]
        return float(np.quantile(chosen, quantile)) if len(chosen) else 0.0


@dataclass(frozen=True)
class _Place:
    """Where the next window lies: its events, those skipped before it, its length, what waits behind it."""

    size: int
    skipped: int
    lasts_us: int
    behind_us: int


@dataclass(frozen=True)
class _Task:
    """A window on its way through the engine."""

    future: Future[tuple[Segmentation, float]]
    window: EventArray
    kept: int
    place: _Place


class LiveSegmenter:
    """Segments a live source.

    Args:
        source: Where the events come from.
        camera: Undistorts events; optional.
        config: Settings; the defaults need none.
        thinning: What sizes windows.

    Attributes:
        figures: What became of the events so far.
    """

    def __init__(
        self,
        source: LiveSource,
        *,
        camera: Camera | None = None,
        config: Config | None = None,
        thinning: Thinning | None = None,
    ) -> None:
        self._source = source
        self._config = config or Config()
        self._camera = camera
        self._thinning = thinning or Thinning()
        self._cores = self._config.threads or len(os.sched_getaffinity(0))
        self._lanes = min(self._cores, _AT_A_TIME)
        threads = replace(self._config, threads=max(1, self._cores // _AT_A_TIME))
        width, height = source.size
        self._segmenters = [Segmenter(width, height, camera, threads) for _ in range(self._lanes)]
        self._windows = Segmenter(width, height, camera, threads)  # finds their lengths while those work
        self._queue = EventQueue()
        self._nominal_us = round((self._config.window_duration or 0) * 1e6)
        self._ended = threading.Event()
        self._skipped = 0
        self._origin: int | None = None
        # By the windows that are done; read while the next ones start:
        self._wanted_us = FIRST_TRIAL_US
        self._tracked: list[TrackedMotion] = []
        self.figures = LiveFigures()

    def run(self) -> Iterator[LiveWindow]:
        """The windows in order, each as soon as it is done; until the source ends or is stopped.

        Raises:
            ReadError: the source cannot be read on.
        """
        tasks: queue.SimpleQueue[_Task | BaseException | None] = queue.SimpleQueue()
        receiver = threading.Thread(target=self._receive, name="emseg-receive", daemon=True)
        starter = threading.Thread(target=self._start_windows, args=(tasks,), name="emseg-start", daemon=True)
        receiver.start()
        starter.start()
        tracker = self._windows.tracker()
        try:
            while (task := tasks.get()) is not None:
                if isinstance(task, BaseException):
                    raise task
                yield self._finish(task, tracker)
        finally:
            self._ended.set()
            self._source.stop()
            receiver.join()
            starter.join()

    def _receive(self) -> None:
        try:
            for chunk in self._source.chunks():
                self._queue.put(chunk)
        except BaseException as error:  # raised again by `run`
            self._queue.close(error)
        else:
            self._queue.close()

    def _start_windows(self, tasks: queue.SimpleQueue[_Task | BaseException | None]) -> None:
        try:
            with ThreadPoolExecutor(self._lanes) as executor:
                self._start_all(executor, tasks)
        except BaseException as error:  # raised again by `run`
            tasks.put(error)
        else:
            tasks.put(None)

    def _start_all(
        self, executor: ThreadPoolExecutor, tasks: queue.SimpleQueue[_Task | BaseException | None]
    ) -> None:
        """Take up windows as they come and as engines get free; each starts from what the last one found."""
        width, height = self._source.size
        buffer = EventBuffer(self._queue.chunks(), width=width, height=height)
        running: deque[_Task] = deque()
        last: Segmentation | None = None
        count = 0
        while not self._ended.is_set():
            if len(running) == self._lanes:
                last, seconds = running[0].future.result()
                self._thinning.note(running.popleft().kept, seconds)
            duration = self._wanted_us
            size = self._windows.window_size(buffer, duration)
            if not size:
                return
            place = self._catch_up(buffer, size, duration)
            window = buffer.take(place.size)
            kept = self._thin(window, place)
            known: KnownMotions = {} if last is None else known_motions(last, self._tracked)
            engine = self._segmenters[count % self._lanes]
            future = executor.submit(_timed_segment, engine, kept, known)
            task = _Task(future, window, len(kept), place)
            running.append(task)
            tasks.put(task)
            count += 1

    def _catch_up(self, buffer: EventBuffer, size: int, duration: int | None) -> _Place:
        """Skip events while more than a window waits behind the next one, which has `size` events now."""
        skipped = 0
        while True:
            ahead = buffer.look_ahead(count=0)
            last = int(ahead.t[size - 1])
            lasts = max(last - int(ahead.t[0]), duration or 0, self._nominal_us)
            newest = self._queue.newest_t
            behind = 0 if newest is None else newest - last
            if behind <= lasts:
                return _Place(size, skipped, lasts, behind)
            self.figures.windows_late += not skipped
            # Looking ahead to these events does not wait: they have come.
            edge = last + behind - lasts
            ahead = buffer.look_ahead(duration_us=edge - int(ahead.t[0]))
            skipped += len(buffer.take(int(np.searchsorted(ahead.t, edge))))
            size = self._windows.window_size(buffer, duration or lasts)

    def _thin(self, window: EventArray, place: _Place) -> EventArray:
        """As many of a window's events as its engine can do before the next window is there for it."""
        time_us = self._lanes * place.lasts_us - place.behind_us / 2  # some of it makes up for being late
        kept = self._thinning.keep(len(window), time_us * 1e-6 / self._source.pace)
        return window if kept >= len(window) else window[even_sample(len(window), kept)]

    def _finish(self, task: _Task, tracker: Tracker) -> LiveWindow:
        """Number the objects, count the events, and note how long it all took."""
        found, _ = task.future.result()
        objects = tracker.assign(found.events, found.labels, found.models, found.t_ref)
        self._wanted_us = next_duration(found.duration, objects)
        self._tracked = tracker.motions()
        figures, window = self.figures, task.window
        start = figures.labelled
        latency = time.monotonic() - self._queue.arrival(int(window.t[-1]))
        thinned = len(window) - task.kept
        if self._origin is None:
            self._origin = int(window.t[0])
        figures.labelled += task.kept
        figures.thinned += thinned
        self._skipped += task.place.skipped
        figures.skipped = self._skipped + self._queue.dropped
        figures.windows += 1
        figures.span_s = (int(window.t[-1]) - self._origin) * 1e-6
        figures.latencies_s.append(latency)
        figures.received = self._queue.received
        return LiveWindow(
            number=figures.windows - 1,
            segmentation=found.relabelled(objects, start=start),
            t_first=int(window.t[0]),
            t_last=int(window.t[-1]),
            events=len(window),
            thinned=thinned,
            skipped=task.place.skipped,
            lasts_us=task.place.lasts_us,
            behind_us=task.place.behind_us,
            latency_s=latency,
        )


def _timed_segment(engine: Segmenter, window: EventArray, known: KnownMotions) -> tuple[Segmentation, float]:
    began = time.perf_counter()
    found = engine.find_motions(window, **known)
    return found, time.perf_counter() - began
