"""Segmentation of a stream while it comes in: sources, thinning, the loop, and where results go."""

from __future__ import annotations

from emseg.live.segmenter import LiveFigures, LiveSegmenter, LiveWindow
from emseg.live.sources import FileSource, LiveSource, open_source
from emseg.live.thinning import Thinning, even_sample

__all__ = [
    "FileSource",
    "LiveFigures",
    "LiveSegmenter",
    "LiveSource",
    "LiveWindow",
    "Thinning",
    "even_sample",
    "open_source",
]
