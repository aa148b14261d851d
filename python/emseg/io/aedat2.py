"""AEDAT 2 recordings of jAER: DVS128 and DAVIS cameras.

The format (inivation.github.io, "AEDAT file formats"): lines that begin with #, then big-endian pairs of a
32-bit address and a 32-bit time in µs.  jAER counts rows from the bottom; here they count from the top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from emseg.io.errors import ReadError
from emseg.io.recording import BLOCK_EVENTS, Block, ImuSamples, ReadOptions, Source

__all__ = ["AEDAT2", "Aedat2Reader"]

_MAGIC: Final = b"#!AER-DAT2"
_RECORD_BYTES: Final = 8
_WRAP: Final = 1 << 32
_HEADER_BYTES: Final = 1 << 20
# The header names the chip's Java class; a DAVIS that is not among them is taken for a 346.
_CHIPS: Final = {"dvs128": (128, 128), "davis240": (240, 180), "davis128": (128, 128), "davis640": (640, 480)}
_DAVIS: Final = (346, 260)
_IMU_WORDS: Final = 7  # acceleration x y z, temperature, angular velocity x y z
# jAER's settings of the InvenSense IMU unless changed: ±8 g and ±1000 °/s in 16 bits; the file does not say.
_M_PER_S2: Final = 9.80665 * 8 / 32768
_RAD_PER_S: Final = np.pi / 180 * 1000 / 32768


class Aedat2Reader:
    """AEDAT 2.0: events and, of a DAVIS, inertial measurements; frames are passed over."""

    name = "AEDAT 2 (.aedat)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's version line."""
        return head.startswith(_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _Aedat2Source(path)


class _Aedat2Source(Source):
    def __init__(self, path: Path) -> None:
        self._path = path
        with path.open("rb") as file:
            head = file.read(_HEADER_BYTES)
        position = 0
        # An address may begin with the byte of "#" too, but lines are text.
        while head[position : position + 1] == b"#" and (end := head.find(b"\n", position)) >= 0:
            if any(byte > 0x7E or (byte < 0x20 and byte not in b"\r\t") for byte in head[position:end]):
                break
            position = end + 1
        if position == 0:
            raise ReadError(path, "truncated inside its header", place="byte 0")
        self._start = position
        header = head[:position].decode("ascii").lower()
        chip = header.partition("aechip:")[2].partition("\n")[0]
        known = next((size for name, size in _CHIPS.items() if name in (chip or header)), None)
        self._is_davis = "dvs128" not in (chip or header)
        self.size = known or _DAVIS

    def blocks(self) -> Iterator[Block]:
        assert self.size is not None
        width, height = self.size
        for position, address, t in self._records():
            if self._is_davis:
                kept = np.flatnonzero((address & 0x80000400) == 0)  # neither frame nor IMU
                a = address[kept]
                x, y, p = a >> 12 & 0x3FF, a >> 22 & 0x1FF, a >> 11 & 1
            else:
                kept = np.flatnonzero((address & 0x8000) == 0)  # no special event
                a = address[kept]
                x, y, p = width - 1 - (a >> 1 & 0x7F).astype(np.int64), a >> 8 & 0x7F, 1 - (a & 1)
            row = height - 1 - y.astype(np.int64)
            yield Block(x, row, t[kept], p.astype(np.uint8), _place(position, kept))

    def imu(self) -> ImuSamples:
        if not self._is_davis:
            return ImuSamples()
        parts: list[ImuSamples] = []
        values = np.empty(0, np.int64)
        codes, times = values, values
        for _, address, t in self._records():
            chosen = (address & 0x80000C00) == 0x80000C00
            words = address[chosen].astype(np.int64)
            codes = np.concatenate([codes, words >> 28 & 7])
            values = np.concatenate([values, (words >> 12 & 0xFFFF).astype(np.uint16).view(np.int16)])
            times = np.concatenate([times, t[chosen]])
            starts = np.flatnonzero(codes == 0)
            starts = starts[starts + _IMU_WORDS <= len(codes)]
            rows = starts[:, None] + np.arange(_IMU_WORDS)
            whole = (codes[rows] == np.arange(_IMU_WORDS)).all(axis=1)
            samples = values[rows[whole]].astype(np.float64)
            parts.append(
                ImuSamples(times[starts[whole]], samples[:, 4:7] * _RAD_PER_S, samples[:, 0:3] * _M_PER_S2)
            )
            done = int(starts[-1]) + _IMU_WORDS if len(starts) else max(0, len(codes) - _IMU_WORDS)
            codes, values, times = codes[done:], values[done:], times[done:]
        return ImuSamples.concatenate(parts)

    def _records(self) -> Iterator[tuple[int, npt.NDArray[np.uint32], npt.NDArray[np.int64]]]:
        """First byte, addresses and times (µs) of successive records."""
        position, wraps, last = self._start, 0, 0
        with self._path.open("rb") as file:
            file.seek(position)
            while data := file.read(BLOCK_EVENTS * _RECORD_BYTES):
                count = len(data) // _RECORD_BYTES
                words = np.frombuffer(data[: count * _RECORD_BYTES], ">u4").reshape(-1, 2).astype(np.uint32)
                t = words[:, 1].astype(np.int64)
                falls = np.diff(t, prepend=last) < -_WRAP // 2  # the counter starting again
                if count:
                    last = int(t[-1])
                t += (wraps + np.cumsum(falls)) * _WRAP
                wraps += int(falls.sum())
                yield position, words[:, 0], t
                position += len(data)
                if len(data) % _RECORD_BYTES:
                    cut = position - len(data) % _RECORD_BYTES
                    raise ReadError(self._path, "truncated inside an event", place=f"byte {cut}")


def _place(start: int, kept: npt.NDArray[np.intp]) -> Callable[[int], str]:
    return lambda event: f"byte {start + int(kept[event]) * _RECORD_BYTES}"


AEDAT2 = Aedat2Reader()
