"""Messages of bags whose index is lost, read record by record from the front.

The layouts: wiki.ros.org, "Bags/Format/2.0"; mcap.dev, "Specification".
"""

from __future__ import annotations

import bz2
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Final

from emseg.io.errors import ReadError
from emseg.io.extras import require

__all__ = ["scan_mcap", "scan_ros1"]

Message = tuple[str, str, bytes]
"""Topic, message type as package/msg/Name, and content."""

_LARGEST_RECORD: Final = 1 << 30
_ROS1_START: Final = len(b"#ROSBAG V2.0\n")
_ROS1_MESSAGE, _ROS1_CHUNK, _ROS1_CONNECTION = 0x02, 0x05, 0x07
_MCAP_START: Final = 8
_MCAP_SCHEMA, _MCAP_CHANNEL, _MCAP_MESSAGE, _MCAP_CHUNK, _MCAP_DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F


def scan_ros1(path: Path) -> Iterator[Message]:
    """The messages of a ROS 1 bag in the order of the file.

    Raises:
        ReadError: after the last sound message, where the file does not end with it; names the byte.
    """
    connections: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file:
        position = _ROS1_START
        file.seek(position)
        while True:
            try:
                record = _ros1_record(file)
                if record is None:
                    return
                fields, data = record
                kind = fields.get("op", b"\0")[0]
                if kind == _ROS1_CHUNK:
                    data = _unpack(fields.get("compression", b"").decode("ascii", "replace"), data, path)
                    yield from _ros1_messages(data, connections)
                elif kind == _ROS1_CONNECTION:
                    _connect(fields, data, connections)
            except (ValueError, OSError, EOFError, RuntimeError, struct.error) as error:
                raise ReadError(path, f"truncated or damaged: {error}", place=f"byte {position}") from None
            position = file.tell()


def _ros1_messages(data: bytes, connections: dict[int, tuple[str, str]]) -> Iterator[Message]:
    position = 0
    while position < len(data):
        fields, content, position = _ros1_fields(data, position)
        kind = fields.get("op", b"\0")[0]
        if kind == _ROS1_CONNECTION:
            _connect(fields, content, connections)
        elif kind == _ROS1_MESSAGE and (known := connections.get(_number(fields, "conn"))):
            yield (*known, content)


def _ros1_record(file: IO[bytes]) -> tuple[dict[str, bytes], bytes] | None:
    """The next record's fields and data, or None at the end of the file."""
    parts: list[bytes] = []
    for _ in range(2):
        prefix = file.read(4)
        if not prefix and not parts:
            return None
        length = int.from_bytes(prefix, "little")
        if len(prefix) < 4 or length > _LARGEST_RECORD:
            raise ValueError(f"record of {length} bytes")
        part = file.read(length)
        if len(part) < length:
            raise ValueError(f"record ends after {len(part)} of {length} bytes")
        parts.append(part)
    return _parse_fields(parts[0]), parts[1]


def _ros1_fields(data: bytes, position: int) -> tuple[dict[str, bytes], bytes, int]:
    header, position = _sized(data, position, "<I")
    content, position = _sized(data, position, "<I")
    return _parse_fields(header), content, position


def _parse_fields(header: bytes) -> dict[str, bytes]:
    fields: dict[str, bytes] = {}
    position = 0
    while position < len(header):
        field, position = _sized(header, position, "<I")
        name, _, value = field.partition(b"=")
        fields[name.decode("ascii", "replace")] = value
    return fields


def _connect(fields: dict[str, bytes], data: bytes, connections: dict[int, tuple[str, str]]) -> None:
    package, _, name = _parse_fields(data).get("type", b"").decode("ascii", "replace").partition("/")
    topic = fields.get("topic", b"").decode("utf-8", "replace")
    connections[_number(fields, "conn")] = topic, f"{package}/msg/{name}"


def _number(fields: dict[str, bytes], name: str) -> int:
    return int.from_bytes(fields.get(name, b""), "little")


def scan_mcap(path: Path) -> Iterator[Message]:
    """The messages of an mcap file in the order of the file.

    Raises:
        ReadError: after the last sound message, where the file does not end with it; names the byte.
    """
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, int]] = {}
    with path.open("rb") as file:
        position = _MCAP_START
        file.seek(position)
        while True:
            try:
                record = _mcap_record(file)
                if record is None or record[0] == _MCAP_DATA_END:
                    return
                kind, data = record
                if kind == _MCAP_CHUNK:
                    # Two times, size unpacked, checksum; compression; size packed.
                    compression, start = _sized(data, 28, "<I")
                    packed, _ = _sized(data, start, "<Q")
                    data = _unpack(compression.decode("ascii", "replace"), packed, path)
                    yield from _mcap_messages(data, schemas, channels)
                else:
                    yield from _mcap_message(kind, data, schemas, channels)
            except (ValueError, OSError, EOFError, RuntimeError, struct.error) as error:
                raise ReadError(path, f"truncated or damaged: {error}", place=f"byte {position}") from None
            position = file.tell()


def _mcap_record(file: IO[bytes]) -> tuple[int, bytes] | None:
    header = file.read(9)
    if not header:
        return None
    length = int.from_bytes(header[1:], "little")
    if len(header) < 9 or length > _LARGEST_RECORD:
        raise ValueError(f"record of {length} bytes")
    data = file.read(length)
    if len(data) < length:
        raise ValueError(f"record ends after {len(data)} of {length} bytes")
    return header[0], data


def _mcap_messages(
    data: bytes, schemas: dict[int, str], channels: dict[int, tuple[str, int]]
) -> Iterator[Message]:
    position = 0
    while position < len(data):
        kind = data[position]
        content, position = _sized(data, position + 1, "<Q")
        yield from _mcap_message(kind, content, schemas, channels)


def _mcap_message(
    kind: int, data: bytes, schemas: dict[int, str], channels: dict[int, tuple[str, int]]
) -> Iterator[Message]:
    if kind == _MCAP_SCHEMA:
        name, _ = _sized(data, 2, "<I")
        schemas[int.from_bytes(data[:2], "little")] = name.decode("utf-8", "replace")
    elif kind == _MCAP_CHANNEL:
        topic, _ = _sized(data, 4, "<I")
        number, schema = struct.unpack_from("<HH", data)
        channels[number] = topic.decode("utf-8", "replace"), schema
    elif kind == _MCAP_MESSAGE:
        channel = channels.get(int.from_bytes(data[:2], "little"))
        if channel is not None:
            yield channel[0], schemas.get(channel[1], ""), data[22:]  # after channel, number and two times


def _sized(data: bytes, position: int, form: str) -> tuple[bytes, int]:
    """What a length at some place precedes, and the place after it."""
    (length,) = struct.unpack_from(form, data, position)
    start = position + struct.calcsize(form)
    if start + length > len(data):
        raise ValueError(f"field of {length} bytes in the {len(data) - start} that are left")
    return data[start : start + length], start + length


def _unpack(compression: str, data: bytes, path: Path) -> bytes:
    if compression in ("", "none"):
        return data
    if compression == "bz2":
        return bz2.decompress(data)
    if compression == "lz4":
        frame: Any = require("lz4.frame", "lz4", "a bag with LZ4 compression", path)
        return bytes(frame.decompress(data))
    if compression == "zstd":
        module = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
        zstd: Any = require(module, "backports.zstd", "a bag with Zstandard compression", path)
        try:
            return bytes(zstd.decompress(data))
        except zstd.ZstdError as error:
            raise ValueError(str(error)) from None
    raise ValueError(f"compression {compression[:40]!r}, expected none, bz2, lz4 or zstd")
