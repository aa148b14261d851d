"""Reading recordings: one verb, and a registry of formats that are told apart by their content."""

from __future__ import annotations

from emseg.io.errors import ReadError
from emseg.io.recording import Frame, ImuSamples, ReadOptions, Recording, Source
from emseg.io.registry import Reader, find_reader, open_recording, read, readers

__all__ = [
    "Frame",
    "ImuSamples",
    "ReadError",
    "ReadOptions",
    "Reader",
    "Recording",
    "Source",
    "find_reader",
    "open_recording",
    "read",
    "readers",
]
