"""Event arrays: what a camera reports, validated once and then trusted by every stage."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from typing import Any, Final, NoReturn, final

import numpy as np
import numpy.typing as npt

from emseg import _core

__all__ = ["EVENT_DTYPE", "EventArray"]

EVENT_DTYPE: Final = np.dtype([("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("p", "u1")])
"""Structured dtype of :meth:`EventArray.to_structured`."""

# Names under which other tools keep the same columns.
COLUMN_ALIASES: Final[Mapping[str, tuple[str, ...]]] = {
    "x": ("x", "xs", "x_pos"),
    "y": ("y", "ys", "y_pos"),
    "t": ("t", "ts", "time", "timestamp", "timestamps", "t_us"),
    "p": ("p", "ps", "pol", "polarity", "polarities", "on"),
}


def find_column(names: Iterable[str], column: str) -> str | None:
    """The first of `names` under which `column` ("x", "y", "t" or "p") may be kept, or None."""
    by_lower_case = {name.strip().lower(): name for name in reversed(list(names))}
    for alias in COLUMN_ALIASES[column]:
        if alias in by_lower_case:
            return by_lower_case[alias]
    return None


@final
class EventArray:
    """The events of a recording, or of a window of it, column by column.

    The columns are contiguous, read-only and of one length; they are views of the given arrays where those
    already have the right type, which must then not be changed any more.  Instances are frozen.

    Args:
        x: Column of each event, px, (n,), 0 .. width-1.
        y: Row of each event, px, (n,), 0 .. height-1.
        t: Time of each event, µs, (n,), never decreasing.  Floats must hold whole microseconds.
        p: Polarity of each event, (n,): 1 for a rise in brightness, and 0 or -1 (not both) for a fall.
        width: Width of the sensor, px.
        height: Height of the sensor, px.

    Raises:
        ValueError: naming the first offending event and what was expected.
    """

    __slots__ = ("height", "p", "t", "width", "x", "y")

    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    t: npt.NDArray[np.int64]
    p: npt.NDArray[np.uint8]
    width: int
    height: int

    def __init__(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        t: npt.ArrayLike,
        p: npt.ArrayLike,
        *,
        width: int,
        height: int,
    ) -> None:
        width, height = _sensor_side(width, "width"), _sensor_side(height, "height")
        columns = {name: _numeric(values, name) for name, values in zip("xytp", (x, y, t, p), strict=True)}
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"event columns have different lengths: {listed}")
        self._set(
            _to_integer(columns["x"], "x", np.dtype(np.uint16), (0, width - 1)),
            _to_integer(columns["y"], "y", np.dtype(np.uint16), (0, height - 1)),
            _to_integer(columns["t"], "t", np.dtype(np.int64), None),
            _to_polarity(columns["p"]),
            width,
            height,
        )
        _core.check_events(self.x, self.y, self.t, self.p, width, height)

    def _set(
        self,
        x: npt.NDArray[Any],
        y: npt.NDArray[Any],
        t: npt.NDArray[Any],
        p: npt.NDArray[Any],
        width: int,
        height: int,
    ) -> None:
        for name, column in zip("xytp", (x, y, t, p), strict=True):
            view = np.ascontiguousarray(column).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "height", height)

    def _select(self, index: Any) -> EventArray:
        """Events that are known to be valid already: a subset in the same order."""
        return self._of(self.x[index], self.y[index], self.t[index], self.p[index])

    def _of(
        self, x: npt.NDArray[Any], y: npt.NDArray[Any], t: npt.NDArray[Any], p: npt.NDArray[Any]
    ) -> EventArray:
        """Columns that are known to be valid, as events of the same sensor."""
        events = object.__new__(EventArray)
        events._set(x, y, t, p, self.width, self.height)
        return events

    @classmethod
    def from_structured(cls, events: npt.NDArray[Any], *, width: int, height: int) -> EventArray:
        """Events from a structured array (n,) with fields x, y, t, p.

        The names ts, timestamp, polarity, on and the like are known too.
        """
        events = np.asarray(events)
        names = events.dtype.names
        if names is None:
            raise ValueError(f"dtype {events.dtype} has no fields, expected a structured array of x, y, t, p")
        found = {column: find_column(names, column) for column in "xytp"}
        missing = [column for column, name in found.items() if name is None]
        if missing:
            raise ValueError(f"structured array lacks {', '.join(missing)}; its fields are {list(names)}")
        columns = (events[found[column]] for column in "xytp")
        return cls(*columns, width=width, height=height)

    @classmethod
    def concatenate(cls, parts: Iterable[EventArray]) -> EventArray:
        """One array of all `parts`, which must come from one sensor and follow each other in time."""
        parts = list(parts)
        if not parts:
            raise ValueError("nothing to concatenate, expected at least one EventArray")
        sizes = {(part.width, part.height) for part in parts}
        if len(sizes) > 1:
            listed = ", ".join(f"{w}x{h}" for w, h in sorted(sizes))
            raise ValueError(f"cannot concatenate events of sensors of different sizes: {listed}")
        width, height = sizes.pop()
        columns = (np.concatenate([getattr(part, name) for part in parts]) for name in "xytp")
        return cls(*columns, width=width, height=height)

    def to_structured(self) -> npt.NDArray[Any]:
        """A structured copy (n,) with fields x, y, t, p of dtype :data:`EVENT_DTYPE`."""
        events = np.empty(len(self), dtype=EVENT_DTYPE)
        for name in "xytp":
            events[name] = getattr(self, name)
        return events

    @property
    def duration(self) -> int:
        """Time from the first event to the last, µs; 0 where there is none."""
        return int(self.t[-1]) - int(self.t[0]) if len(self) else 0

    def between(self, t_start: int, t_stop: int) -> EventArray:
        """The events with t_start ≤ t < t_stop (µs), as views."""
        start, stop = np.searchsorted(self.t, [t_start, t_stop])
        return self._select(slice(int(start), int(stop)))

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: slice | npt.ArrayLike) -> EventArray:
        """A part of the events: views for a slice, copies for a mask or for rising indices."""
        if isinstance(index, slice):
            if index.step is not None and index.step < 0:
                raise ValueError(f"slice step is {index.step}, expected > 0: events stay in time order")
            return self._select(index)
        chosen = np.asarray(index)
        if chosen.ndim != 1 or chosen.dtype.kind not in "biu":
            if chosen.size == 0 and chosen.ndim == 1:
                return self._select(slice(0, 0))
            raise TypeError(f"cannot index events with {index!r}, expected a slice, mask or index array")
        if chosen.dtype.kind == "b":
            if len(chosen) != len(self):
                raise IndexError(f"mask has length {len(chosen)}, expected {len(self)}")
            return self._select(chosen)
        if chosen.dtype == np.uint64:  # what int64 does not hold is out of range as its largest is
            chosen = np.minimum(chosen, np.uint64(np.iinfo(np.int64).max))
        columns = _core.take_events(self.x, self.y, self.t, self.p, chosen.astype(np.int64, copy=False))
        return self._of(*columns)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, EventArray):
            return NotImplemented
        return (self.width, self.height) == (other.width, other.height) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in "xytp"
        )

    __hash__ = None  # type: ignore[assignment]  # compares by value, over arrays

    def __repr__(self) -> str:
        span = f"{self.t[0]}..{self.t[-1]} µs" if len(self) else "empty"
        return f"EventArray({len(self)} events, {self.width}x{self.height}, {span})"

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.x, self.y, self.t, self.p, self.width, self.height)

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"EventArray is frozen: cannot set {name!r}")

    def __delattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"EventArray is frozen: cannot delete {name!r}")


def _restore(x: Any, y: Any, t: Any, p: Any, width: int, height: int) -> EventArray:
    return EventArray(x, y, t, p, width=width, height=height)


def _sensor_side(value: object, name: str) -> int:
    try:
        side = operator.index(value)  # type: ignore[arg-type]  # that is what is being asked
    except TypeError:
        raise ValueError(f"sensor {name} is {value!r}, expected a whole number of pixels") from None
    if not 1 <= side <= 65536:
        raise ValueError(f"sensor {name} is {side}, expected 1..65536 px")
    return side


def _numeric(values: npt.ArrayLike, name: str) -> npt.NDArray[Any]:
    try:
        column = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} is no array of numbers: {error}") from None
    if column.ndim != 1:
        raise ValueError(f"{name} has shape {column.shape}, expected one dimension")
    if column.size == 0 and column.dtype.kind in "Of":
        return column.astype(np.int64)
    if column.dtype.kind not in "biuf":
        raise ValueError(f"{name} has dtype {column.dtype}, expected whole numbers")
    return column


def _first(offending: npt.NDArray[np.bool_]) -> int | None:
    """Index of the first True."""
    index = int(np.argmax(offending)) if offending.size else 0
    return index if offending.size and offending[index] else None


def _whole(column: npt.NDArray[Any], name: str) -> npt.NDArray[Any]:
    """The column as integers, where it holds floats that are whole."""
    if column.dtype.kind != "f":
        return column
    column = column.astype(np.float64, copy=False)
    if (bad := _first(~np.isfinite(column))) is not None:
        raise ValueError(f"event {bad} has {name} = {column[bad]}, expected a finite number")
    if (bad := _first(np.abs(column) >= 2.0**63)) is not None:
        raise ValueError(f"event {bad} has {name} = {column[bad]}, expected a 64-bit number")
    whole = column.astype(np.int64)
    if (bad := _first(whole != column)) is not None:
        hint = "whole microseconds (seconds: np.rint(t * 1e6))" if name == "t" else "a whole number"
        raise ValueError(f"event {bad} has {name} = {column[bad]}, expected {hint}")
    return whole


def _to_integer(
    column: npt.NDArray[Any], name: str, dtype: np.dtype[Any], bounds: tuple[int, int] | None
) -> npt.NDArray[Any]:
    if column.dtype == dtype:
        return column  # bounds are checked natively
    if column.dtype.kind == "b":
        raise ValueError(f"{name} has dtype bool, expected whole numbers")
    column = _whole(column, name)
    info = np.iinfo(dtype)
    low, high = bounds if bounds is not None else (int(info.min), int(info.max))
    if column.size and (int(column.min()) < low or int(column.max()) > high):
        bad = _first((column < low) | (column > high))
        assert bad is not None
        place = "outside the sensor, " if bounds is not None else ""
        raise ValueError(f"event {bad} has {name} = {column[bad]}, {place}expected {low}..{high}")
    return column.astype(dtype)


def _to_polarity(column: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    if column.dtype.kind == "b":
        return column.view(np.uint8)
    if column.dtype == np.uint8:
        return column  # the native check finds values above 1
    column = _whole(column, "p")
    if column.size and int(column.min()) == -1:
        if (bad := _first((column != -1) & (column != 1))) is not None:
            raise ValueError(f"event {bad} has polarity {column[bad]}, expected -1 or 1 as elsewhere")
        return (column > 0).astype(np.uint8)
    if (bad := _first((column < 0) | (column > 1))) is not None:
        raise ValueError(f"event {bad} has polarity {column[bad]}, expected 0 or 1, or -1 or 1")
    return column.astype(np.uint8)
