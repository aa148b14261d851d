"""NumPy archives (.npz) and arrays (.npy) of events."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray, find_column
from emseg.io.errors import ReadError
from emseg.io.sensors import infer_size

__all__ = ["NUMPY", "NumpyReader"]

_ZIP_MAGIC: Final = b"PK\x03\x04"
_EMPTY_ZIP_MAGIC: Final = b"PK\x05\x06"
_NPY_MAGIC: Final = b"\x93NUMPY"
_TABLE_KEYS: Final = ("events", "event", "arr_0")
_LOCAL_HEADER_BYTES: Final = 30


class NumpyReader:
    """Arrays x, y, t, p (or ts, polarity, …) with optional width and height; or one table `events`.

    The table is structured, or (n, 4) with columns t, x, y, p as EV-IMO has it.  Times are seconds where they
    are floats, and microseconds where they are integers.  Polarities are 0/1 or -1/1.  Other arrays are not
    read.
    """

    name = "NumPy archive (.npz, .npy)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it is an .npy, or an archive of arrays with names of at least two of our columns."""
        if head.startswith(_NPY_MAGIC):
            return True
        if not head.startswith((_ZIP_MAGIC, _EMPTY_ZIP_MAGIC)):
            return False
        try:
            with zipfile.ZipFile(path) as archive:
                names = archive.namelist()
        except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError):
            # Damaged: the first member's name, which comes first in the file, tells whether it was an npz.
            length = int.from_bytes(head[26:28], "little")
            return head[_LOCAL_HEADER_BYTES : _LOCAL_HEADER_BYTES + length].endswith(b".npy")
        keys = [name.removesuffix(".npy") for name in names if name.endswith(".npy")]
        columns = sum(find_column(keys, column) is not None for column in "xytp")
        return len(keys) == len(names) and (columns >= 2 or not set(_TABLE_KEYS).isdisjoint(keys))

    def read(self, path: Path, *, size: tuple[int, int] | None = None) -> EventArray:
        """See :meth:`emseg.io.Reader.read`."""
        arrays = _Arrays(path)
        columns = _columns(arrays)
        if size is None:
            width, height = arrays.number("width"), arrays.number("height")
            if (width is None) != (height is None):
                present, absent = ("width", "height") if height is None else ("height", "width")
                problem = f"the file gives {present}, expected {absent} too"
                raise ReadError(path, problem, place=f"key '{absent}'")
            if width is not None and height is not None:
                size = width, height
        try:
            if size is None:
                size = infer_size(columns["x"], columns["y"], path)
            return EventArray(**columns, width=size[0], height=size[1])
        except ValueError as error:
            raise ReadError(path, str(error)) from None


class _Arrays:
    """The arrays of a file by name, each decoded when asked for, with errors that name it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            loaded = np.load(path, allow_pickle=False)
        except Exception as error:  # whatever a damaged file makes of NumPy's and zlib's decoders
            raise ReadError(path, f"is no sound NumPy file, truncated or damaged: {_reason(error)}") from None
        self._archive: Mapping[str, Any] = {"events": loaded} if isinstance(loaded, np.ndarray) else loaded
        self.names = list(self._archive)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        try:
            array = self._archive[name]
        except Exception as error:  # as above; MemoryError where a damaged header claims a huge shape
            problem = f"cannot be decoded, truncated or damaged: {_reason(error)}"
            raise ReadError(self.path, problem, place=f"key '{name}'") from None
        if not isinstance(array, np.ndarray):
            raise ReadError(self.path, "is no NumPy array", place=f"key '{name}'")
        return array

    def number(self, name: str) -> int | None:
        """A whole number kept as an array of one value, or None where there is none."""
        if name not in self.names:
            return None
        array = self[name]
        if array.size != 1 or array.dtype.kind not in "iuf" or array.item() != np.floor(array.item()):
            raise ReadError(self.path, "expected one whole number", place=f"key '{name}'")
        return int(array.item())


def _reason(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0][:200]}" if text else type(error).__name__


def _columns(arrays: _Arrays) -> dict[str, npt.NDArray[Any]]:
    found = {column: find_column(arrays.names, column) for column in "xytp"}
    missing = [column for column, name in found.items() if name is None]
    if not missing:
        columns = {column: arrays[str(name)] for column, name in found.items()}
        for column, array in columns.items():
            if array.ndim != 1 or array.dtype.kind not in "biuf":
                raise ReadError(
                    arrays.path,
                    f"has shape {array.shape} and dtype {array.dtype}, expected one number an event",
                    place=f"key '{found[column]}'",
                )
        return columns | {"t": to_microseconds(columns["t"], arrays.path, place=f"key '{found['t']}'")}
    table = next((key for key in _TABLE_KEYS if key in arrays.names), None)
    if table is None:
        keys = ", ".join(arrays.names[:12]) or "none"
        problem = f"lacks {', '.join(missing)}: expected x, y, t, p or events; its keys: {keys}"
        raise ReadError(arrays.path, problem)
    return _table_columns(arrays[table], arrays.path, f"key '{table}'")


def _table_columns(table: npt.NDArray[Any], path: Path, place: str) -> dict[str, npt.NDArray[Any]]:
    if table.dtype.names is not None and table.ndim == 1:
        names = {column: find_column(table.dtype.names, column) for column in "xytp"}
        if all(names.values()):
            columns = {column: table[name] for column, name in names.items()}
            return columns | {"t": to_microseconds(columns["t"], path, place=place)}
    elif table.ndim == 2 and table.shape[1] == 4 and table.dtype.kind in "iuf":
        t, x, y, p = table.T
        return {"x": x, "y": y, "t": to_microseconds(t, path, place=place), "p": p}
    raise ReadError(
        path,
        f"has shape {table.shape} and dtype {table.dtype}, "
        "expected (n, 4) of t, x, y, p or fields of these names",
        place=place,
    )


def to_microseconds(t: npt.NDArray[Any], path: Path, *, place: str) -> npt.NDArray[Any]:
    """Times as they are where they are integers (µs), rounded to µs where they are floats (seconds)."""
    if t.dtype.kind != "f":
        return t
    microseconds = t.astype(np.float64) * 1e6
    wrong = ~(np.abs(microseconds) < 2.0**63)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ReadError(path, f"event {k} has time {t[k]} s, expected a finite time", place=place)
    return np.rint(microseconds).astype(np.int64)


NUMPY = NumpyReader()
