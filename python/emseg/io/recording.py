"""Open recordings: what every format comes down to, read chunk by chunk and checked in one place."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Self, get_args

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray
from emseg.io.errors import ReadError
from emseg.io.sensors import guess_size

__all__ = [
    "BLOCK_EVENTS",
    "Block",
    "Damage",
    "Frame",
    "ImuSamples",
    "ReadOptions",
    "Recording",
    "Source",
    "at",
    "check_span",
]

_log = logging.getLogger(__name__)

BLOCK_EVENTS: Final = 1 << 19
"""Events that readers give at a time, more or less: it bounds the memory of walking a recording."""

_WORTHWHILE_EVENTS: Final = 1 << 16
_FOREVER_S: Final = 1e13
_LAST_TIME: Final = (1 << 63) - 1

Damage = Literal["refuse", "keep"]
"""What to do about damage: refuse the file, or keep what can be read of it."""


@dataclass(frozen=True)
class ReadOptions:
    """What a caller says about a file that the file does not say itself.

    Attributes:
        size: Width and height of the sensor, px, instead of what the file says or lets guess.
        stream: Which event stream to read where there are several: a topic, group, variable or name;
            None: the first.
        columns: Order of the columns of text without a header, such as "xytp".
        time_unit: Unit of the times, "s" or "us", where it cannot be told; None: seconds where they are
            fractions.
    """

    size: tuple[int, int] | None = None
    stream: str | None = None
    columns: str | None = None
    time_unit: Literal["s", "us"] | None = None

    def __post_init__(self) -> None:
        if self.columns is not None and sorted(self.columns) != sorted("txyp"):
            raise ValueError(
                f"columns are {self.columns!r}, expected an order of t, x, y and p such as 'txyp'"
            )
        if self.time_unit not in (None, "s", "us"):
            raise ValueError(f"time unit is {self.time_unit!r}, expected 's' or 'us'")


@dataclass(frozen=True)
class Block:
    """Events as a format gives them, not yet checked: columns (n,) of numbers, times in µs.

    Attributes:
        x, y, t, p: Columns; t of whole numbers.
        locate: The place in the file of the k-th event, for messages.
    """

    x: npt.NDArray[Any]
    y: npt.NDArray[Any]
    t: npt.NDArray[Any]
    p: npt.NDArray[Any]
    locate: Callable[[int], str] | None = None


@dataclass(frozen=True)
class Frame:
    """A picture taken beside the events.

    Attributes:
        t: Time, µs: the beginning of its exposure, or what its format has for one.
        image: (h, w), or (h, w, channels) in the order of the file.
    """

    t: int
    image: npt.NDArray[Any]


@dataclass(frozen=True)
class ImuSamples:
    """Inertial measurements in the sensor's own axes.

    Attributes:
        t: Times, int64 (n,), µs.
        angular_velocity: float64 (n, 3), rad/s.
        acceleration: float64 (n, 3), m/s².
    """

    t: npt.NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    angular_velocity: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    acceleration: npt.NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def concatenate(cls, parts: list[ImuSamples]) -> ImuSamples:
        """All samples of `parts`, one after the other."""
        if not parts:
            return cls()
        columns = ("t", "angular_velocity", "acceleration")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))


def at(place: str) -> Callable[[int], str]:
    """What locates all events of a block at one place."""
    return lambda event: place


class Source:
    """A file of one format, opened: each format derives from this.

    Its blocks may be walked several times, each time from the start.  Whatever it raises is reported as
    damage of the file; a :class:`ReadError` says where and what.

    Attributes:
        size: Width and height of the sensor, px, where the file says them.
        streams: Names of the file's event streams, where it may have several; the first is read.
        format: What its format is called, where that says more than the reader's name.
    """

    format: str | None = None
    size: tuple[int, int] | None = None
    streams: tuple[str, ...] = ()

    def blocks(self) -> Iterator[Block]:
        """The events in order, some at a time."""
        raise NotImplementedError

    def frames(self) -> Iterator[Frame]:
        """Pictures in order of time."""
        yield from ()

    def imu(self) -> ImuSamples:
        """All inertial measurements, in order of time."""
        return ImuSamples()

    def close(self) -> None:
        """Release the file."""


class Recording:
    """A recording that is open for reading: a context manager that closes it.

    Args:
        path: The file.
        format_name: What its format is called.
        source: The opened file.
        size: Width and height of the sensor, px, instead of what the file says.
        damage: "refuse": raise at the first fault.  "keep": leave out events that lie outside the sensor,
            have no polarity or come earlier than one before them, and end where the file cannot be decoded
            any further; what was left out is logged as a warning.
    """

    def __init__(
        self,
        path: Path,
        format_name: str,
        source: Source,
        *,
        size: tuple[int, int] | None = None,
        damage: Damage = "refuse",
    ) -> None:
        if damage not in get_args(Damage):
            raise ValueError(f"damage is {damage!r}, expected 'refuse' or 'keep'")
        self.path, self.damage = path, damage
        self.format = source.format or format_name
        self._source = source
        self._size = size or source.size
        self._warned: set[str] = set()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor, px.

        Where the file does not say them they are guessed from all its coordinates, which walks it once.

        Raises:
            ReadError: where there is nothing to guess them from.
        """
        if self._size is None:
            right, bottom = -1.0, -1.0
            for _, block in self._blocks():
                if len(block.t):
                    right, bottom = max(right, _largest(block.x)), max(bottom, _largest(block.y))
            try:
                self._size = guess_size(right, bottom, self.path)
            except ValueError as error:
                raise ReadError(self.path, str(error)) from None
        return self._size

    @property
    def width(self) -> int:
        """Width of the sensor, px; see :attr:`size`."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Height of the sensor, px; see :attr:`size`."""
        return self.size[1]

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the file's event streams, where it may have several."""
        return self._source.streams

    def chunks(self, *, span: tuple[float, float] | None = None) -> Iterator[EventArray]:
        """The events in order, some at a time, however long the recording is.

        Args:
            span: Seconds from the first event, from (inclusive) and to (exclusive); None: all.

        Raises:
            ReadError: at the first fault, unless damage is to be kept.
        """
        check_span(span)
        origin: int | None = None
        for chunk in self._checked():
            if span is None:
                yield chunk
                continue
            if origin is None:
                origin = int(chunk.t[0])
            start, stop = (min(origin + round(min(edge, _FOREVER_S) * 1e6), _LAST_TIME) for edge in span)
            part = chunk.between(start, stop)
            if len(part):
                yield part
            if int(chunk.t[-1]) >= stop:
                return

    def read(self, *, span: tuple[float, float] | None = None) -> EventArray:
        """All events, or those of a span; see :meth:`chunks`."""
        parts = list(self.chunks(span=span))
        if len(parts) == 1:
            return parts[0]
        width, height = self.size
        return EventArray.concatenate([EventArray([], [], [], [], width=width, height=height), *parts])

    def frames(self) -> Iterator[Frame]:
        """The pictures beside the events, in order of time; none where the file has none."""
        yield from self._guarded(self._source.frames(), "frames")

    def imu(self) -> ImuSamples:
        """The inertial measurements beside the events; empty where the file has none."""

        def samples() -> Iterator[ImuSamples]:
            yield self._source.imu()

        return next(iter(self._guarded(samples(), "imu")), ImuSamples())

    def close(self) -> None:
        """Release the file."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _guarded(self, items: Iterator[Any], what: str) -> Iterator[Any]:
        """The items, whatever ends them being an error of reading, or the end where damage is kept."""
        count = 0
        while True:
            try:
                item = next(items)
            except StopIteration:
                return
            except ReadError as error:
                fault = error
            except (Exception, MemoryError) as error:  # what damage makes of other people's decoders
                _log.debug("%s: %s", self.path, what, exc_info=True)
                lines = str(error).strip().splitlines()
                reason = f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
                fault = ReadError(self.path, f"truncated or damaged: {reason}")
            else:
                count += len(item.t) if isinstance(item, Block) else 1
                yield item
                continue
            if self.damage == "refuse":
                raise fault from None
            self._warn(f"{fault}; kept the {what} before it: {count}")
            return

    def _blocks(self) -> Iterator[tuple[int, Block]]:
        """Blocks that hold events, each with the number of events before it."""
        before = 0
        for block in _joined(self._guarded(self._source.blocks(), "events")):
            yield before, block
            before += len(block.t)

    def _checked(self) -> Iterator[EventArray]:
        width, height = self.size
        last: int | None = None
        left_out, first_fault = 0, ""
        for before, block in self._blocks():
            try:
                chunk = EventArray(block.x, block.y, block.t, block.p, width=width, height=height)
                sound = last is None or int(chunk.t[0]) >= last
            except ValueError as error:
                sound, reason = False, str(error)
            if not sound:
                faults = _Faults(block, width, height, last)
                if faults.first is None:  # no single event is at fault, but a column as a whole
                    raise ReadError(self.path, reason)
                place = block.locate(faults.first) if block.locate else ""
                problem = f"event {before + faults.first} {faults.reason(faults.first)}"
                error_here = ReadError(self.path, problem, place=place or None)
                if self.damage == "refuse":
                    raise error_here
                first_fault = first_fault or str(error_here)
                left_out += int(faults.faulty.sum())
                good = ~faults.faulty
                columns = ((column[good]) for column in (block.x, block.y, block.t, block.p))
                chunk = EventArray(*columns, width=width, height=height)
            if len(chunk):
                last = int(chunk.t[-1])
                yield chunk
        if left_out:
            self._warn(f"{first_fault}; {left_out} such events left out")

    def _warn(self, message: str) -> None:
        """Say what is lost: once, though the recording may be walked several times."""
        if message not in self._warned:
            self._warned.add(message)
            _log.warning("%s", message)


def _joined(blocks: Iterator[Block]) -> Iterator[Block]:
    """The same events in blocks that are worth their overhead; none is empty."""
    waiting: list[Block] = []
    count = 0
    for block in blocks:
        if len(block.t):
            waiting.append(block)
            count += len(block.t)
        if count >= _WORTHWHILE_EVENTS:
            yield _join(waiting)
            waiting, count = [], 0
    if waiting:
        yield _join(waiting)


def _join(blocks: list[Block]) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    starts = np.cumsum([0, *(len(block.t) for block in blocks)])

    def locate(event: int) -> str:
        k = int(np.searchsorted(starts, event, side="right")) - 1
        place = blocks[k].locate
        return place(event - int(starts[k])) if place else ""

    x, y, t, p = (np.concatenate([getattr(block, name) for block in blocks]) for name in "xytp")
    return Block(x, y, t, p, locate)


class _Faults:
    """Which events of a block cannot stay, and why: found slowly, once a quick check has failed."""

    def __init__(self, block: Block, width: int, height: int, last: int | None) -> None:
        self._block, self._size = block, (width, height)
        self._polarities = (0, 1) if not len(block.p) or block.p.min() >= 0 else (-1, 1)
        self._outside = _outside(block.x, width) | _outside(block.y, height)
        self._no_polarity = ~np.isin(block.p, self._polarities)
        self.faulty = self._outside | self._no_polarity
        # Only events that stay move the clock.
        earliest = np.iinfo(np.int64).min if last is None else last
        clock = np.maximum.accumulate(np.where(self.faulty, earliest, block.t.astype(np.int64)))
        self._clock = np.maximum(np.concatenate([[earliest], clock[:-1]]), earliest)
        self._late = ~self.faulty & (block.t < self._clock)
        self.faulty |= self._late
        self.first = int(np.argmax(self.faulty)) if self.faulty.any() else None

    def reason(self, k: int) -> str:
        """What is wrong with event k."""
        block = self._block
        if self._outside[k]:
            width, height = self._size
            return f"lies at ({block.x[k]}, {block.y[k]}), outside the sensor of {width}x{height}"
        if self._no_polarity[k]:
            low, high = self._polarities
            return f"has polarity {block.p[k]}, expected {low} or {high}"
        earlier = f"before its predecessor's {self._clock[k]} us"
        return f"has time {block.t[k]} us, {earlier}; events must be sorted by time"


def _largest(column: npt.NDArray[Any]) -> float:
    """The largest number but NaN, which the check of every event is to find."""
    return float(np.fmax.reduce(column) if column.dtype.kind == "f" else column.max())


def _outside(column: npt.NDArray[Any], side: int) -> npt.NDArray[np.bool_]:
    if column.dtype.kind == "f":
        with np.errstate(invalid="ignore"):  # NaN and fractions lie nowhere
            column = np.where(column == np.floor(column), column, -1)
    outside: npt.NDArray[np.bool_] = (column < 0) | (column >= side)
    return outside


def check_span(span: tuple[float, float] | None) -> None:
    """Refuse a span that no recording could have.

    Raises:
        ValueError: unless 0 ≤ start < stop.
    """
    if span is not None and not 0 <= span[0] < span[1]:
        raise ValueError(f"span is {span[0]:g} to {span[1]:g} s, expected 0 <= start < stop")
