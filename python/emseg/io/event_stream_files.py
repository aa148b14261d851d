"""Event Stream (.es) recordings, version 2."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from emseg import _core
from emseg.io.errors import ReadError
from emseg.io.recording import BLOCK_EVENTS, Block, ReadOptions, Source, at

__all__ = ["EVENT_STREAM", "EventStreamReader"]

_MAGIC: Final = b"Event Stream"
_HEADER_BYTES: Final = 20  # name, version, type, width, height
_TYPES: Final = ("generic", "dvs", "atis", "asynchronous atis", "color")


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
        kinds = {"dvs": _core.EventStreamKind.dvs, "atis": _core.EventStreamKind.atis}
        kind = _TYPES[head[15]] if head[15] < len(_TYPES) else str(head[15])
        if kind not in kinds:
            raise ReadError(path, f"holds events of type {kind}, expected dvs or atis", place="byte 15")
        self._path, self._kind = path, kinds[kind]
        width, height = (int.from_bytes(head[place : place + 2], "little") for place in (16, 18))
        if not width or not height:
            raise ReadError(path, f"sensor is {width}x{height}, expected pixels", place="byte 16")
        self.size = width, height

    def blocks(self) -> Iterator[Block]:
        decoder = _core.EventStreamDecoder(self._kind)
        position = _HEADER_BYTES
        with self._path.open("rb") as file:
            file.seek(position)
            while data := file.read(BLOCK_EVENTS):
                x, y, t, p = decoder.decode(np.frombuffer(data, np.uint8))
                yield Block(x, y, t, p, at(f"bytes {position} to {position + len(data) - 1}"))
                position += len(data)
        if decoder.pending:
            raise ReadError(
                self._path, "truncated inside an event", place=f"byte {position - decoder.pending}"
            )


EVENT_STREAM = EventStreamReader()
