"""FlatBuffers without a schema compiler: tables read field by field, every offset checked.

The layout (flatbuffers.dev, "Internals"): offsets are relative; a table begins with the distance back to the
list of its fields' offsets.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

__all__ = ["Table", "root_table"]


class Table:
    """A table at some place of a buffer.

    Raises:
        ValueError: by every method, where an offset leads out of the buffer.
    """

    def __init__(self, data: bytes, position: int) -> None:
        self._data, self._position = data, position
        self._fields = position - self._unpack("<i", position)
        self._fields_length = self._unpack("<H", self._fields)

    def scalar(self, field: int, form: str, default: Any) -> Any:
        """A number, in the format of :mod:`struct`; the default where the field is absent."""
        place = self._place(field)
        return default if place is None else self._unpack(form, place)

    def string(self, field: int) -> str:
        """A text; empty where the field is absent."""
        return self.structs(field, 1).decode("utf-8", "replace")

    def structs(self, field: int, item_bytes: int) -> bytes:
        """The bytes of a vector of structs of one size; none where the field is absent."""
        start, count = self._vector(field)
        length = count * item_bytes
        if start + length > len(self._data):
            raise ValueError(f"vector of {count} items of {item_bytes} bytes ends beyond its packet")
        return self._data[start : start + length]

    def tables(self, field: int) -> Iterator[Table]:
        """The tables of a vector; none where the field is absent."""
        start, count = self._vector(field)
        if start + 4 * count > len(self._data):
            raise ValueError(f"vector of {count} tables ends beyond its packet")
        for place in range(start, start + 4 * count, 4):
            yield Table(self._data, place + self._unpack("<I", place))

    def _vector(self, field: int) -> tuple[int, int]:
        place = self._place(field)
        if place is None:
            return 0, 0
        start = place + self._unpack("<I", place)
        return start + 4, self._unpack("<I", start)

    def _place(self, field: int) -> int | None:
        entry = 4 + 2 * field  # after the list's own length and the table's
        if entry + 2 > self._fields_length:
            return None
        offset = self._unpack("<H", self._fields + entry)
        return self._position + offset if offset else None

    def _unpack(self, form: str, place: int) -> Any:
        if not 0 <= place <= len(self._data) - struct.calcsize(form):
            raise ValueError(f"offset {place} lies outside its {len(self._data)} bytes")
        return struct.unpack_from(form, self._data, place)[0]


def root_table(data: bytes) -> Table:
    """The table that a buffer (without its size prefix) begins with."""
    if len(data) < 4:
        raise ValueError(f"{len(data)} bytes, expected a FlatBuffer")
    return Table(data, int.from_bytes(data[:4], "little"))
