"""MATLAB files of events: variables x, y, ts, pol; a struct or table of them; or what AedatTools exports."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.hdf5 import Hdf5Source
from emseg.io.mat5 import read_mat5
from emseg.io.recording import BLOCK_EVENTS, Block, Frame, ImuSamples, ReadOptions, Source
from emseg.io.tables import block_of_columns, guess_order, guess_unit, is_table

__all__ = ["MATLAB", "MatlabReader"]

_MAGIC: Final = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
_SAMPLE_ROWS: Final = 10_000
_DEEPEST: Final = 6
_G: Final = 9.80665
_IMU_FIELDS: Final = ("timeStamp", "accelX", "accelY", "accelZ", "gyroX", "gyroY", "gyroZ")


class MatlabReader:
    """MATLAB files; DVSMOTION20's structs `aedat.data.polarity`, with `imu6` and `frame`, among them."""

    name = "MATLAB (.mat)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens as MATLAB's files do."""
        return head.startswith(_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        with path.open("rb") as file:
            is_hdf5 = file.read(len(_MAGIC[1])) == _MAGIC[1]
        return Hdf5Source(path, options) if is_hdf5 else _MatlabSource(path, options)


class _MatlabSource(Source):
    """A file up to version 7, whose variables can only be unpacked whole."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        try:
            self._root = read_mat5(path)
        except ValueError as error:
            raise ReadError(path, f"truncated or damaged: {error}") from None
        found = list(_event_tables("", self._root, _DEEPEST))
        self.streams = tuple(name for name, _ in found)
        chosen = [columns for name, columns in found if options.stream in (None, name)]
        if not chosen:
            asked = f"events {options.stream!r}" if options.stream else "events as x, y, t, p or a table"
            held = ", ".join(list(self._root)[:12]) or "nothing"
            raise ReadError(path, f"holds no {asked}; its variables: {held}")
        self._columns = self._ordered(chosen[0])
        lengths = {name: len(column) for name, column in self._columns.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ReadError(path, f"event columns have different lengths: {listed}")
        self._unit = options.time_unit or guess_unit(self._columns["t"])
        width, height = (_whole_side(self._root.get(name)) for name in ("width", "height"))
        self.size = (width, height) if width and height else None

    def blocks(self) -> Iterator[Block]:
        for start in range(0, len(self._columns["t"]), BLOCK_EVENTS):
            part = {name: column[start : start + BLOCK_EVENTS] for name, column in self._columns.items()}
            yield block_of_columns(part, self._path, "variables", start, self._unit)

    def frames(self) -> Iterator[Frame]:
        frames = self._aedat("frame")
        times = frames.get("timeStampStart", frames.get("timeStampEnd"))
        samples = frames.get("samples")
        if not isinstance(times, np.ndarray) or samples is None:
            return
        pictures = samples if isinstance(samples, list) else [samples]
        for picture, t in zip(pictures, np.ravel(times), strict=False):
            if isinstance(picture, np.ndarray) and picture.ndim in (2, 3):
                yield Frame(int(t), picture)

    def imu(self) -> ImuSamples:
        found = self._aedat("imu6")
        columns = [found.get(name) for name in _IMU_FIELDS]
        if not all(isinstance(column, np.ndarray) for column in columns):
            return ImuSamples()
        t, *values = (np.atleast_1d(np.asarray(column, np.float64)) for column in columns)
        table = np.stack(values, axis=1)
        return ImuSamples(t.astype(np.int64), np.deg2rad(table[:, 3:]), table[:, :3] * _G)

    def _ordered(self, events: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Columns x, y, t, p."""
        if "table" not in events:
            return events
        table = events["table"]
        order = self._options.columns or guess_order(table[:_SAMPLE_ROWS])
        return {column: table[:, k] for k, column in enumerate(order)}

    def _aedat(self, name: str) -> dict[str, Any]:
        """The fields of `aedat.data.<name>`; empty where there is none."""
        item: Any = self._root
        for key in ("aedat", "data", name):
            item = item.get(key) if isinstance(item, dict) else None
        return item if isinstance(item, dict) else {}


def _event_tables(
    name: str, fields: dict[str, Any], depth: int
) -> Iterator[tuple[str, dict[str, npt.NDArray[Any]]]]:
    """Whatever can be events in variables or a struct, and in the structs among them, by name."""
    numeric = {key: value for key, value in fields.items() if isinstance(value, np.ndarray)}
    names = {column: find_column(numeric, column) for column in "xytp"}
    if all(names.values()):
        columns = {column: np.atleast_1d(numeric[str(key)]) for column, key in names.items()}
        if all(column.ndim == 1 for column in columns.values()):
            yield name or "variables", columns
            return
    for key, value in fields.items():
        path = f"{name}.{key}" if name else key
        if isinstance(value, dict) and depth > 0:
            yield from _event_tables(path, value, depth - 1)
            continue
        is_named_so = "event" in path.lower() or len(fields) == 1
        if is_named_so and isinstance(value, np.ndarray) and is_table(value.shape, value.dtype):
            yield path, {"table": value}


def _whole_side(value: Any) -> int:
    is_number = isinstance(value, np.ndarray) and value.size == 1
    return int(value.item()) if is_number and 1 <= value.item() <= 65536 else 0


MATLAB = MatlabReader()
