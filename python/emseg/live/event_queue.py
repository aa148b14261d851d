"""A bounded queue between the thread that receives events and the one that segments them."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Final

from emseg.events import EventArray

__all__ = ["EventQueue"]

CAPACITY: Final = 4_000_000
"""Events, of 13 bytes each."""


class EventQueue:
    """Chunks of events in order, with the times at which they came.

    Where more come than it holds, the oldest go, so that a receiver never waits.

    Args:
        capacity: The number of events that it holds at the most; a single larger chunk is held all the same.

    Attributes:
        received: Events put in so far.
        dropped: Events that went unseen.
        newest_t: Time of the last event put in, µs; None before the first.
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._chunks: deque[EventArray] = deque()
        self._size = 0
        self._arrivals: deque[tuple[int, float]] = deque()  # last event's time, when it came
        self._closed = False
        self._error: BaseException | None = None
        self._changed = threading.Condition()
        self.received = 0
        self.dropped = 0
        self.newest_t: int | None = None

    def put(self, chunk: EventArray) -> None:
        """Add events that have just come."""
        if not len(chunk):
            return
        with self._changed:
            self._chunks.append(chunk)
            self._size += len(chunk)
            self.received += len(chunk)
            self.newest_t = int(chunk.t[-1])
            self._arrivals.append((self.newest_t, time.monotonic()))
            while self._size > self._capacity and len(self._chunks) > 1:
                oldest = self._chunks.popleft()
                self._size -= len(oldest)
                self.dropped += len(oldest)
            self._changed.notify()

    def close(self, error: BaseException | None = None) -> None:
        """No more events will come; `error` is why, if it is one."""
        with self._changed:
            self._closed, self._error = True, error
            self._changed.notify()

    def chunks(self) -> Iterator[EventArray]:
        """The chunks, each waited for; ends, or raises the error, when the queue is closed and empty."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._chunks) or self._closed)
                if not self._chunks:
                    if self._error is not None:
                        raise self._error
                    return
                chunk = self._chunks.popleft()
                self._size -= len(chunk)
            yield chunk

    def arrival(self, t: int) -> float:
        """When the event of time t (µs) came, by the monotonic clock; forgets earlier arrivals."""
        with self._changed:
            while len(self._arrivals) > 1 and self._arrivals[0][0] < t:
                self._arrivals.popleft()
            return self._arrivals[0][1] if self._arrivals else time.monotonic()
