"""NumPy archives (.npz) and arrays (.npy) of events."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.recording import BLOCK_EVENTS, Block, ReadOptions, Source
from emseg.io.tables import block_of_columns, block_of_table, is_table

__all__ = ["NUMPY", "NumpyReader"]

_ZIP_MAGIC: Final = b"PK\x03\x04"
_EMPTY_ZIP_MAGIC: Final = b"PK\x05\x06"
_NPY_MAGIC: Final = b"\x93NUMPY"
_TABLE_KEYS: Final = ("events", "event", "arr_0")
_LOCAL_HEADER_BYTES: Final = 30


class NumpyReader:
    """Arrays x, y, t, p (or ts, polarity, …) with optional width and height; or one table `events`.

    The table is structured, or (n, 4) with columns t, x, y, p as EV-IMO has it; in an .npy it is the array.
    Times are seconds where they are floats, and microseconds where they are integers.  Polarities are 0/1 or
    -1/1.  Other arrays are not read.
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

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        with path.open("rb") as file:
            is_archive = file.read(2) == _ZIP_MAGIC[:2]
        return _ArchiveSource(path, options) if is_archive else _ArraySource(path, options)


class _ArraySource(Source):
    """A table in an .npy, mapped into memory piece by piece."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        try:
            # An empty array cannot be mapped.
            mode: Any = "r" if path.stat().st_size > 4096 else None
            self._table = np.load(path, mmap_mode=mode, allow_pickle=False)
        except Exception as error:  # whatever a damaged file makes of NumPy
            raise ReadError(path, f"is no sound NumPy file, truncated or damaged: {_reason(error)}") from None
        if not is_table(self._table.shape, self._table.dtype):
            raise ReadError(path, _no_table(self._table.shape, self._table.dtype))

    def blocks(self) -> Iterator[Block]:
        for start in range(0, len(self._table), BLOCK_EVENTS):
            part = np.asarray(self._table[start : start + BLOCK_EVENTS])
            yield block_of_table(part, self._path, "array", start, "txyp", self._options.time_unit)


class _ArchiveSource(Source):
    """The arrays of an .npz, unpacked side by side as they are needed."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        try:
            self._archive = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError) as error:
            raise ReadError(path, f"is no sound NumPy file, truncated or damaged: {_reason(error)}") from None
        try:
            names = self._archive.namelist()
            self._names = [name.removesuffix(".npy") for name in names if name.endswith(".npy")]
            self._table, self._columns = self._find_events()
            self.size = self._read_size()
        except BaseException:
            self._archive.close()
            raise

    def close(self) -> None:
        self._archive.close()

    def blocks(self) -> Iterator[Block]:
        unit = self._options.time_unit
        with contextlib.ExitStack() as stack:
            if self._table is not None:
                table = stack.enter_context(self._array(self._table))
                for start in range(0, table.length, BLOCK_EVENTS):
                    place = f"key '{self._table}'"
                    yield block_of_table(table.next(), self._path, place, start, "txyp", unit)
                return
            columns = {
                column: stack.enter_context(self._array(name)) for column, name in self._columns.items()
            }
            for start in range(0, columns["t"].length, BLOCK_EVENTS):
                parts = {column: array.next() for column, array in columns.items()}
                place = f"key '{self._columns['t']}'"
                yield block_of_columns(parts, self._path, place, start, unit)

    def _find_events(self) -> tuple[str | None, dict[str, str]]:
        """The name of the table, or else those of the columns, all of one length."""
        names = {column: find_column(self._names, column) for column in "xytp"}
        if not all(names.values()):
            table = next((key for key in _TABLE_KEYS if key in self._names), None)
            if table is None:
                missing = ", ".join(column for column, name in names.items() if name is None)
                keys = ", ".join(self._names[:12]) or "none"
                problem = f"lacks {missing}: expected x, y, t, p or events; its keys: {keys}"
                raise ReadError(self._path, problem)
            with self._array(table) as array:
                if not is_table(array.shape, array.dtype):
                    place = f"key '{table}'"
                    raise ReadError(self._path, _no_table(array.shape, array.dtype), place=place)
            return table, {}
        columns = {column: str(name) for column, name in names.items()}
        lengths = {}
        for name in columns.values():
            with self._array(name) as array:
                if len(array.shape) != 1 or array.dtype.kind not in "biuf":
                    problem = f"has shape {array.shape} and dtype {array.dtype}, expected one number an event"
                    raise ReadError(self._path, problem, place=f"key '{name}'")
                lengths[name] = array.length
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ReadError(self._path, f"event columns have different lengths: {listed}")
        return None, columns

    def _read_size(self) -> tuple[int, int] | None:
        sides = self._number("width"), self._number("height")
        if self._options.size is not None or sides == (None, None):
            return None
        width, height = sides
        if width is None or height is None:
            present, absent = ("width", "height") if height is None else ("height", "width")
            problem = f"the file gives {present}, expected {absent} too"
            raise ReadError(self._path, problem, place=f"key '{absent}'")
        return width, height

    def _number(self, name: str) -> int | None:
        """A whole number kept as an array of one value, or None where there is none."""
        if name not in self._names:
            return None
        with self._array(name) as array:
            if array.length == 1 and len(array.shape) <= 1 and array.dtype.kind in "iuf":
                value = float(array.next().item())
                if 1 <= value <= 65536 and value == int(value):
                    return int(value)
                problem = f"sensor {name} is {value:g}, expected a whole number in 1..65536"
                raise ReadError(self._path, problem, place=f"key '{name}'")
        raise ReadError(self._path, "expected one whole number", place=f"key '{name}'")

    def _array(self, name: str) -> _ArchivedArray:
        return _ArchivedArray(self._archive, self._path, name)


class _ArchivedArray:
    """One array of an archive, read piece by piece, with errors that name it."""

    def __init__(self, archive: zipfile.ZipFile, path: Path, name: str) -> None:
        self._path, self._name = path, name
        try:
            self._file: IO[bytes] = archive.open(f"{name}.npy")
            self.shape, is_fortran, self.dtype = self._header()
        except Exception as error:  # whatever a damaged file makes of NumPy's and zlib's decoders
            raise self._damage(error) from None
        if self.dtype.hasobject:
            raise ReadError(path, "cannot be decoded: Object arrays are refused", place=f"key '{name}'")
        self.length = int(np.prod(self.shape[:1], dtype=np.int64)) if self.shape else 1
        self._columns = self.shape[1:]
        self._is_fortran = is_fortran and len(self.shape) > 1
        self._position = 0

    def _header(self) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
        version = np.lib.format.read_magic(self._file)
        if version == (1, 0):
            return np.lib.format.read_array_header_1_0(self._file)
        if version == (2, 0):
            return np.lib.format.read_array_header_2_0(self._file)
        raise ValueError(f"array format {version} is not known")

    def next(self) -> npt.NDArray[Any]:
        """The next rows, at most BLOCK_EVENTS."""
        count = min(self.length - self._position, BLOCK_EVENTS)
        rows = self.length if self._is_fortran else count
        wanted = rows * int(np.prod(self._columns, dtype=np.int64)) * self.dtype.itemsize
        try:
            if self._is_fortran:  # column by column: cannot be read by rows, so it is kept
                if self._position == 0:
                    flat = np.frombuffer(self._bytes(wanted), self.dtype)
                    self._whole = flat.reshape((*reversed(self._columns), self.length)).T
                part = self._whole[self._position : self._position + count]
            else:
                part = np.frombuffer(self._bytes(wanted), self.dtype).reshape(count, *self._columns)
                if self._position + count == self.length:
                    self._file.read(1)  # at the end the archive's checksum is compared
        except Exception as error:  # as above
            raise self._damage(error) from None
        self._position += count
        return part

    def _bytes(self, wanted: int) -> bytes:
        data = self._file.read(wanted)
        if len(data) < wanted:
            raise ValueError(f"ends after {len(data)} of {wanted} bytes")
        return data

    def _damage(self, error: Exception) -> ReadError:
        problem = f"cannot be decoded, truncated or damaged: {_reason(error)}"
        return ReadError(self._path, problem, place=f"key '{self._name}'")

    def __enter__(self) -> _ArchivedArray:
        return self

    def __exit__(self, *ignored: object) -> None:
        self._file.close()


def _no_table(shape: tuple[int, ...], dtype: np.dtype[Any]) -> str:
    return f"has shape {shape} and dtype {dtype}, expected (n, 4) of t, x, y, p or fields of these names"


def _reason(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0][:200]}" if text else type(error).__name__


NUMPY = NumpyReader()
