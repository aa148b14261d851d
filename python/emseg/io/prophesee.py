"""Prophesee's recordings: RAW files (EVT 2, 2.1 and 3) and DAT files.

Both open with text lines "% key value"; the encodings are specified at docs.prophesee.ai, "Data and file
formats".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from emseg import _core
from emseg.io.errors import ReadError
from emseg.io.recording import BLOCK_EVENTS, Block, ReadOptions, Source, at

__all__ = ["DAT", "RAW", "DatReader", "RawReader"]

_KEYS: Final = {
    "camera_integrator_name",
    "endianness",
    "evt",
    "firmware_version",
    "format",
    "geometry",
    "generation",
    "height",
    "integrator_name",
    "plugin_name",
    "sensor_generation",
    "sensor_name",
    "serial_number",
    "subsystem_id",
    "system_id",
    "version",
    "width",
}
"""Keys of Prophesee's headers: other text files may begin with lines "% …" too, but not with these."""

_HEADER_BYTES: Final = 65536
_ENCODINGS: Final = {"2": "EVT2", "2.0": "EVT2", "2.1": "EVT21", "3": "EVT3", "3.0": "EVT3"}
_EVENT_BYTES: Final = 8
_CD_EVENTS: Final = (0x00, 0x0C)
_WRAP: Final = 1 << 32  # where the times of a DAT file start again
_PROBE_BYTES: Final = 65536


@dataclass(frozen=True)
class _Header:
    values: dict[str, str]  # by key in lower case
    length: int  # bytes

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height, from `geometry`, `format` or their own keys."""
        options = self.options
        sides = (
            self.values.get("width", options.get("width")),
            self.values.get("height", options.get("height")),
        )
        geometry = re.fullmatch(r"(\d+)x(\d+)", self.values.get("geometry", ""))
        texts = geometry.groups() if geometry else sides
        numbers = [int(text) if text and text.isdigit() else 0 for text in texts]
        return (numbers[0], numbers[1]) if all(1 <= number <= 65536 for number in numbers) else None

    @property
    def options(self) -> dict[str, str]:
        """What stands after the encoding in `format EVT3;height=720;width=1280`."""
        pairs = (item.partition("=") for item in self.values.get("format", "").lower().split(";")[1:])
        return {key.strip(): value.strip() for key, _, value in pairs}

    @property
    def encoding(self) -> str | None:
        """EVT2, EVT21, EVT3 or whatever else stands there; None where nothing does."""
        named = self.values.get("format", "").partition(";")[0].strip().upper()
        return named or _ENCODINGS.get(self.values.get("evt", ""))


def _parse_header(head: bytes) -> _Header | None:
    """The header of a Prophesee file, or None where a file has none or goes on as text."""
    values: dict[str, str] = {}
    position = 0
    while head[position : position + 1] == b"%":
        end = head.find(b"\n", position)
        if end < 0:
            break
        line = head[position + 1 : end]
        if any(byte > 0x7E or (byte < 0x20 and byte not in b"\r\t") for byte in line):
            break  # the first event happens to begin like a line
        key, _, value = line.decode("ascii").strip().partition(" ")
        position = end + 1
        if key.lower() == "end":
            break
        values.setdefault(key.lower(), value.strip())
    events = head[position : position + _PROBE_BYTES]
    is_text = len(events) > 0 and all(0x20 <= byte <= 0x7E or byte in b"\r\n\t" for byte in events)
    return _Header(values, position) if _KEYS & values.keys() and not is_text else None


def _header(path: Path) -> _Header:
    with path.open("rb") as file:
        header = _parse_header(file.read(_HEADER_BYTES))
    if header is None:
        raise ReadError(path, "truncated inside its header", place="byte 0")
    return header


def _is_dat(header: _Header) -> bool:
    return header.encoding is None and "evt" not in header.values and "version" in header.values


class RawReader:
    """Prophesee RAW: EVT 2, EVT 2.1 and EVT 3.

    Times count from the first high part of a time in the file, as Prophesee's own tools count them.
    """

    name = "Prophesee RAW (EVT2, EVT2.1, EVT3)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with a Prophesee header that is not a DAT file's."""
        header = _parse_header(head)
        return header is not None and not _is_dat(header)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _RawSource(path)


class _RawSource(Source):
    def __init__(self, path: Path) -> None:
        header = _header(path)
        self._path, self._start = path, header.length
        encodings = {
            "EVT2": _core.EvtEncoding.evt2,
            "EVT3": _core.EvtEncoding.evt3,
            "EVT21": _core.EvtEncoding.evt21,
            "EVT2.1": _core.EvtEncoding.evt21,
        }
        named = header.encoding
        if named is None and header.values.get("evt"):
            named = f"EVT {header.values['evt']}"
        if named not in encodings:
            problem = (
                f"is encoded as {named or 'its header does not say what'}, expected EVT2, EVT2.1 or EVT3"
            )
            raise ReadError(path, f"{problem}; Prophesee's metavision_file_to_dat converts others")
        self._encoding = encodings[named]
        self.format = f"Prophesee RAW ({named})"
        if self._encoding == _core.EvtEncoding.evt21:
            order = header.options.get("endianness") or header.values.get("endianness", "")
            if order.lower() == "legacy" or (not order and self._halves_are_swapped()):
                self._encoding = _core.EvtEncoding.evt21_swapped
        self.size = header.size

    def blocks(self) -> Iterator[Block]:
        decoder = _core.EvtDecoder(self._encoding)
        position = self._start
        with self._path.open("rb") as file:
            file.seek(position)
            while data := file.read(BLOCK_EVENTS):  # vectors may hold more events than bytes, but not many
                columns = decoder.decode(np.frombuffer(data, np.uint8))
                place = f"bytes {position} to {position + len(data) - 1}"
                position += len(data)
                x, y, t, p = columns
                yield Block(x, y, t - decoder.origin, p, at(place))
        if decoder.pending:
            raise ReadError(self._path, "truncated inside a word", place=f"byte {position - decoder.pending}")

    def _halves_are_swapped(self) -> bool:
        """Whether the words make sense in the older order only, which the header need not say."""
        with self._path.open("rb") as file:
            file.seek(self._start)
            data = file.read(_PROBE_BYTES)
        words = np.frombuffer(data[: len(data) // 8 * 8], "<u4").reshape(-1, 2)
        known = np.isin(words >> 28, (0x0, 0x1, 0x8, 0xA, 0xE)).sum(axis=0)
        return bool(known[0] > known[1])


class DatReader:
    """Prophesee DAT: decoded events of 8 bytes."""

    name = "Prophesee DAT"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with a DAT file's header."""
        header = _parse_header(head)
        return header is not None and _is_dat(header)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _DatSource(path)


class _DatSource(Source):
    def __init__(self, path: Path) -> None:
        header = _header(path)
        self._path, self._start = path, header.length + 2
        self.size = header.size
        with path.open("rb") as file:
            file.seek(header.length)
            kind = file.read(2)
        if len(kind) < 2:
            raise ReadError(path, "truncated before its events", place=f"byte {header.length}")
        if kind[0] not in _CD_EVENTS or kind[1] != _EVENT_BYTES:
            problem = f"events of type {kind[0]} and {kind[1]} bytes, expected type 0 or 12 (CD) and 8 bytes"
            raise ReadError(path, problem, place=f"byte {header.length}")

    def blocks(self) -> Iterator[Block]:
        position, wraps, last = self._start, 0, 0
        with self._path.open("rb") as file:
            file.seek(position)
            while data := file.read(BLOCK_EVENTS * _EVENT_BYTES):
                count = len(data) // _EVENT_BYTES
                words = np.frombuffer(data[: count * _EVENT_BYTES], "<u4").reshape(-1, 2)
                t = words[:, 0].astype(np.int64)
                # A fall by more than half the range is the counter starting again.
                falls = np.diff(t, prepend=last) < -_WRAP // 2
                if count:
                    last = int(t[-1])
                t += (wraps + np.cumsum(falls)) * _WRAP
                wraps += int(falls.sum())
                place = _record_place(position)
                address = words[:, 1]
                x, y = (address & 0x3FFF).astype(np.uint16), (address >> 14 & 0x3FFF).astype(np.uint16)
                yield Block(x, y, t, (address >> 28).astype(np.uint8), place)
                position += len(data)
                if len(data) % _EVENT_BYTES:
                    cut = position - len(data) % _EVENT_BYTES
                    raise ReadError(self._path, "truncated inside an event", place=f"byte {cut}")


def _record_place(start: int) -> Callable[[int], str]:
    return lambda event: f"byte {start + event * _EVENT_BYTES}"


RAW = RawReader()
DAT = DatReader()
