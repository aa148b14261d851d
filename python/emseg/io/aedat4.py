"""AEDAT 4 recordings of iniVation's DV: DAVIS and DVXplorer cameras.

The format (inivation.github.io, "AEDAT file formats"): a version line; a header, of which the XML names the
streams; packets, each the number of its stream, its length and a FlatBuffer that may be compressed; a table
of the packets.  Decoded here rather than by dv-processing, whose native code was seen to spin for ever on
damaged files; it confirms the results in the tests.
"""

from __future__ import annotations

import struct
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from emseg.io.errors import ReadError
from emseg.io.extras import require
from emseg.io.flat_buffers import Table, root_table
from emseg.io.recording import BLOCK_EVENTS, Block, Frame, ImuSamples, ReadOptions, Source, at

__all__ = ["AEDAT4", "Aedat4Reader"]

_MAGIC: Final = b"#!AER-DAT4.0\r\n"
_NO_TABLE: Final = -1  # where a recording was cut off before its table of packets was written
_PACKET_HEADER: Final = struct.Struct("<ii")
_LARGEST_PACKET: Final = 1 << 28  # unpacked
_COMPRESSIONS: Final = ("none", "lz4", "lz4 high", "zstd", "zstd high")
_SIZE_PREFIX: Final = 4
_G: Final = 9.80665
_EVENT: Final = np.dtype(
    {
        "names": ["t", "x", "y", "p"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
_CHANNELS: Final = {0: 1, 16: 3, 24: 4}  # by OpenCV's number of the frame's format


@dataclass(frozen=True)
class _Stream:
    number: int
    name: str
    kind: str  # EVTS, FRME, IMUS, ...
    size: tuple[int, int] | None


class Aedat4Reader:
    """Events, frames and inertial measurements of an AEDAT 4 recording."""

    name = "AEDAT 4 (.aedat4)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's version line."""
        return head.startswith(_MAGIC[:-2])

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _Aedat4Source(path, options)


class _Aedat4Source(Source):
    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path = path
        with path.open("rb") as file:
            magic, prefix = file.read(len(_MAGIC)), file.read(_SIZE_PREFIX)
            if magic != _MAGIC:
                raise ReadError(path, f"expected {_MAGIC!r}", place="byte 0")
            length = int.from_bytes(prefix, "little")
            self._start = len(_MAGIC) + _SIZE_PREFIX + length
            self._bytes = path.stat().st_size
            if len(prefix) < _SIZE_PREFIX or self._start > self._bytes:
                raise ReadError(path, "truncated inside its header", place=f"byte {self._bytes}")
            header = file.read(length)
        try:
            table = root_table(header)
            compression = table.scalar(0, "<i", 0)
            self._end = table.scalar(1, "<q", _NO_TABLE)
            self._streams = _streams(table.string(2))
        except (struct.error, ElementTree.ParseError, ValueError) as error:
            problem = f"damaged header: {error}"
            raise ReadError(path, problem, place=f"byte {len(_MAGIC)}") from None
        if not 0 <= compression < len(_COMPRESSIONS):
            problem = f"compression {compression}, expected 0..{len(_COMPRESSIONS) - 1}"
            raise ReadError(path, problem, place=f"byte {len(_MAGIC)}")
        self._unpack = _unpacker(_COMPRESSIONS[compression], path)
        events = [stream for stream in self._streams if stream.kind == "EVTS"]
        self.streams = tuple(stream.name for stream in events)
        chosen = [stream for stream in events if options.stream in (None, stream.name)]
        if not chosen:
            asked = f" {options.stream!r}" if events and options.stream else ""
            listed = ", ".join(f"{stream.name} ({stream.kind})" for stream in self._streams)
            raise ReadError(path, f"it holds no event stream{asked}; its streams: {listed or 'none'}")
        self._events = chosen[0]
        self.size = chosen[0].size

    def blocks(self) -> Iterator[Block]:
        for position, table in self._packets({self._events.number}):
            records = np.frombuffer(table.structs(0, _EVENT.itemsize), _EVENT)
            for start in range(0, len(records), BLOCK_EVENTS):
                part = records[start : start + BLOCK_EVENTS]
                t, x, y, p = (part[name] for name in ("t", "x", "y", "p"))
                yield Block(x, y, t, p, at(f"packet at byte {position}"))

    def frames(self) -> Iterator[Frame]:
        numbers = {stream.number for stream in self._streams if stream.kind == "FRME"}
        for position, table in self._packets(set(sorted(numbers)[:1])):
            # The beginning of the exposure: newer files have it in the first field.
            t = table.scalar(3, "<q", 0) or table.scalar(0, "<q", 0)
            form = table.scalar(5, "<b", 0)
            columns, rows = table.scalar(6, "<h", 0), table.scalar(7, "<h", 0)
            pixels = table.structs(10, 1)
            channels = _CHANNELS.get(form, 0)
            if not channels or columns <= 0 or rows <= 0 or len(pixels) != columns * rows * channels:
                problem = f"damaged: frame of {columns}x{rows}, format {form} and {len(pixels)} bytes"
                raise ReadError(self._path, problem, place=f"byte {position}")
            image = np.frombuffer(pixels, np.uint8).reshape(rows, columns, channels)
            yield Frame(t, image[..., 0] if channels == 1 else image)

    def imu(self) -> ImuSamples:
        numbers = {stream.number for stream in self._streams if stream.kind == "IMUS"}
        rows: list[tuple[float, ...]] = []
        times: list[int] = []
        for _, packet in self._packets(set(sorted(numbers)[:1])):
            for sample in packet.tables(0):
                times.append(sample.scalar(0, "<q", 0))
                rows.append(tuple(sample.scalar(field, "<f", 0.0) for field in range(2, 8)))
        values = np.array(rows, np.float64).reshape(-1, 6)
        return ImuSamples(np.array(times, np.int64), np.deg2rad(values[:, 3:]), values[:, :3] * _G)

    def _packets(self, numbers: set[int]) -> Iterator[tuple[int, Table]]:
        """Position and content of the packets of some streams; the others are passed over."""
        end = self._end if self._end != _NO_TABLE else self._bytes
        position = self._start
        with self._path.open("rb") as file:
            while position < min(end, self._bytes):
                file.seek(position)
                header = file.read(_PACKET_HEADER.size)
                if len(header) < _PACKET_HEADER.size:
                    raise ReadError(
                        self._path, "truncated inside a packet's header", place=f"byte {position}"
                    )
                stream, length = _PACKET_HEADER.unpack(header)
                following = position + _PACKET_HEADER.size + length
                if stream < 0 or length <= 0 or following > min(end, self._bytes):
                    problem = f"packet of stream {stream} and {length} bytes"
                    problem = f"truncated or damaged: {problem}, expected one that ends by byte {end}"
                    raise ReadError(self._path, problem, place=f"byte {position}")
                if stream in numbers:
                    yield position, self._content(file.read(length), position)
                position = following
        self._check_table()

    def _check_table(self) -> None:
        """Find out whether a file that promises a table of its packets has lost it."""
        if self._end == _NO_TABLE:
            return
        problem = (
            f"truncated or damaged: its table of packets should lie at byte {self._end} of {self._bytes}"
        )
        if not self._start <= self._end < self._bytes:
            raise ReadError(self._path, problem)
        with self._path.open("rb") as file:
            file.seek(self._end)
            packed = file.read()
        try:
            table = self._unpack(packed)
            sound = int.from_bytes(table[:_SIZE_PREFIX], "little") <= len(table) - _SIZE_PREFIX
        except Exception:  # whatever damage makes of the decompressors
            sound = False
        if not sound:
            raise ReadError(self._path, problem)

    def _content(self, packed: bytes, position: int) -> Table:
        try:
            return root_table(self._unpack(packed)[_SIZE_PREFIX:])
        except Exception as error:  # whatever damage makes of the decompressors
            problem = f"damaged packet: {type(error).__name__}: {error}"
            raise ReadError(self._path, problem, place=f"byte {position}") from None


def _streams(description: str) -> list[_Stream]:
    """The streams that the header's XML lists."""
    streams = []
    root = ElementTree.fromstring(description)
    for node in root.iter("node"):
        if not (node.get("name") or "").isdigit():
            continue
        values = {item.get("key"): item.text or "" for item in node.iter("attr")}
        sides = [int(values.get(side, "0") or 0) for side in ("sizeX", "sizeY")]
        size = (sides[0], sides[1]) if all(1 <= side <= 65536 for side in sides) else None
        kind, number = values.get("typeIdentifier", ""), int(str(node.get("name")))
        name = values.get("originalOutputName") or str(number)
        streams.append(_Stream(number, name, kind, size))
    streams.sort(key=lambda stream: stream.number)
    names = [stream.name for stream in streams]
    return [
        stream if names.count(stream.name) == 1 else replace(stream, name=str(stream.number))
        for stream in streams
    ]


def _unpacker(compression: str, path: Path) -> Callable[[bytes], bytes]:
    """What unpacks a packet, into no more than a sound one holds."""
    if compression == "none":
        return lambda data: data
    if compression.startswith("lz4"):
        frame: Any = require("lz4.frame", "lz4", "AEDAT 4 with LZ4 compression", path)

        def unpack_lz4(data: bytes) -> bytes:
            return _whole(frame.LZ4FrameDecompressor(), data)

        return unpack_lz4
    module = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    zstd: Any = require(module, "backports.zstd", "AEDAT 4 with Zstandard compression", path)

    def unpack_zstd(data: bytes) -> bytes:
        return _whole(zstd.ZstdDecompressor(), data)

    return unpack_zstd


def _whole(decompressor: Any, data: bytes) -> bytes:
    unpacked: bytes = decompressor.decompress(data, max_length=_LARGEST_PACKET)
    if not decompressor.eof:
        raise ValueError("the compressed data ends too early, or is too large")
    return unpacked


AEDAT4 = Aedat4Reader()
