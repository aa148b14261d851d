"""AEDAT 3.1 recordings of cAER: packets of events, frames and inertial measurements.

The format (inivation.github.io, "AEDAT file formats"): lines that begin with #, up to #!END-HEADER; then
packets, each a header of 28 bytes and events of one type and size, little-endian.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

import numpy as np
import numpy.typing as npt

from emseg.io.errors import ReadError
from emseg.io.recording import Block, Frame, ImuSamples, ReadOptions, Source

__all__ = ["AEDAT3", "Aedat3Reader"]

_MAGIC: Final = b"#!AER-DAT3"
_HEADER_END: Final = b"#!END-HEADER\r\n"
_HEADER_BYTES: Final = 1 << 20
# Type, source, event size, time offset, wraps of the time, capacity, number, valid.
_PACKET: Final = struct.Struct("<hhiiiiii")
_POLARITY, _FRAME, _IMU6 = 1, 2, 3
_POLARITY_BYTES: Final = 8
_IMU_BYTES: Final = 36
_FRAME_BYTES: Final = 36
_LARGEST_PACKET: Final = 1 << 28
_G: Final = 9.80665
_SENSORS: Final = (
    ("DVS128", (128, 128)),
    ("DAVIS240", (240, 180)),
    ("DAVIS640", (640, 480)),
    ("DAVIS", (346, 260)),
)


@dataclass(frozen=True)
class _Packet:
    kind: int
    position: int  # of its first event, bytes
    event_bytes: int
    count: int
    wraps: int
    data: bytes


class Aedat3Reader:
    """AEDAT 3.1: events, frames and inertial measurements."""

    name = "AEDAT 3.1 (.aedat)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's version line."""
        return head.startswith(_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _Aedat3Source(path)


class _Aedat3Source(Source):
    def __init__(self, path: Path) -> None:
        self._path = path
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
        end = head.find(_HEADER_END)
        if end < 0:
            raise ReadError(
                path, "truncated inside its header, expected #!END-HEADER", place=f"byte {len(head)}"
            )
        self._start = end + len(_HEADER_END)
        header = head[:end].decode("ascii", "replace")
        if not header.startswith("#!AER-DAT3.1"):
            problem = f"is of version {header[9:12]!r}, expected 3.1"
            raise ReadError(path, problem, place="line 1")
        if (form := re.search(r"^#Format: *(\S+)", header, re.MULTILINE)) and form[1] != "RAW":
            raise ReadError(path, f"is encoded as {form[1]}, expected RAW: cAER converts it", place="header")
        source = re.search(r"^#Source +\d+: *(\S+)", header, re.MULTILINE)
        name = source[1].upper() if source else ""
        self.size = next((size for sensor, size in _SENSORS if sensor in name), None)

    def blocks(self) -> Iterator[Block]:
        for packet in self._packets(_POLARITY):
            if packet.event_bytes != _POLARITY_BYTES:
                raise self._wrong_size(packet, _POLARITY_BYTES)
            words = np.frombuffer(packet.data, "<u4").reshape(-1, 2)
            valid = np.flatnonzero(words[:, 0] & 1)
            address, t = words[valid, 0], words[valid, 1].astype(np.int64) + (packet.wraps << 31)
            x, y = (address >> 17).astype(np.uint16), (address >> 2 & 0x7FFF).astype(np.uint16)
            yield Block(x, y, t, (address >> 1 & 1).astype(np.uint8), _place(packet, valid))

    def frames(self) -> Iterator[Frame]:
        for packet in self._packets(_FRAME):
            for k in range(packet.count):
                event = packet.data[k * packet.event_bytes : (k + 1) * packet.event_bytes]
                if len(event) < _FRAME_BYTES:
                    raise self._wrong_size(packet, _FRAME_BYTES)
                info, _, _, start, _, columns, rows, _, _ = struct.unpack_from("<Iiiiiiiii", event)
                channels = info >> 1 & 7
                pixels = columns * rows * channels
                if (
                    not (columns > 0 and rows > 0 and channels in (1, 3, 4))
                    or len(event) < _FRAME_BYTES + 2 * pixels
                ):
                    problem = f"frame of {columns}x{rows} and {channels} channels in {len(event)} bytes"
                    raise ReadError(self._path, f"damaged: {problem}", place=f"byte {packet.position}")
                if info & 1:
                    image = np.frombuffer(event, "<u2", pixels, _FRAME_BYTES).reshape(rows, columns, channels)
                    picture = (image >> 8).astype(np.uint8)
                    yield Frame(start + (packet.wraps << 31), picture[..., 0] if channels == 1 else picture)

    def imu(self) -> ImuSamples:
        parts = []
        layout = np.dtype([("info", "<u4"), ("t", "<i4"), ("a", "<f4", 3), ("w", "<f4", 3), ("c", "<f4")])
        for packet in self._packets(_IMU6):
            if packet.event_bytes != _IMU_BYTES:
                raise self._wrong_size(packet, _IMU_BYTES)
            samples = np.frombuffer(packet.data, layout)
            samples = samples[samples["info"] & 1 == 1]
            t = samples["t"].astype(np.int64) + (packet.wraps << 31)
            parts.append(
                ImuSamples(
                    t, np.deg2rad(samples["w"].astype(np.float64)), samples["a"].astype(np.float64) * _G
                )
            )
        return ImuSamples.concatenate(parts)

    def _packets(self, kind: int) -> Iterator[_Packet]:
        """The packets of one kind; the others are passed over."""
        with self._path.open("rb") as file:
            position = self._start
            file.seek(position)
            while header := file.read(_PACKET.size):
                if len(header) < _PACKET.size:
                    raise ReadError(
                        self._path, "truncated inside a packet's header", place=f"byte {position}"
                    )
                found, _, event_bytes, _, wraps, _, count, _ = _PACKET.unpack(header)
                length = event_bytes * count
                if event_bytes <= 0 or count < 0 or wraps < 0 or length > _LARGEST_PACKET:
                    problem = f"damaged: packet of {count} events of {event_bytes} bytes"
                    raise ReadError(self._path, problem, place=f"byte {position}")
                position += _PACKET.size
                data = self._body(file, length, position)
                if found == kind:
                    yield _Packet(kind, position, event_bytes, count, wraps, data)
                position += length

    def _body(self, file: IO[bytes], length: int, position: int) -> bytes:
        data = file.read(length)
        if len(data) < length:
            problem = f"truncated: packet of {length} bytes, of which {len(data)} are there"
            raise ReadError(self._path, problem, place=f"byte {position}")
        return data

    def _wrong_size(self, packet: _Packet, expected: int) -> ReadError:
        problem = f"damaged: events of {packet.event_bytes} bytes, expected {expected}"
        return ReadError(self._path, problem, place=f"byte {packet.position}")


def _place(packet: _Packet, valid: npt.NDArray[np.intp]) -> Callable[[int], str]:
    return lambda event: f"byte {packet.position + int(valid[event]) * packet.event_bytes}"


AEDAT3 = Aedat3Reader()
