"""The ROS messages that recordings hold, parsed from their bytes in one go.

Deserialising dvs_msgs event by event would take a hundred times as long.  The layouts are those of the
message definitions, as ROS 1 packs them and as ROS 2 aligns them (CDR).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.io.recording import Frame, ImuSamples

__all__ = [
    "EVENT_ARRAYS",
    "EVENT_PACKETS",
    "IMAGE",
    "IMU",
    "Columns",
    "EventMessages",
    "parse_image",
    "parse_imu",
]

EVENT_ARRAYS: Final = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
EVENT_PACKETS: Final = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
IMAGE: Final = "sensor_msgs/msg/Image"
IMU: Final = "sensor_msgs/msg/Imu"

_CDR_HEADER: Final = 4
_EVENT_BYTES: Final = 13  # ROS 1: x, y, seconds, nanoseconds, polarity without gaps
_LIBCAER_WRAP_US: Final = 1 << 31
_PIXELS: Final[dict[str, tuple[str, int]]] = {
    "mono8": ("u1", 1),
    "8UC1": ("u1", 1),
    "mono16": ("<u2", 1),
    "16UC1": ("<u2", 1),
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    "8UC3": ("u1", 3),
}
_ROS1_EVENT: Final = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("p", "u1")])
_CDR_EVENT: Final = np.dtype(
    {
        "names": ["s", "ns", "p", "next_x", "next_y"],
        "formats": ["<i4", "<u4", "u1", "<u2", "<u2"],
        "offsets": [0, 4, 8, 10, 12],
        "itemsize": 16,
    }
)


@dataclass(frozen=True)
class Columns:
    """The events of a message: columns (n,), times in µs since the epoch where `is_absolute`."""

    x: npt.NDArray[Any]
    y: npt.NDArray[Any]
    t: npt.NDArray[np.int64]
    p: npt.NDArray[Any]
    stamp: int  # µs, of the message
    is_absolute: bool


class _Cursor:
    """Reads the fields of one message one after the other.

    Raises:
        ValueError: where the message ends too early.
    """

    def __init__(self, raw: bytes, is_cdr: bool) -> None:
        self._raw, self.is_cdr = memoryview(raw), is_cdr
        self.position = 0
        if is_cdr:
            if len(raw) < _CDR_HEADER or raw[1] not in (0x00, 0x01):
                raise ValueError("message is in no known CDR encoding")
            if raw[1] == 0x00:
                raise ValueError("message is big-endian, expected little-endian")
            self._raw = self._raw[_CDR_HEADER:]

    def number(self, form: str) -> Any:
        size = struct.calcsize(form)
        self.align(size)
        return struct.unpack("<" + form, self.take(size))[0]

    def numbers(self, count: int) -> npt.NDArray[np.float64]:
        self.align(8)
        return np.frombuffer(self.take(8 * count), "<f8")

    def string(self) -> str:
        return bytes(self.take(self.number("I"))).rstrip(b"\0").decode("utf-8", "replace")

    def array(self) -> npt.NDArray[np.uint8]:
        return np.frombuffer(self.take(self.number("I")), np.uint8)

    def stamp(self) -> int:
        """The header's time, µs."""
        if not self.is_cdr:
            self.number("I")  # sequence number
        seconds, nanoseconds = self.number("i" if self.is_cdr else "I"), self.number("I")
        self.string()  # frame of reference
        return int(seconds) * 1_000_000 + int(nanoseconds) // 1000

    def align(self, size: int) -> None:
        if self.is_cdr:
            self.position += -self.position % size

    def take(self, count: int) -> memoryview:
        part = self._raw[self.position : self.position + count]
        if len(part) < count:
            raise ValueError(f"message ends after {len(self._raw)} bytes, expected {self.position + count}")
        self.position += count
        return part


class EventMessages:
    """Decodes the event messages of one topic in order; some encodings go on from message to message."""

    def __init__(self, message_type: str, *, is_cdr: bool) -> None:
        self._is_cdr = is_cdr
        self._parse = self._event_array if message_type in EVENT_ARRAYS else self._event_packet
        self._evt3 = _core.EvtDecoder(_core.EvtEncoding.evt3)

    def parse(self, raw: bytes) -> tuple[Columns, tuple[int, int] | None]:
        """The message's events and its sensor's width and height, px."""
        return self._parse(_Cursor(raw, self._is_cdr))

    def _event_array(self, cursor: _Cursor) -> tuple[Columns, tuple[int, int] | None]:
        stamp = cursor.stamp()
        height, width, count = cursor.number("I"), cursor.number("I"), cursor.number("I")
        if cursor.is_cdr:
            x, y, s, ns, p = _cdr_events(cursor, count)
        else:
            events = np.frombuffer(cursor.take(count * _EVENT_BYTES), _ROS1_EVENT)
            x, y, s, ns, p = (events[name] for name in ("x", "y", "s", "ns", "p"))
        t = s.astype(np.int64) * 1_000_000 + ns.astype(np.int64) // 1000
        return Columns(x, y, t, p, stamp, is_absolute=True), _size(width, height)

    def _event_packet(self, cursor: _Cursor) -> tuple[Columns, tuple[int, int] | None]:
        stamp = cursor.stamp()
        height, width = cursor.number("I"), cursor.number("I")
        cursor.number("Q")  # sequence number
        time_base = cursor.number("Q")
        encoding = cursor.string()
        if cursor.number("B"):
            raise ValueError("events are big-endian, expected little-endian")
        data = cursor.array()
        decoders: dict[str, Callable[[npt.NDArray[np.uint8], int, int], Columns]] = {
            "evt3": self._decode_evt3,
            "libcaer_cmp": _decode_libcaer_cmp,
            "libcaer": _decode_libcaer,
            "mono": _decode_mono,
        }
        if encoding not in decoders:
            known = ", ".join(decoders)
            raise ValueError(f"events are encoded as {encoding[:40]!r}, expected one of: {known}")
        return decoders[encoding](data, time_base, stamp), _size(width, height)

    def _decode_evt3(self, data: npt.NDArray[np.uint8], time_base: int, stamp: int) -> Columns:
        x, y, t, p = self._evt3.decode(data)
        return Columns(x, y, t, p, stamp, is_absolute=False)


def _size(width: int, height: int) -> tuple[int, int] | None:
    return (width, height) if 1 <= width <= 65536 and 1 <= height <= 65536 else None


def _cdr_events(cursor: _Cursor, count: int) -> tuple[npt.NDArray[Any], ...]:
    """Columns x, y, s, ns, p: after the first event, x and y lie in what would be padding."""
    if count == 0:
        empty = np.empty(0, np.int64)
        return empty, empty, empty, empty, empty
    cursor.align(2)
    first = np.frombuffer(cursor.take(4), "<u2")
    rest = cursor.take(16 * count - 7)  # the last ends with its polarity
    events = np.frombuffer(bytes(rest) + bytes(7), _CDR_EVENT)
    x = np.concatenate([first[:1], events["next_x"][:-1]])
    y = np.concatenate([first[1:], events["next_y"][:-1]])
    return x, y, events["s"], events["ns"], events["p"]


def _decode_libcaer_cmp(data: npt.NDArray[np.uint8], time_base: int, stamp: int) -> Columns:
    x, y, t, p = _core.decode_libcaer_packet(data)
    return Columns(x, y, t + time_base // 1000, p, stamp, is_absolute=True)


def _decode_libcaer(data: npt.NDArray[np.uint8], time_base: int, stamp: int) -> Columns:
    words = _words(data, 8, "<u4").reshape(-1, 2)
    address, t = words[:, 0], words[:, 1].astype(np.int64)
    t += np.cumsum(np.diff(t, prepend=t[:1]) < -_LIBCAER_WRAP_US // 2) * _LIBCAER_WRAP_US
    x, y, p = address >> 17 & 0x7FFF, address >> 2 & 0x7FFF, address >> 1 & 1
    return Columns(x, y, t + time_base // 1000, p.astype(np.uint8), stamp, is_absolute=True)


def _decode_mono(data: npt.NDArray[np.uint8], time_base: int, stamp: int) -> Columns:
    words = _words(data, 8, "<u8")
    t = ((words & 0xFFFFFFFF).astype(np.int64) + time_base) // 1000
    x, y, p = words >> 32 & 0xFFFF, words >> 48 & 0x7FFF, words >> 63
    return Columns(x.astype(np.uint16), y.astype(np.uint16), t, p.astype(np.uint8), stamp, is_absolute=False)


def _words(data: npt.NDArray[np.uint8], size: int, form: str) -> npt.NDArray[Any]:
    if len(data) % size:
        raise ValueError(f"packet has {len(data)} bytes, expected whole events of {size}")
    return np.frombuffer(data, form)


def parse_image(raw: bytes, *, is_cdr: bool) -> Frame:
    """The picture of a message sensor_msgs/Image.

    Raises:
        ValueError: where it is cut short or in an encoding that is not known.
    """
    cursor = _Cursor(raw, is_cdr)
    stamp, rows, columns = cursor.stamp(), cursor.number("I"), cursor.number("I")
    encoding = cursor.string()
    cursor.number("B")
    step, data = cursor.number("I"), cursor.array()
    if encoding not in _PIXELS:
        raise ValueError(f"image is encoded as {encoding[:40]!r}, expected one of: {', '.join(_PIXELS)}")
    form, channels = _PIXELS[encoding]
    row_bytes = columns * channels * np.dtype(form).itemsize
    if step < row_bytes or len(data) < rows * step:
        raise ValueError(f"image of {columns}x{rows} {encoding} has {len(data)} bytes")
    image = data[: rows * step].reshape(rows, step)[:, :row_bytes].copy().view(form)
    return Frame(stamp, image.reshape(rows, columns, 3) if channels == 3 else image.reshape(rows, columns))


def parse_imu(raw: bytes, *, is_cdr: bool) -> ImuSamples:
    """The measurement of a message sensor_msgs/Imu.

    Raises:
        ValueError: where it is cut short.
    """
    cursor = _Cursor(raw, is_cdr)
    stamp = cursor.stamp()
    values = cursor.numbers(4 + 9 + 3 + 9 + 3 + 9)  # each but the quaternion with its covariance
    return ImuSamples(np.array([stamp], np.int64), values[None, 13:16].copy(), values[None, 25:28].copy())
