"""MATLAB files up to version 7: numbers, structs and cells, every length checked.

The format: MathWorks, "MAT-File Format", level 5.  SciPy's reader, which confirms this one in the tests, was
seen to crash on damaged files.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

__all__ = ["read_mat5"]

_HEADER_BYTES: Final = 128
_LARGEST_ELEMENT: Final = (1 << 31) - 1  # what the format allows
_DEEPEST: Final = 12
_MATRIX, _COMPRESSED = 14, 15
_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCT = 1, 2
# Classes of numeric arrays; their values may be stored in a smaller type.
_CLASSES: Final = {
    6: "f8",
    7: "f4",
    8: "i1",
    9: "u1",
    10: "i2",
    11: "u2",
    12: "i4",
    13: "u4",
    14: "i8",
    15: "u8",
}
_COMPLEX: Final = 0x08


def read_mat5(path: Path) -> dict[str, Any]:
    """The variables of a file by name.

    Numeric arrays come with their axes of length 1 left out; structs of one element as dicts; cells and
    larger structs as lists; None stands for anything else.

    Raises:
        ValueError: where the file is cut short or damaged, with the byte.
    """
    data = path.read_bytes()
    if len(data) < _HEADER_BYTES:
        raise ValueError(f"header ends after {len(data)} of {_HEADER_BYTES} bytes")
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("byte 126: expected the mark of the byte order")
    variables: dict[str, Any] = {}
    for place, kind, content in _elements(memoryview(data), order, _HEADER_BYTES):
        try:
            if kind == _COMPRESSED:
                unpacker = zlib.decompressobj()
                unpacked = unpacker.decompress(content, _LARGEST_ELEMENT)
                if not unpacker.eof:
                    raise ValueError("compressed data end too early, or are too large")
                _, kind, content = next(_elements(memoryview(unpacked), order, 0), (0, 0, memoryview(b"")))
            if kind == _MATRIX:
                name, value = _matrix(content, order, _DEEPEST)
                variables[name] = value
        except (ValueError, zlib.error) as error:
            raise ValueError(f"byte {place}: {error}") from None
    return variables


def _elements(data: memoryview, order: str, position: int) -> Iterator[tuple[int, int, memoryview]]:
    """Place, type and content of successive elements."""
    byte_order: Any = "little" if order == "<" else "big"
    while position < len(data):
        if position + 8 > len(data):
            raise ValueError(f"byte {position}: element's tag is cut short")
        place = position
        kind = int.from_bytes(data[position : position + 4], byte_order)
        if kind >> 16:  # a small one: length, type and up to four bytes share the tag
            length, kind = kind >> 16, kind & 0xFFFF
            start, following = position + 4, position + 8
            if length > 4:
                raise ValueError(f"byte {position}: small element of {length} bytes, expected at most 4")
        else:
            length = int.from_bytes(data[position + 4 : position + 8], byte_order)
            start = position + 8
            following = start + length + (-length % 8 if kind != _COMPRESSED else 0)
        if start + length > len(data):
            raise ValueError(f"byte {position}: element of {length} bytes in the {len(data) - start} left")
        yield place, kind, data[start : start + length]
        position = following


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a matrix element."""
    if depth == 0:
        raise ValueError("structs and cells are nested too deep")
    parts = _elements(data, order, 0)
    flags = _numbers(_next(parts), order)
    dimensions = [int(side) for side in _numbers(_next(parts), order)]
    name = bytes(_next(parts)[1]).decode("utf-8", "replace")
    if len(flags) < 1 or len(dimensions) < 2 or any(side < 0 for side in dimensions):
        raise ValueError(f"matrix of dimensions {dimensions}")
    kind, count = int(flags[0]) & 0xFF, math.prod(dimensions)
    if kind == _CELL:
        return name, [_matrix(_next(parts)[1], order, depth - 1)[1] for _ in range(count)]
    if kind == _STRUCT:
        fields = _field_names(_next(parts), _next(parts), order)
        items = [
            {field: _matrix(_next(parts)[1], order, depth - 1)[1] for field in fields} for _ in range(count)
        ]
        return name, items[0] if count == 1 else items
    if kind not in _CLASSES or int(flags[0]) >> 8 & _COMPLEX:
        return name, None
    values = _numbers(_next(parts), order)
    if len(values) != count:
        raise ValueError(f"matrix {name!r} of dimensions {dimensions} has {len(values)} numbers")
    array = values.astype(_CLASSES[kind], copy=False).reshape(dimensions, order="F")
    return name, array.squeeze()


def _next(parts: Iterator[tuple[int, int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise ValueError("matrix ends too early")
    return part[1], part[2]


def _numbers(part: tuple[int, memoryview], order: str) -> npt.NDArray[Any]:
    kind, content = part
    if kind not in _TYPES:
        raise ValueError(f"numbers of type {kind}, expected one of {sorted(_TYPES)}")
    form = np.dtype(order + _TYPES[kind])
    if len(content) % form.itemsize:
        raise ValueError(f"{len(content)} bytes of numbers of {form.itemsize} bytes")
    return np.frombuffer(content, form).astype(form.newbyteorder("="), copy=False)


def _field_names(length: tuple[int, memoryview], names: tuple[int, memoryview], order: str) -> list[str]:
    numbers = _numbers(length, order)
    width = int(numbers[0]) if len(numbers) == 1 else 0
    text = bytes(names[1])
    if width <= 0 or len(text) % width:
        raise ValueError(f"field names of {width} bytes in {len(text)}")
    parts = (text[k : k + width] for k in range(0, len(text), width))
    return [part.split(b"\0")[0].decode("utf-8", "replace") for part in parts]
