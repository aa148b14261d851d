"""Event Stream (.es) recordings, read by the package event_stream."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from emseg.io.errors import ReadError
from emseg.io.extras import require
from emseg.io.recording import Block, ReadOptions, Source

__all__ = ["EVENT_STREAM", "EventStreamReader"]

_MAGIC: Final = b"Event Stream"
_HEADER_BYTES: Final = 20  # version, type, width, height after the magic
_TYPES: Final = ("generic", "dvs", "atis", "asynchronous ATIS", "color")
_DVS, _ATIS = 1, 2


class EventStreamReader:
    """Event Stream: DVS events, or the change detections of ATIS events."""

    name = "Event Stream (.es)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's name."""
        return head.startswith(_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _EventStreamSource(path)


class _EventStreamSource(Source):
    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
        if len(head) < _HEADER_BYTES:
            raise ReadError(path, "truncated inside its header", place=f"byte {len(head)}")
        if head[12] != 2:
            raise ReadError(path, f"is of version {head[12]}, expected 2", place="byte 12")
        if head[15] not in (_DVS, _ATIS):
            kind = _TYPES[head[15]] if head[15] < len(_TYPES) else str(head[15])
            raise ReadError(path, f"holds events of type {kind}, expected dvs or atis", place="byte 15")
        self._library: Any = require("event_stream", "event_stream", "an Event Stream file", path)
        self._path, self._kind = path, head[15]
        width, height = (int.from_bytes(head[at : at + 2], "little") for at in (16, 18))
        if not width or not height:
            raise ReadError(path, f"sensor is {width}x{height}", place="byte 16")
        self.size = width, height

    def blocks(self) -> Iterator[Block]:
        with self._library.Decoder(str(self._path)) as decoder:
            for chunk in decoder:
                events = chunk if self._kind == _DVS else chunk[~chunk["exposure"]]
                rise = events["on" if self._kind == _DVS else "polarity"]
                if len(events) and int(events["t"].max()) >= 2**63:
                    raise ReadError(self._path, "damaged: times beyond 64 bits")
                yield Block(events["x"], events["y"], events["t"].astype(np.int64), rise.astype(np.uint8))


EVENT_STREAM = EventStreamReader()
