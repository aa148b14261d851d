"""Reading recordings: one verb, and a registry of formats that are told apart by their content."""

from __future__ import annotations

from emseg.io.errors import ReadError
from emseg.io.registry import Reader, find_reader, read, readers

__all__ = ["ReadError", "Reader", "find_reader", "read", "readers"]
