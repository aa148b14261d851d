"""Which reader takes a file: recognised by its content, imported when first asked."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Final, Literal, Protocol

from emseg.events import EventArray
from emseg.io.errors import ReadError
from emseg.io.foreign import describe
from emseg.io.recording import Damage, ReadOptions, Recording, Source

__all__ = ["ENTRY_POINT_GROUP", "Reader", "find_reader", "open_recording", "read", "readers"]

HEAD_BYTES: Final = 65536
"""Bytes from a file's start that readers are shown."""

ENTRY_POINT_GROUP: Final = "emseg.readers"
"""Packages may add readers: entry points of this group that name a :class:`Reader`."""

# Text comes last, since it is told by what it is not.
_BUILT_IN: Final = (
    "emseg.io.aedat4:AEDAT4",
    "emseg.io.aedat2:AEDAT2",
    "emseg.io.aedat3:AEDAT3",
    "emseg.io.prophesee:RAW",
    "emseg.io.prophesee:DAT",
    "emseg.io.bags:ROS1",
    "emseg.io.bags:ROS2",
    "emseg.io.hdf5:HDF5",
    "emseg.io.matlab:MATLAB",
    "emseg.io.event_stream_files:EVENT_STREAM",
    "emseg.io.numpy_files:NUMPY",
    "emseg.io.text:TEXT",
)


class Reader(Protocol):
    """One file format."""

    @property
    def name(self) -> str:
        """What the format is called in messages."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether the file is of this format, judged by its content; `head` holds its first bytes."""

    def open(self, path: Path, options: ReadOptions) -> Source:
        """The file, opened: its header is read, its events not yet.

        Raises:
            ReadError: where the file is no sound recording, or a package is missing to read it.
        """


@cache
def _load(target: str) -> Reader:
    module, _, attribute = target.partition(":")
    reader: Reader = getattr(importlib.import_module(module), attribute)
    return reader


def readers() -> Iterator[Reader]:
    """Every reader in the order of asking: those of other packages first, then the built-in ones."""
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        yield _load(entry.value)
    for target in _BUILT_IN:
        yield _load(target)


def _head(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise ReadError(path, "is a directory, expected a recording")
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except FileNotFoundError:
        raise ReadError(path, "no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        if isinstance(error, ReadError):
            raise
        raise ReadError(path, f"cannot be opened: {getattr(error, 'strerror', None) or error}") from None


def _file_of(path: Path) -> Path:
    """The file of a ROS 2 bag that is given as its folder; other paths as they are."""
    try:
        if not (path / "metadata.yaml").is_file():
            return path
    except (OSError, ValueError):  # ValueError: a path with a null byte
        return path
    files = sorted(file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        raise ReadError(path, f"is a ROS 2 bag of {len(files)} files, expected one of them: {names}")
    return files[0] if files else path


def find_reader(path: str | PathLike[str]) -> Reader:
    """The reader that recognises a file.

    Raises:
        ReadError: naming the format where it is a known one that cannot be read.
    """
    path = Path(path)
    head = _head(path)
    if not head:
        raise ReadError(path, "is empty, expected a recording")
    foreign = describe(head)
    if foreign is not None:
        raise ReadError(path, f"recognised as {foreign}")
    found = next((reader for reader in readers() if reader.recognises(path, head)), None)
    if found is None:
        names = ", ".join(reader.name for reader in readers())
        raise ReadError(path, f"is in no known format, expected one of: {names}")
    return found


def open_recording(
    path: str | PathLike[str],
    *,
    width: int | None = None,
    height: int | None = None,
    stream: str | None = None,
    columns: str | None = None,
    time_unit: Literal["s", "us"] | None = None,
    damage: Damage = "refuse",
) -> Recording:
    """Open a recording, to read it chunk by chunk; its format is recognised by the content.

    Args:
        path: A file of any of the formats of :func:`readers`, or the folder of a ROS 2 bag.
        width: Width of the sensor, px; with `height`, instead of what the file says or lets guess.
        height: Height of the sensor, px.
        stream: Which event stream to read where there are several: a topic, group, variable or name.
        columns: Order of the columns of text without a header, such as "xytp".
        time_unit: Unit of the times, where it cannot be told: seconds are taken where they are fractions.
        damage: "refuse" the file, or "keep" what can be read; see :class:`Recording`.

    Raises:
        ReadError: a ValueError that names the file, the place in it and what was expected.
    """
    if (width is None) != (height is None):
        raise ValueError(f"width is {width} and height is {height}, expected both or neither")
    size = None if width is None or height is None else (width, height)
    options = ReadOptions(size=size, stream=stream, columns=columns, time_unit=time_unit)
    path = _file_of(Path(path))
    reader = find_reader(path)
    try:
        source = reader.open(path, options)
    except ReadError:
        raise
    except (Exception, MemoryError) as error:  # what damage makes of other people's decoders
        lines = str(error).strip().splitlines() or [""]
        problem = f"truncated, damaged or no {reader.name}: {type(error).__name__}: {lines[0][:200]}"
        raise ReadError(path, problem) from None
    return Recording(path, reader.name, source, size=size, damage=damage)


def read(
    path: str | PathLike[str],
    *,
    width: int | None = None,
    height: int | None = None,
    span: tuple[float, float] | None = None,
    stream: str | None = None,
    columns: str | None = None,
    time_unit: Literal["s", "us"] | None = None,
    damage: Damage = "refuse",
) -> EventArray:
    """The events of a recording, all at once; its format is recognised by the content.

    Args:
        path: A file of any of the formats of :func:`readers`.
        width: Width of the sensor, px; with `height`, instead of what the file says or lets guess.
        height: Height of the sensor, px.
        span: Seconds from the first event, from (inclusive) and to (exclusive); None: all.
        stream: Which event stream to read where there are several: a topic, group, variable or name.
        columns: Order of the columns of text without a header, such as "xytp".
        time_unit: Unit of the times, where it cannot be told: seconds are taken where they are fractions.
        damage: "refuse" the file, or "keep" what can be read; see :class:`Recording`.

    Raises:
        ReadError: a ValueError that names the file, the place in it and what was expected.
    """
    with open_recording(
        path,
        width=width,
        height=height,
        stream=stream,
        columns=columns,
        time_unit=time_unit,
        damage=damage,
    ) as recording:
        return recording.read(span=span)
