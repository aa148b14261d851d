"""Which reader takes a file: recognised by its content, imported when first asked."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Final, Protocol

from emseg.events import EventArray
from emseg.io.errors import ReadError
from emseg.io.foreign import describe

__all__ = ["ENTRY_POINT_GROUP", "Reader", "find_reader", "read", "readers"]

HEAD_BYTES: Final = 65536
"""Bytes from a file's start that readers are shown."""

ENTRY_POINT_GROUP: Final = "emseg.readers"
"""Packages may add readers: entry points of this group that name a :class:`Reader`."""

# Text comes last, since it is told by what it is not.
_BUILT_IN: Final = ("emseg.io.aedat4:AEDAT4", "emseg.io.numpy_files:NUMPY", "emseg.io.text:TEXT")


class Reader(Protocol):
    """One file format."""

    @property
    def name(self) -> str:
        """What the format is called in messages."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether the file is of this format, judged by its content; `head` holds its first bytes."""

    def read(self, path: Path, *, size: tuple[int, int] | None = None) -> EventArray:
        """The file's events.

        Args:
            path: The file.
            size: Width and height of the sensor, px, where they are not to be taken from the file.

        Raises:
            ReadError: where the file is no sound recording.
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


def find_reader(path: str | PathLike[str]) -> Reader:
    """The reader that recognises a file.

    Raises:
        ReadError: naming the format where it is a known one that cannot be read yet.
    """
    path = Path(path)
    head = _head(path)
    if not head:
        raise ReadError(path, "is empty, expected a recording")
    foreign = describe(head)
    if foreign is not None:
        raise ReadError(path, f"recognised as {foreign}, which is not supported yet")
    found = next((reader for reader in readers() if reader.recognises(path, head)), None)
    if found is None:
        names = ", ".join(reader.name for reader in readers())
        raise ReadError(path, f"is in no known format, expected one of: {names}")
    return found


def read(path: str | PathLike[str], *, width: int | None = None, height: int | None = None) -> EventArray:
    """The events of a recording; its format is recognised by the content.

    Args:
        path: An aedat4, npz, npy or text file.
        width: Width of the sensor, px; with `height`, instead of what the file says or lets guess.
        height: Height of the sensor, px.

    Raises:
        ReadError: a ValueError that names the file, the place in it and what was expected.
    """
    if (width is None) != (height is None):
        raise ValueError(f"width is {width} and height is {height}, expected both or neither")
    size = None if width is None or height is None else (width, height)
    path = Path(path)
    return find_reader(path).read(path, size=size)
