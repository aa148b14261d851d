"""MATLAB files of events: variables x, y, ts, pol; a struct or table of them; or what AedatTools exports.

Files up to version 7 are read by SciPy, a variable at a time; those of version 7.3 are HDF5.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.hdf5 import Hdf5Source
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
    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        import scipy.io

        try:
            variables = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=True, chars_as_strings=True)
        except Exception as error:  # whatever damage makes of the parser
            lines = str(error).strip().splitlines() or [""]
            problem = f"truncated or damaged: {type(error).__name__}: {lines[0][:200]}"
            raise ReadError(path, problem) from None
        self._root = {name: value for name, value in variables.items() if not name.startswith("__")}
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
        sides = [_whole_side(self._root.get(name)) for name in ("width", "height")]
        self.size = (sides[0], sides[1]) if all(sides) else None

    def blocks(self) -> Iterator[Block]:
        for start in range(0, len(self._columns["t"]), BLOCK_EVENTS):
            part = {name: column[start : start + BLOCK_EVENTS] for name, column in self._columns.items()}
            yield block_of_columns(part, self._path, "times", start, self._unit)

    def frames(self) -> Iterator[Frame]:
        frames = self._aedat("frame")
        samples, times = frames.get("samples"), frames.get("timeStampStart", frames.get("timeStampEnd"))
        if samples is None or times is None:
            return
        pictures = samples if samples.dtype == object else [samples]
        for picture, t in zip(pictures, np.ravel(times), strict=False):
            if isinstance(picture, np.ndarray) and picture.ndim in (2, 3):
                yield Frame(int(t), picture)

    def imu(self) -> ImuSamples:
        found = self._aedat("imu6")
        if not all(name in found for name in _IMU_FIELDS):
            return ImuSamples()
        t, *values = (np.atleast_1d(found[name]) for name in _IMU_FIELDS)
        table = np.stack([np.asarray(value, np.float64) for value in values], axis=1)
        return ImuSamples(t.astype(np.int64), np.deg2rad(table[:, 3:]), table[:, :3] * _G)

    def _ordered(self, events: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Columns x, y, t, p."""
        if "table" in events:
            table = events["table"]
            order = self._options.columns or guess_order(table[:_SAMPLE_ROWS])
            events = {column: table[:, k] for k, column in enumerate(order)}
        self._unit = self._options.time_unit or guess_unit(events["t"])
        return events

    def _aedat(self, name: str) -> dict[str, Any]:
        """The fields of `aedat.data.<name>`; empty where there is none."""
        item: Any = self._root
        for key in ("aedat", "data", name):
            item = _fields(item).get(key)
        return _fields(item)


def _fields(item: Any) -> dict[str, Any]:
    """The members of a mapping or of a MATLAB struct."""
    if isinstance(item, dict):
        return item
    if isinstance(item, np.ndarray) and item.dtype.names is not None and item.size == 1:
        record = item.reshape(-1)[0]
        return {name: record[name] for name in item.dtype.names}
    if isinstance(item, np.void) and item.dtype.names is not None:
        return {name: item[name] for name in item.dtype.names}
    return {}


def _event_tables(name: str, item: Any, depth: int) -> Iterator[tuple[str, dict[str, npt.NDArray[Any]]]]:
    """Whatever can be events in a variable and what it holds, by name."""
    fields = _fields(item)
    numeric = {
        key: np.atleast_1d(value)
        for key, value in fields.items()
        if isinstance(value, np.ndarray | np.number) and np.asarray(value).dtype.kind in "biuf"
    }
    names = {column: find_column(numeric, column) for column in "xytp"}
    if all(names.values()):
        columns = {column: numeric[str(key)] for column, key in names.items()}
        if all(column.ndim == 1 for column in columns.values()):
            yield name or "variables", columns
            return
    for key, value in fields.items():
        path = f"{name}.{key}" if name else key
        if isinstance(value, np.ndarray) and is_table(value.shape, value.dtype) and value.dtype.names is None:
            if "event" in path.lower() or len(fields) == 1:
                yield path, {"table": value}
        elif depth > 0:
            yield from _event_tables(path, value, depth - 1)


def _whole_side(value: Any) -> int:
    side = np.ravel(np.asarray(value if value is not None else 0))
    return int(side[0]) if side.size == 1 and side.dtype.kind in "iuf" and 1 <= side[0] <= 65536 else 0


MATLAB = MatlabReader()
