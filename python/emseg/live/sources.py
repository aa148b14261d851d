"""Where live events come from: a camera, a network stream, or a recording played at its own pace."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Protocol
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray
from emseg.io import ReadError
from emseg.io.extras import require
from emseg.reading import Reading

__all__ = ["DvSource", "FileSource", "LiveSource", "open_source"]

_log = logging.getLogger(__name__)

_POLL_S: Final = 0.001
_PLAY_STEP_US: Final = 2_000  # of a recording, handed over at a time


class LiveSource(Protocol):
    """A stream of events that comes at its own pace, of which no event waits.

    Attributes:
        name: What it is called in messages.
        size: Width and height of the sensor, px.
        pace: Seconds of the stream that come in a second.
    """

    name: str
    size: tuple[int, int]
    pace: float

    def chunks(self) -> Iterator[EventArray]:
        """The events as they come, until the stream ends or `stop` was called.

        Raises:
            ReadError: the stream cannot be read on.
        """

    def stop(self) -> None:
        """End the stream, from any thread."""


class FileSource:
    """A recording, played as if it were happening.

    Args:
        path: The recording.
        pace: Seconds of it to play in a second.
        reading: What of it to play.

    Raises:
        ReadError: it cannot be read.
        ValueError: the pace is not above 0.
    """

    def __init__(self, path: Path, *, pace: float = 1.0, reading: Reading | None = None) -> None:
        if not pace > 0 or not np.isfinite(pace):
            raise ValueError(f"pace is {pace}, expected a number above 0")
        self.name, self.pace = str(path), pace
        self._path, self._reading = path, reading or Reading()
        self._stopped = threading.Event()
        with self._reading.open(path) as part:
            self.size = part.size

    def chunks(self) -> Iterator[EventArray]:
        """See :meth:`LiveSource.chunks`."""
        began, origin = 0.0, 0
        with self._reading.open(self._path) as part:
            for events in part.chunks:
                if not began:
                    began, origin = time.monotonic(), int(events.t[0])
                for piece in self._pieces(events):
                    due = began + (int(piece.t[-1]) - origin) * 1e-6 / self.pace
                    if self._stopped.wait(max(0.0, due - time.monotonic())):
                        return
                    yield piece

    def _pieces(self, events: EventArray) -> Iterator[EventArray]:
        t = events.t
        step = max(1, round(_PLAY_STEP_US * self.pace))
        start = 0
        while start < len(t):
            stop = int(np.searchsorted(t, int(t[start]) + step))
            yield events[start:stop]
            start = stop

    def stop(self) -> None:
        """See :meth:`LiveSource.stop`."""
        self._stopped.set()


class DvSource:
    """What dv-processing receives: an iniVation camera or a network stream.

    Events outside the sensor or earlier than one before them are left out, with a warning.

    Args:
        name: What it is called in messages.
        capture: dv-processing's camera or network reader.

    Raises:
        ReadError: it has no events.
    """

    pace = 1.0

    def __init__(self, name: str, capture: Any) -> None:
        resolution = capture.getEventResolution() if capture.isEventStreamAvailable() else None
        if resolution is None:
            raise ReadError(name, "has no stream of events of a sensor of known size")
        self.name, self.capture = name, capture
        self.size = int(resolution[0]), int(resolution[1])
        self._stopped = threading.Event()
        self._last = np.iinfo(np.int64).min
        self._faulty = 0

    def stores(self) -> Iterator[Any]:
        """dv-processing's event stores as they come, until the stream ends or is stopped."""
        while not self._stopped.is_set():
            running = self.capture.isRunning()
            store = self.capture.getNextEventBatch()
            if store is not None and not store.isEmpty():
                yield store
            elif not running:
                return
            else:
                time.sleep(_POLL_S)

    def chunks(self) -> Iterator[EventArray]:
        """See :meth:`LiveSource.chunks`."""
        for store in self.stores():
            events = self._sound(store.numpy())
            if len(events):
                yield events

    def _sound(self, records: npt.NDArray[Any]) -> EventArray:
        width, height = self.size
        x, y, t = (np.array(records[name]) for name in ("x", "y", "timestamp"))
        p = np.array(records["polarity"], np.uint8)
        sound = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        clock = np.maximum.accumulate(np.concatenate([[self._last], np.where(sound, t, self._last)]))
        sound &= t >= clock[:-1]
        if not sound.all():
            if not self._faulty:
                _log.warning("%s: leaves out events outside the sensor or going back in time", self.name)
            self._faulty += int(np.count_nonzero(~sound))
            x, y, t, p = x[sound], y[sound], t[sound], p[sound]
        self._last = int(clock[-1])
        return EventArray(x.astype(np.uint16), y.astype(np.uint16), t, p, width=width, height=height)

    def stop(self) -> None:
        """See :meth:`LiveSource.stop`."""
        self._stopped.set()


def open_source(source: str, *, pace: float | None = None, reading: Reading | None = None) -> LiveSource:
    """The stream that a name stands for.

    Args:
        source: "camera" for the first iniVation camera found, "camera:SERIAL" for a certain one;
            "tcp://host:port" for a network stream of dv-processing; else a recording's path.
        pace: Of a recording; None: its own.
        reading: What of a recording is played.

    Raises:
        ReadError: it cannot be opened.
        ValueError: something was asked for that only a recording can do.
    """
    scheme, _, rest = source.partition(":")
    if scheme != "camera" and not source.startswith("tcp://"):
        return FileSource(Path(source), pace=1.0 if pace is None else pace, reading=reading)
    if pace is not None or (reading is not None and reading != Reading()):
        raise ValueError(f"{source} is no recording: it has a pace of its own, and comes whole")
    dv: Any = require("dv_processing", "dv-processing", "a live stream", Path(source))
    if scheme == "camera":
        if not dv.io.camera.discover():
            raise ReadError(source, "no iniVation camera is connected, or none that may be opened")
        try:
            return DvSource(source, dv.io.camera.open(rest) if rest else dv.io.camera.open())
        except (RuntimeError, ValueError, IndexError) as error:
            raise ReadError(source, f"cannot be opened: {_first_words(error)}") from None
    try:
        parts = urlsplit(source)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or not port:
        raise ReadError(source, "expected tcp://host:port")
    try:
        return DvSource(source, dv.io.NetworkReader(_address(host), port))
    except (RuntimeError, OSError) as error:
        raise ReadError(source, f"cannot be reached: {_first_words(error)}") from None


def _address(host: str) -> str:
    """A host's number: dv-processing knows no names."""
    import socket

    return socket.gethostbyname(host)


def _first_words(error: BaseException) -> str:
    """A message of dv-processing's without its places in C++ sources."""
    return (str(error).partition(" [")[0].splitlines() or [""])[0][:200]
