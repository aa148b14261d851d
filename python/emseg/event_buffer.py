"""A stream of events, looked at some way ahead and taken from the front, in memory that does not grow."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from emseg.events import EventArray

__all__ = ["EventBuffer"]


class EventBuffer:
    """The events of a recording that are still to come.

    It holds no more than was asked to be seen ahead, and a chunk.

    Args:
        chunks: A whole recording, which is not copied; or its events in order, some at a time.
        width: Width of the sensor, px.
        height: Height of the sensor, px.

    Attributes:
        taken: The number of events taken so far.
        origin: Time of the recording's first event, µs; None before it has been seen.
    """

    def __init__(self, chunks: EventArray | Iterable[EventArray], *, width: int, height: int) -> None:
        self._chunks = iter([chunks] if isinstance(chunks, EventArray) else chunks)
        self._held = EventArray([], [], [], [], width=width, height=height)
        self._last: int | None = None
        self.taken = 0
        self.origin: int | None = None

    def look_ahead(self, *, count: int | None = None, duration_us: int | None = None) -> EventArray:
        """The events to come, as far as asked for: at least one of them if any is left.

        Args:
            count: This many events and one more are far enough; None: however many.
            duration_us: An event so long after the first is far enough, µs; None: however long.

        Raises:
            ValueError: a chunk is of another sensor, or begins before the one before it ends.
        """
        parts = [self._held] if len(self._held) else []
        size = len(self._held)
        while not (
            size
            and (
                (count is not None and size > count)
                or (duration_us is not None and int(parts[-1].t[-1]) - int(parts[0].t[0]) >= duration_us)
            )
        ):
            chunk = next(self._chunks, None)
            if chunk is None:
                break
            self._check(chunk, self.taken + size)
            if len(chunk):
                parts.append(chunk)
                size += len(chunk)
        if parts:
            self._held = parts[0] if len(parts) == 1 else EventArray.concatenate(parts)
        return self._held

    def count_to_multiple(self, duration_us: int) -> int:
        """How many events come before the next multiple of a duration, µs, counted from `origin`."""
        ahead = self.look_ahead(duration_us=duration_us)
        if not len(ahead) or self.origin is None:
            return 0
        past = (int(ahead.t[0]) - self.origin) % duration_us
        edge = int(ahead.t[0]) - past + duration_us
        return len(ahead) if edge > int(ahead.t[-1]) else int(np.searchsorted(ahead.t, edge))

    def count_within(self, duration_us: int, *, most: int) -> int:
        """How many events come within a duration, µs, of the next one; no more than `most`."""
        ahead = self.look_ahead(count=most, duration_us=duration_us)[:most]
        if not len(ahead):
            return 0
        edge = int(ahead.t[0]) + duration_us
        return len(ahead) if edge > int(ahead.t[-1]) else int(np.searchsorted(ahead.t, edge))

    def count_to_end(self, duration_us: int, *, most: int) -> int:
        """As `count_within`, but the end of the recording leaves no crumb, in which hardly anything moves.

        What lasts less than two durations is halved; one and a quarter stay whole.
        """
        count = self.count_within(duration_us, most=most)
        ahead = self.look_ahead(count=2 * most, duration_us=2 * duration_us)
        if not count or len(ahead) > 2 * most:
            return count
        left = int(ahead.t[-1]) - int(ahead.t[0]) + 1
        if left >= 2 * duration_us:
            return count
        return self.count_within(left if 4 * left <= 5 * duration_us else -(-left // 2), most=most)

    def take(self, count: int) -> EventArray:
        """The next `count` events, of those that were seen ahead; the buffer has them no longer."""
        front, self._held = self._held[:count], self._held[count:]
        self.taken += len(front)
        return front

    def _check(self, chunk: EventArray, number: int) -> None:
        if (chunk.width, chunk.height) != (self._held.width, self._held.height):
            raise ValueError(
                f"the events' sensor is {chunk.width}x{chunk.height}, "
                f"the segmenter's {self._held.width}x{self._held.height}"
            )
        if not len(chunk):
            return
        first = int(chunk.t[0])
        if self._last is not None and first < self._last:
            raise ValueError(f"event {number} has t = {first}, expected {self._last} or later as before it")
        self._last = int(chunk.t[-1])
        self.origin = first if self.origin is None else self.origin
