"""Text files of events: one a line, "t x y p"."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray, find_column
from emseg.io.errors import ReadError
from emseg.io.numpy_files import to_microseconds
from emseg.io.sensors import infer_size

__all__ = ["TEXT", "TextReader"]

_COMMENTS: Final = ("#", "%", "//")
_SEPARATORS: Final = (",", ";", "\t")
_INTEGER: Final = re.compile(r"[+-]?\d+")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_IN_ORDER: Final = {"t": 0, "x": 1, "y": 2, "p": 3}
_PREAMBLE_LINES: Final = 1000
_EVENT_IN_MESSAGE: Final = re.compile(r"^event (\d+) ")


@dataclass(frozen=True)
class _Layout:
    """How a file's lines are to be read, as its first lines tell."""

    skip: int  # lines before the first event
    separator: str | None  # None: blanks
    columns: dict[str, int]  # place of t, x, y, p in a line
    fields: int  # numbers in a line
    size: tuple[int, int] | None  # from a line "width height"


class TextReader:
    """Lines "t x y p" parted by blanks, commas, semicolons or tabs.

    Comment lines (# % //) may come anywhere before the events and, with #, among them.  Then there may be a
    line "width height" or a header that names the columns, whose order it then gives.  Times are microseconds
    where all are whole numbers, and seconds where one is not.  Polarities are 0/1 or -1/1.
    """

    name = "text (t x y p)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it is text whose first lines are comments or events."""
        lines = _text_lines(head)
        return lines is not None and (_layout(lines) is not None or _only_comments(lines))

    def read(self, path: Path, *, size: tuple[int, int] | None = None) -> EventArray:
        """See :meth:`emseg.io.Reader.read`."""
        with path.open("rb") as file:
            head = file.read(65536)
        layout = _layout(_text_lines(head) or [])
        if layout is None:
            raise ReadError(path, "holds no line of numbers, expected events as lines t x y p")
        columns = _parse(path, layout)
        columns["t"] = to_microseconds(columns["t"], path, place="column t")
        try:
            if size is None:
                size = layout.size or infer_size(columns["x"], columns["y"], path)
            return EventArray(**columns, width=size[0], height=size[1])
        except ValueError as error:
            event = _EVENT_IN_MESSAGE.match(str(error))
            line = _line_of_event(path, layout, int(event[1])) if event else None
            raise ReadError(path, str(error), place=f"line {line}" if line else None) from None


def _text_lines(head: bytes) -> list[str] | None:
    """The whole lines in a file's first bytes, or None where they are no text."""
    if any(byte in head for byte in (b"\0", b"\x1b")):
        return None
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if error.start < len(head) - 4:  # else a character cut by the end of the head
            return None
        text = head[: error.start].decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith(_COMMENTS)


def _only_comments(lines: list[str]) -> bool:
    return bool(lines) and all(_is_comment(line) for line in lines)


def _fields(line: str, separator: str | None) -> list[str]:
    return [field.strip() for field in line.split(separator)]


def _layout(lines: list[str]) -> _Layout | None:
    """The layout, or None where the first lines are not those of an event file."""
    size: tuple[int, int] | None = None
    named: tuple[dict[str, int], int] | None = None
    for number, line in enumerate(lines[:_PREAMBLE_LINES]):
        if _is_comment(line):
            continue
        separator = next((s for s in _SEPARATORS if s in line), None)
        fields = _fields(line, separator)
        if len(fields) == 2 and size is None and all(_INTEGER.fullmatch(field) for field in fields):
            size = int(fields[0]), int(fields[1])
        elif all(_NUMBER.fullmatch(field) for field in fields):
            if named is not None:
                return _Layout(number, separator, *named, size)
            return _Layout(number, separator, dict(_IN_ORDER), 4, size) if len(fields) == 4 else None
        elif named is None:
            names = {column: find_column(fields, column) for column in "txyp"}
            if not all(names.values()):
                return None
            named = {column: fields.index(str(name)) for column, name in names.items()}, len(fields)
        else:
            return None
    if size is None and named is None:
        return None
    columns, fields_in_line = named or (dict(_IN_ORDER), 4)
    return _Layout(len(lines), None, columns, fields_in_line, size)


def _parse(path: Path, layout: _Layout) -> dict[str, npt.NDArray[Any]]:
    """The columns, as NumPy's parser reads them: it is as fast as that of pandas."""
    try:
        columns = _load(path, layout)
    except (ValueError, OverflowError):
        raise _fault(path, layout) from None
    if any(column.dtype.kind == "f" and np.isnan(column).any() for column in columns.values()):
        raise _fault(path, layout)
    return columns


def _load(path: Path, layout: _Layout) -> dict[str, npt.NDArray[Any]]:
    if next(_event_lines(path, layout), None) is None:
        return {column: np.empty(0, np.int64) for column in layout.columns}
    options: dict[str, Any] = {
        "delimiter": layout.separator,
        "skiprows": layout.skip,
        "comments": "#",
        "ndmin": 2,
        "encoding": "utf-8-sig",
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # else it takes 0.5 for an integer
        table = _integers_or_floats(path, options)
        if table.shape[1] != layout.fields:
            raise ValueError("wrong number of columns")
        columns = {column: table[:, index] for column, index in layout.columns.items()}
        if table.dtype.kind == "f":  # which says nothing about the times, whose own type gives their unit
            options |= {"usecols": [layout.columns["t"]]}
            columns["t"] = _integers_or_floats(path, options)[:, 0]
    return columns


def _integers_or_floats(path: Path, options: dict[str, Any]) -> npt.NDArray[Any]:
    try:
        return np.loadtxt(path, dtype=np.int64, **options)
    except (ValueError, OverflowError, DeprecationWarning):
        return np.loadtxt(path, dtype=np.float64, **options)


def _event_lines(path: Path, layout: _Layout) -> Iterator[tuple[int, str]]:
    """Number (from 1) and text of every line that should hold an event."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.partition("#")[0]
            if number > layout.skip and text.strip():
                yield number, text


def _line_of_event(path: Path, layout: _Layout, event: int) -> int | None:
    found = next(itertools.islice(_event_lines(path, layout), event, None), None)
    return found[0] if found else None


def _fault(path: Path, layout: _Layout) -> ReadError:
    """The first line that is not four numbers: found slowly, after a fast parser has failed."""
    for number, line in _event_lines(path, layout):
        fields = _fields(line, layout.separator)
        if len(fields) != layout.fields:
            return ReadError(
                path,
                f"{len(fields)} columns, expected {layout.fields}"
                + (" (t x y p)" if layout.fields == 4 else ""),
                place=f"line {number}",
            )
        for column, index in layout.columns.items():
            if not _NUMBER.fullmatch(fields[index]) or not abs(float(fields[index])) < 2.0**63:
                problem = f"{column} is '{fields[index][:40]}', expected a finite number"
                return ReadError(path, problem, place=f"line {number}")
    return ReadError(path, "cannot be read as events, expected lines t x y p")


TEXT = TextReader()
