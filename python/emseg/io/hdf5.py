"""HDF5 recordings: DSEC, MVSEC, EVIMO2-style and others of like layout, and MATLAB 7.3 files.

Three layouts of events are known, wherever in the file they lie: a group of columns x, y, t, p (or xs, ts,
polarity, …), a group of t, p and xy (n, 2), and a table, structured or (n, 4).
"""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.extras import require
from emseg.io.recording import BLOCK_EVENTS, Block, Frame, ImuSamples, ReadOptions, Source
from emseg.io.tables import block_of_columns, block_of_table, guess_order, guess_unit, is_table

__all__ = ["HDF5", "Hdf5Reader", "Hdf5Source"]

_MAGIC: Final = b"\x89HDF\r\n\x1a\n"
_ECF: Final = 0x8ECF  # Prophesee's event compression format, a filter of HDF5
_MOST_OBJECTS: Final = 10_000
_SAMPLE_ROWS: Final = 10_000
_SOUND_FILTERS: Final = (1, 2, 3, 4, 5, 6, 32000)  # HDF5's own and h5py's: they check what they unpack
_PROBE_ROWS: Final = 1 << 20
_PROBE_START_S: Final = 15.0
_PROBE_EVENTS_PER_S: Final = 1e6  # slowest machine
# Unpacks datasets in a process of its own, which damage may end.
_PROBE: Final = f"""
import sys, h5py, hdf5plugin
with h5py.File(sys.argv[1], "r") as file:
    for name in sys.argv[2:]:
        for start in range(0, file[name].shape[0], {_PROBE_ROWS}):
            file[name][start : start + {_PROBE_ROWS}]
"""
_MOST_EVENTS_PER_BYTE: Final = 1000  # compressed further than any codec does


@dataclass(frozen=True)
class _Layout:
    name: str  # of the group or dataset
    kind: Literal["columns", "xy", "table"]
    members: dict[str, str]  # datasets by what they hold: x, y (or xy), t, p; or table
    count: int


class Hdf5Reader:
    """Events in HDF5, with images and inertial measurements as MVSEC keeps them."""

    name = "HDF5 (.h5, .hdf5)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens as an HDF5 file does."""
        return head.startswith(_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return Hdf5Source(path, options)


class Hdf5Source(Source):
    """An open HDF5 file of events."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self._path, self._options = path, options
        self._h5: Any = require("h5py", "h5py", "HDF5", path)
        with contextlib.suppress(ReadError):
            require("hdf5plugin", "hdf5plugin", "HDF5 with compression filters", path)
        try:
            self._file = self._h5.File(path, "r")
        except OSError as error:
            raise ReadError(path, f"truncated or damaged: {_first_line(error)}") from None
        try:
            self._find_events()
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        self._file.close()

    def blocks(self) -> Iterator[Block]:
        if not self._is_probed:
            self._probe()
        layout, unit = self._layout, self._unit
        place = f"dataset '{layout.name}'"
        for start in range(0, layout.count, BLOCK_EVENTS):
            stop = min(start + BLOCK_EVENTS, layout.count)
            parts = {what: self._rows(name, start, stop) for what, name in layout.members.items()}
            if layout.kind == "table":
                block = block_of_table(parts["table"], self._path, place, start, self._order, unit)
            else:
                if layout.kind == "xy":
                    parts["x"], parts["y"] = parts["xy"][:, 0], parts["xy"][:, 1]
                block = block_of_columns(parts, self._path, place, start, unit)
            yield Block(block.x, block.y, block.t + self._offset, block.p, block.locate)

    def frames(self) -> Iterator[Frame]:
        times = self._beside("image_raw_ts")
        images = self._beside("image_raw")
        if times is None or images is None or images.ndim != 3:
            return
        for k in range(min(len(times), len(images))):
            yield Frame(round(float(times[k]) * 1e6), images[k])

    def imu(self) -> ImuSamples:
        times, values = self._beside("imu_ts"), self._beside("imu")
        if times is None or values is None or values.ndim != 2 or values.shape[1] != 6:
            return ImuSamples()
        table = values[:].astype(np.float64)
        t = np.rint(times[:].astype(np.float64) * 1e6).astype(np.int64)
        return ImuSamples(t, table[:, 3:], table[:, :3])

    def _find_events(self) -> None:
        layouts = self._layouts()
        self.streams = tuple(layout.name for layout in layouts)
        wanted = self._options.stream
        chosen = [
            layout for layout in layouts if wanted is None or layout.name.strip("/") == wanted.strip("/")
        ]
        if not chosen:
            names: list[str] = []
            self._file.visit(lambda name: names.append(name) if len(names) < 12 else name)
            expected = f"events {wanted!r}" if wanted else "events as x, y, t, p or a table"
            raise ReadError(self._path, f"holds no {expected}; it holds: {', '.join(names) or 'nothing'}")
        self._layout = chosen[0]
        self._check_count()
        self._is_probed = True
        for name in self._layout.members.values():
            self._check_codecs(name)
        self.size = self._find_size()
        self._order = "txyp"
        if self._layout.kind == "table":
            sample = self._rows(self._layout.members["table"], 0, min(self._layout.count, _SAMPLE_ROWS))
            if sample.dtype.names is None:
                self._order = self._options.columns or guess_order(sample)
        self._unit = self._options.time_unit
        if self._unit is None and "t" in self._layout.members:
            sample = self._rows(self._layout.members["t"], 0, min(self._layout.count, _SAMPLE_ROWS))
            self._unit = guess_unit(sample)
        offset = self._file.get("t_offset")  # DSEC
        has_offset = isinstance(offset, self._h5.Dataset) and offset.shape in ((), (1,))
        self._offset = int(np.ravel(offset[()])[0]) if has_offset else 0

    def _check_count(self) -> None:
        """Refuse a damaged length: HDF5 would make up the events that are missing, without end."""
        count, file_bytes = self._layout.count, self._path.stat().st_size
        if count > _MOST_EVENTS_PER_BYTE * file_bytes:
            problem = f"damaged: has {count} events in a file of {file_bytes} bytes"
            raise ReadError(self._path, problem, place=f"dataset '{self._layout.name}'")

    def _layouts(self) -> list[_Layout]:
        """All that can be events, those named so first."""
        found: list[_Layout] = []
        visited = 0

        def visit(name: str, item: Any) -> bool | None:
            nonlocal visited
            visited += 1
            layout = (
                self._table_at(name, item)
                if isinstance(item, self._h5.Dataset)
                else self._group_at(name, item)
            )
            if layout is not None:
                found.append(layout)
            return True if visited >= _MOST_OBJECTS else None  # ends the walk

        visit("/", self._file)
        self._file.visititems(visit)
        return sorted(found, key=lambda layout: ("event" not in layout.name.lower(), layout.name))

    def _group_at(self, name: str, group: Any) -> _Layout | None:
        datasets = {
            key: group[key] for key in group if isinstance(group.get(key, default=None), self._h5.Dataset)
        }
        names = {column: find_column(datasets, column) for column in "xytp"}
        kind: Literal["columns", "xy"] = "columns"
        if "xy" in datasets and names["t"] and names["p"]:
            kind, names = "xy", {"xy": "xy", "t": names["t"], "p": names["p"]}
        if not all(names.values()):
            return None
        members = {what: f"{name.rstrip('/')}/{key}" for what, key in names.items()}
        lengths = set()
        for what, key in names.items():
            dataset = datasets[str(key)]
            shape = _squeezed(dataset.shape)
            if dataset.dtype.kind not in "biuf" or len(shape) != (2 if what == "xy" else 1):
                return None
            lengths.add(shape[0])
        if len(lengths) != 1:
            listed = ", ".join(f"{key} {_squeezed(datasets[str(key)].shape)[0]}" for key in names.values())
            raise ReadError(self._path, f"columns of different lengths: {listed}", place=f"group '{name}'")
        return _Layout(name, kind, members, lengths.pop())

    def _table_at(self, name: str, dataset: Any) -> _Layout | None:
        shape, dtype = dataset.shape, dataset.dtype
        is_named_so = "event" in name.lower() or dtype.names is not None
        if not is_named_so or shape is None or len(shape) == 0:
            return None
        if is_table(shape, dtype):
            return _Layout(name, "table", {"table": name}, shape[0])
        # MATLAB 7.3 keeps matrices transposed.
        if len(shape) == 2 and is_table(shape[::-1], dtype):
            return _Layout(name, "table", {"table": name}, shape[1])
        return None

    def _rows(self, name: str, start: int, stop: int) -> npt.NDArray[Any]:
        dataset = self._file[name]
        try:
            shape = dataset.shape
            is_transposed = len(shape) == 2 and shape[0] in (1, 2, 4) and shape[1] not in (1, 2, 4)
            part = np.asarray(dataset[:, start:stop].T if is_transposed else dataset[start:stop])
            return part[:, 0] if part.ndim == 2 and part.shape[1] == 1 else part
        except OSError as error:
            problem = f"truncated or damaged: {_first_line(error)}"
            raise ReadError(self._path, problem, place=f"dataset '{name}' from event {start}") from None

    def _check_codecs(self, name: str) -> None:
        properties = self._file[name].id.get_create_plist()
        for k in range(properties.get_nfilters()):
            number, _, _, text = properties.get_filter(k)
            self._is_probed &= number in _SOUND_FILTERS
            if self._h5.h5z.filter_avail(number):
                continue
            place = f"dataset '{name}'"
            if number == _ECF:
                problem = (
                    "is compressed with Prophesee's codec ECF, which no Python package decodes: convert it "
                    "with Metavision's `metavision_file_to_dat -i FILE`, "
                    "or let HDF5_PLUGIN_PATH name the folder of its plugin"
                )
                raise ReadError(self._path, problem, place=place)
            known = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            problem = f"is compressed with filter {number} ({known}), which is not installed"
            raise ReadError(
                self._path, f"{problem}: pip install 'emseg[io]', or a plugin for it", place=place
            )

    def _probe(self) -> None:
        """Find out whether a filter dies of the data, as Blosc was seen to: once, and elsewhere."""
        names = [f"/{name.strip('/')}" for name in self._layout.members.values()]
        command = [sys.executable, "-c", _PROBE, str(self._path.resolve()), *names]
        problem = ""
        try:
            done = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=_PROBE_START_S + self._layout.count / _PROBE_EVENTS_PER_S,
            )
        except subprocess.TimeoutExpired:
            problem = "damaged: its compression filter does not come to an end"
        else:
            if done.returncode < 0:  # ended by a signal; errors come up again, with their place
                problem = "damaged: its compression filter dies of it"
        if problem:
            raise ReadError(self._path, problem, place=f"dataset '{self._layout.name}'")
        self._is_probed = True

    def _beside(self, name: str) -> Any:
        """A dataset in the group of the events, or None."""
        parent = self._layout.name.strip("/").rpartition("/")[0]
        item = self._file.get(f"{parent}/{name}" if parent else name)
        return item if isinstance(item, self._h5.Dataset) else None

    def _find_size(self) -> tuple[int, int] | None:
        """The sensor's size by attributes of the events, of what holds them, or by a picture beside them."""
        item = self._file[self._layout.name]
        for place in (item, item.parent, self._file):
            for read in (_sides, _resolution, _geometry):
                if (size := read(place.attrs)) is not None:
                    return size
        for name, axes in (("image_raw", 3), ("image1", 2)):
            pictures = self._beside(name)
            if pictures is not None and pictures.ndim == axes:
                return int(pictures.shape[-1]), int(pictures.shape[-2])
        return None


def _squeezed(shape: tuple[int, ...]) -> tuple[int, ...]:
    """MATLAB's columns (1, n) and (n, 1) as (n,), its matrices (2, n) as (n, 2)."""
    if len(shape) == 2 and 1 in shape:
        return (max(shape),) if 0 not in shape else (0,)
    return shape[::-1] if len(shape) == 2 and shape[0] == 2 and shape[1] != 2 else shape


def _whole_side(value: Any) -> int:
    number = np.ravel(value)
    is_number = number.size == 1 and number.dtype.kind in "iuf"
    return int(number[0]) if is_number and 1 <= number[0] <= 65536 else 0


def _attribute(attributes: Any, name: str, default: Any) -> Any:
    """An attribute, but for texts of variable length: HDF5 was seen to look for damaged ones for ever."""
    if name not in attributes or attributes.get_id(name).dtype.hasobject:
        return default
    return attributes[name]


def _sides(attributes: Any) -> tuple[int, int] | None:
    width, height = (_whole_side(_attribute(attributes, name, 0)) for name in ("width", "height"))
    return (width, height) if width and height else None


def _resolution(attributes: Any) -> tuple[int, int] | None:
    """As the tools of the Robotics and Perception Group write it: rows and columns."""
    sides = np.ravel(_attribute(attributes, "sensor_resolution", ()))
    if sides.size < 2 or sides.dtype.kind not in "iuf":
        return None
    height, width = _whole_side(sides[0]), _whole_side(sides[1])
    return (width, height) if width and height else None


def _geometry(attributes: Any) -> tuple[int, int] | None:
    """As Prophesee writes it: "1280x720"."""
    text = _attribute(attributes, "geometry", b"")
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text.decode() if isinstance(text, bytes) else str(text))
    return (int(match[1]), int(match[2])) if match and int(match[1]) and int(match[2]) else None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]


HDF5 = Hdf5Reader()
