"""Text files of events: one a line, "t x y p"."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.recording import Block, ReadOptions, Source
from emseg.io.tables import to_microseconds

__all__ = ["TEXT", "TextReader"]

_COMMENTS: Final = ("#", "%", "//")
_SEPARATORS: Final = (",", ";", "\t")
_INTEGER: Final = re.compile(r"[+-]?\d+")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
_PREAMBLE_LINES: Final = 1000
_HEAD_BYTES: Final = 65536
_BLOCK_BYTES: Final = 4 << 20
_LONGEST_LINE: Final = 1 << 20


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
    line "width height" or a header that names the columns, whose order it then gives.  Times are seconds
    where the first of them are fractions, else microseconds.  Polarities are 0/1 or -1/1.
    """

    name = "text (t x y p)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it is text whose first lines are comments or events."""
        lines = _text_lines(head)
        return lines is not None and (_layout(lines, "txyp") is not None or _only_comments(lines))

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _TextSource(path, options)


class _TextSource(Source):
    def __init__(self, path: Path, options: ReadOptions) -> None:
        with path.open("rb") as file:
            layout = _layout(_text_lines(file.read(_HEAD_BYTES)) or [], options.columns or "txyp")
        if layout is None:
            raise ReadError(path, "holds no line of numbers, expected events as lines t x y p")
        self._path, self._layout, self._unit = path, layout, options.time_unit
        self.size = layout.size

    def blocks(self) -> Iterator[Block]:
        unit, is_guess = self._unit, False
        for first_line, lines in self._pieces():
            piece = _Piece(self._path, self._layout, first_line, lines)
            columns = piece.parse()
            if columns is None:
                continue
            is_fraction = columns["t"].dtype.kind == "f"
            if unit is None:
                unit, is_guess = ("s" if is_fraction else "us"), True
            elif is_guess and unit == "us" and is_fraction:
                raise piece.fraction(columns["t"])
            t = to_microseconds(columns["t"], self._path, "column t", unit=unit)
            yield Block(columns["x"], columns["y"], t, columns["p"], piece.place)

    def _pieces(self) -> Iterator[tuple[int, list[str]]]:
        """Number (from 1) of the first line, and the lines, of one piece after the other."""
        number = 1
        with self._path.open("rb") as file:
            if file.read(3) != b"\xef\xbb\xbf":
                file.seek(0)
            for text in _whole_lines(file, self._path):
                lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
                skip = max(0, min(self._layout.skip - number + 1, len(lines)))
                yield number + skip, lines[skip:]
                number += len(lines) - 1  # the piece ends with a line break


def _whole_lines(file: IO[bytes], path: Path) -> Iterator[str]:
    """The file's text in pieces that end with a line break, or with the file."""
    rest = b""
    while data := file.read(_BLOCK_BYTES):
        cut = data.rfind(b"\n") + 1
        if cut == 0:
            rest += data
            if len(rest) > _BLOCK_BYTES + _LONGEST_LINE:
                raise ReadError(path, f"has a line of more than {_LONGEST_LINE} characters, expected t x y p")
            continue
        yield (rest + data[:cut]).decode("utf-8", "replace")
        rest = data[cut:]
    if rest:
        yield rest.decode("utf-8", "replace")


class _Piece:
    """Some successive lines of a file, of which each holds an event or none."""

    def __init__(self, path: Path, layout: _Layout, first_line: int, lines: list[str]) -> None:
        self._path, self._layout, self._first_line, self._lines = path, layout, first_line, lines

    def parse(self) -> dict[str, npt.NDArray[Any]] | None:
        """The columns as integers or floats, or None where no line holds an event."""
        if next(self._event_lines(), None) is None:
            return None
        try:
            columns = self._load()
        except (ValueError, OverflowError):
            raise self._fault() from None
        if any(column.dtype.kind == "f" and np.isnan(column).any() for column in columns.values()):
            raise self._fault()
        return columns

    def _load(self) -> dict[str, npt.NDArray[Any]]:
        text = "\n".join(self._lines)
        options: dict[str, Any] = {"delimiter": self._layout.separator, "comments": "#", "ndmin": 2}
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # else it takes 0.5 for an integer
            table = _integers_or_floats(text, options)
            if table.shape[1] != self._layout.fields:
                raise ValueError("wrong number of columns")
            columns = {column: table[:, index] for column, index in self._layout.columns.items()}
            if table.dtype.kind == "f":  # which says nothing about the times, whose own type gives their unit
                options |= {"usecols": [self._layout.columns["t"]]}
                columns["t"] = _integers_or_floats(text, options)[:, 0]
        return columns

    def place(self, event: int) -> str:
        """The line of an event."""
        for k, (number, _) in enumerate(self._event_lines()):
            if k == event:
                return f"line {number}"
        return f"line {self._first_line + len(self._lines)}"

    def fraction(self, t: npt.NDArray[Any]) -> ReadError:
        """The first line whose time is a fraction, in a file whose times began as whole microseconds."""
        event = int(np.argmax(t != np.floor(t)))
        problem = (
            f"t is {t[event]:g}, expected whole microseconds as on the lines before (or give a time unit)"
        )
        return ReadError(self._path, problem, place=self.place(event))

    def _event_lines(self) -> Iterator[tuple[int, str]]:
        """Number (from 1) and text of every line that should hold an event."""
        for number, line in enumerate(self._lines, start=self._first_line):
            text = line.partition("#")[0]
            if text.strip():
                yield number, text

    def _fault(self) -> ReadError:
        """The first line that is not four numbers: found slowly, after a fast parser has failed."""
        for number, line in self._event_lines():
            fields, expected = _fields(line, self._layout.separator), self._layout.fields
            if len(fields) != expected:
                order = " (t x y p)" if expected == 4 else ""
                problem = f"{len(fields)} columns, expected {expected}{order}"
                return ReadError(self._path, problem, place=f"line {number}")
            for column, index in self._layout.columns.items():
                if not _NUMBER.fullmatch(fields[index]) or not abs(float(fields[index])) < 2.0**63:
                    problem = f"{column} is '{fields[index][:40]}', expected a finite number"
                    return ReadError(self._path, problem, place=f"line {number}")
        return ReadError(self._path, "cannot be read as events, expected lines t x y p")


def _integers_or_floats(text: str, options: dict[str, Any]) -> npt.NDArray[Any]:
    """The numbers, as NumPy's parser reads them: it is as fast as that of pandas."""
    try:
        return np.loadtxt(io.StringIO(text), dtype=np.int64, **options)
    except (ValueError, OverflowError, DeprecationWarning):
        return np.loadtxt(io.StringIO(text), dtype=np.float64, **options)


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


def _layout(lines: list[str], order: str) -> _Layout | None:
    """The layout, or None where the first lines are not those of an event file.

    Args:
        lines: The file's first lines.
        order: Order of the columns where no header names them.
    """
    size: tuple[int, int] | None = None
    named: tuple[dict[str, int], int] | None = None
    in_order = {column: place for place, column in enumerate(order)}
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
            return _Layout(number, separator, in_order, 4, size) if len(fields) == 4 else None
        elif named is None:
            names = {column: find_column(fields, column) for column in "txyp"}
            if not all(names.values()):
                return None
            named = {column: fields.index(str(name)) for column, name in names.items()}, len(fields)
        else:
            return None
    if size is None and named is None:
        return None
    columns, fields_in_line = named or (in_order, 4)
    return _Layout(len(lines), None, columns, fields_in_line, size)


TEXT = TextReader()
