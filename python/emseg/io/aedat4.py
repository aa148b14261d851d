"""AEDAT 4 recordings (DAVIS, DVXplorer), decoded by dv-processing.

The decoder is native code that was seen to spin for ever on damaged files, so it runs in a process of its
own, which is ended when it reports nothing for a while; and the file's packets are walked first, which finds
most damage in no time and says at which byte it lies.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import mmap
import select
import struct
import subprocess
import sys
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray
from emseg.io import aedat4_worker
from emseg.io.errors import ReadError

__all__ = ["AEDAT4", "Aedat4Reader"]

_log = logging.getLogger(__name__)

_MAGIC: Final = b"#!AER-DAT4.0\r\n"
_NO_TABLE: Final = -1  # where a recording was cut off before its table of packets was written
_PACKET_HEADER: Final = struct.Struct("<ii")
_SILENCE_S: float = 20.0  # longest time without news from the decoder
_SCAN_BYTES_PER_S: Final = 50e6  # slowest disk: the decoder scans the whole file before its first news


class Aedat4Reader:
    """The first event stream of an AEDAT 4 recording; needs dv-processing (the extra `io`)."""

    name = "AEDAT 4 (.aedat4)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's version line."""
        return head.startswith(_MAGIC[:-2])

    def read(self, path: Path, *, size: tuple[int, int] | None = None) -> EventArray:
        """See :meth:`emseg.io.Reader.read`."""
        if importlib.util.find_spec("dv_processing") is None:
            raise ReadError(path, "AEDAT 4 needs dv-processing: pip install 'emseg[io]'")
        _check_packets(path)
        resolution, records = _decode(path)
        width, height = size or resolution
        try:
            return EventArray.from_structured(records, width=width, height=height)
        except ValueError as error:
            raise ReadError(path, str(error)) from None


def _check_packets(path: Path) -> None:
    """Walk from packet to packet to the end of the file.

    Raises:
        ReadError: at the first packet that does not fit, with its byte.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if data[: len(_MAGIC)] != _MAGIC:
            raise ReadError(path, f"expected {_MAGIC!r}", place="byte 0")
        position, table = _header(path, data)
        end = len(data) if table == _NO_TABLE else table
        if not position <= end <= len(data):
            problem = f"truncated: its table of packets should lie at byte {table} of {len(data)}"
            raise ReadError(path, problem)
        while position < end:
            if position + _PACKET_HEADER.size > end:
                raise ReadError(path, "truncated inside a packet's header", place=f"byte {position}")
            stream, length = _PACKET_HEADER.unpack_from(data, position)
            following = position + _PACKET_HEADER.size + length
            if stream < 0 or length <= 0 or following > end:
                found = f"packet of stream {stream} and {length} bytes"
                problem = f"truncated or damaged: {found}, expected one that ends by byte {end}"
                raise ReadError(path, problem, place=f"byte {position}")
            position = following


def _header(path: Path, data: mmap.mmap) -> tuple[int, int]:
    """First byte after the header (a FlatBuffer with its size before it), and the place of the table."""
    try:
        start = len(_MAGIC) + 4
        (length,) = struct.unpack_from("<I", data, len(_MAGIC))
        if start + length > len(data):
            raise ReadError(path, "truncated inside its header", place=f"byte {len(data)}")
        root = start + struct.unpack_from("<I", data, start)[0]
        fields = root - struct.unpack_from("<i", data, root)[0]
        # Field 1, dataTablePosition: its offset is the second after the two sizes that open the field table.
        fields_length = struct.unpack_from("<H", data, fields)[0]
        offset = struct.unpack_from("<H", data, fields + 6)[0] if fields_length >= 8 else 0
        table = struct.unpack_from("<q", data, root + offset)[0] if offset else _NO_TABLE
    except struct.error:
        raise ReadError(path, "damaged or truncated header", place=f"byte {len(_MAGIC)}") from None
    return start + length, table


def _decode(path: Path) -> tuple[tuple[int, int], npt.NDArray[Any]]:
    """Sensor size and records, from a decoder in a process of its own."""
    patience = _SILENCE_S + path.stat().st_size / _SCAN_BYTES_PER_S
    # -P: the worker's folder holds modules of common names, which must not hide others.
    command = [sys.executable, "-P", aedat4_worker.__file__, str(path.resolve())]
    # Unbuffered: select() would not see what waits in a buffer.
    with subprocess.Popen(
        command, bufsize=0, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        batches: list[npt.NDArray[Any]] = []
        try:
            header = _receive_line(process.stdout, patience)
            answer = json.loads(header) if header else {"error": "the decoder died on it"}
            if "error" in answer:
                raise ReadError(path, f"damaged or no event recording: {answer['error']}")
            while True:
                (count,) = struct.unpack("<q", _receive(process.stdout, 8, patience))
                if count == aedat4_worker.END:
                    break
                if count == aedat4_worker.FAILED:
                    message = json.loads(_receive_line(process.stdout, patience))["error"]
                    raise ReadError(path, f"damaged after {sum(len(b) for b in batches)} events: {message}")
                data = _receive(process.stdout, count * aedat4_worker.RECORD.itemsize, patience)
                batches.append(np.frombuffer(data, aedat4_worker.RECORD))
        except TimeoutError:
            raise ReadError(path, f"damaged: the decoder gave no answer for {patience:.0f} s") from None
        except (EOFError, json.JSONDecodeError):
            raise ReadError(path, "damaged: the decoder died on it") from None
        finally:
            process.kill()
    for note in answer["notes"]:
        _log.warning("%s: %s", path, note)
    records = np.concatenate(batches) if batches else np.empty(0, aedat4_worker.RECORD)
    return (int(answer["width"]), int(answer["height"])), records


def _receive(pipe: IO[bytes], length: int, patience: float) -> bytes:
    """Exactly `length` bytes; TimeoutError where none come for `patience` seconds, EOFError at the end."""
    buffer = bytearray()
    while len(buffer) < length:
        buffer += _some(pipe, length - len(buffer), patience)
    return bytes(buffer)


def _receive_line(pipe: IO[bytes], patience: float) -> bytes:
    line = bytearray()
    try:
        while not line.endswith(b"\n"):
            line += _some(pipe, 1, patience)
    except EOFError:
        return b""
    return bytes(line)


def _some(pipe: IO[bytes], length: int, patience: float) -> bytes:
    ready, _, _ = select.select([pipe], [], [], patience)
    if not ready:
        raise TimeoutError
    chunk = pipe.read(length)
    if not chunk:
        raise EOFError
    return chunk


AEDAT4 = Aedat4Reader()
