"""Blocks of events from arrays: columns of any names, or tables of four columns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from emseg.events import find_column
from emseg.io.errors import ReadError
from emseg.io.recording import Block, at

__all__ = ["block_of_columns", "block_of_table", "guess_order", "guess_unit", "is_table", "to_microseconds"]

TimeUnit = Literal["s", "us"] | None


def to_microseconds(
    t: npt.NDArray[Any], path: Path, place: str, *, unit: TimeUnit = None, first: int = 0
) -> npt.NDArray[np.int64]:
    """Times in µs, rounded.

    Args:
        t: Times, (n,).
        path: The file, for errors.
        place: The place in it, for errors.
        unit: Their unit; None: seconds where they are floats, µs where they are integers.
        first: Number of the first event, for errors.

    Raises:
        ReadError: at the first time that is not finite or beyond 64 bits.
    """
    if unit is None:
        unit = "s" if t.dtype.kind == "f" else "us"
    if unit == "us" and t.dtype.kind != "f":
        if t.dtype == np.uint64 and len(t) and int(t.max()) >= 2**63:
            k = int(np.argmax(t >= 2**63))
            raise ReadError(path, f"event {first + k} has time {t[k]} us, expected 64 bits", place=place)
        return t.astype(np.int64, copy=False)
    with np.errstate(invalid="ignore", over="ignore"):
        microseconds = t.astype(np.float64) * (1e6 if unit == "s" else 1.0)
    wrong = ~(np.abs(microseconds) < 2.0**63)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ReadError(
            path, f"event {first + k} has time {t[k]} {unit}, expected a finite time", place=place
        )
    return np.rint(microseconds).astype(np.int64)


def is_table(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
    """Whether an array can be a table of events: (n, 4), or (n,) with fields that name the columns."""
    if dtype.names is not None:
        fields = dtype.names
        numeric = all(dtype[name].kind in "biuf" and not dtype[name].shape for name in fields)
        return len(shape) == 1 and numeric and all(find_column(fields, column) for column in "xytp")
    return len(shape) == 2 and shape[1] == 4 and dtype.kind in "iuf"


def guess_unit(t: npt.NDArray[Any]) -> Literal["s", "us"]:
    """The unit of times: seconds where some are fractions, else µs; MATLAB's numbers are floats anyway."""
    with np.errstate(invalid="ignore"):
        return "s" if t.dtype.kind == "f" and bool((t != np.floor(t)).any()) else "us"


def guess_order(sample: npt.NDArray[Any]) -> str:
    """The order of the columns of a table (n, 4) by what its first rows hold, such as "xytp".

    Polarities are the column that holds -1, 0 and 1 only; times, that which rises, and furthest; x comes
    before y.  Where that does not decide, "xytp", as MVSEC has it.
    """
    if len(sample) < 2:
        return "xytp"
    values = sample.astype(np.float64)
    if not np.isfinite(values).all():
        return "xytp"
    signs = [k for k in range(4) if np.isin(values[:, k], (-1, 0, 1)).all()]
    rising = [k for k in range(4) if k not in signs[-1:] and (np.diff(values[:, k]) >= 0).all()]
    if not signs or not rising:
        return "xytp"
    p = signs[-1]
    whole = [k for k in rising if (values[:, k] == np.floor(values[:, k])).all()]
    fractional = [k for k in rising if k not in whole]
    t = fractional[0] if fractional else max(rising, key=lambda k: values[-1, k] - values[0, k])
    places = [k for k in range(4) if k not in (t, p)]
    order = {t: "t", p: "p", places[0]: "x", places[1]: "y"}
    return "".join(order[k] for k in range(4))


def block_of_table(
    table: npt.NDArray[Any],
    path: Path,
    place: str,
    first: int,
    order: str,
    unit: TimeUnit,
) -> Block:
    """The events of a part of a table, see :func:`is_table`.

    Args:
        table: Rows `first` and those that follow.
        path: The file, for errors.
        place: The table's place in it, for errors.
        first: Number of the first row.
        order: What the columns of an (n, 4) table hold, such as "txyp".
        unit: Unit of the times; see :func:`to_microseconds`.
    """
    names = table.dtype.names
    if names is not None:
        columns = {column: table[find_column(names, column)] for column in "xytp"}
    else:
        columns = {column: table[:, order.index(column)] for column in "xytp"}
    return block_of_columns(columns, path, place, first, unit)


def block_of_columns(
    columns: Mapping[str, npt.NDArray[Any]], path: Path, place: str, first: int, unit: TimeUnit
) -> Block:
    """The events of parts of columns x, y, t, p; see :func:`block_of_table`."""
    t = to_microseconds(columns["t"], path, place, unit=unit, first=first)
    return Block(columns["x"], columns["y"], t, _numeric_polarity(columns["p"]), at(place))


def _numeric_polarity(p: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return p.astype(np.uint8) if p.dtype.kind == "b" else p
