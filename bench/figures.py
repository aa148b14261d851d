"""The figures in a benchmark's JSON, whichever wrote it: its times, and the quality beside them."""

from __future__ import annotations

import re
from typing import Any, Final

# A part of a figure's place that says "a time of ours", such as cold_cpu_s, stages_wall_s or latency_p50_s.
_TIME: Final = re.compile(r"(^|_)(cpu|wall|ours|latency)(_\w+)?_m?s(_\w+)?$")
_QUALITY: Final = re.compile(r"accuracy|_iou_?(deployed|oracle)?$|energy|labels$|peak_mb|thinned|windows$")
# Equal in every run of one commit.
_REPEATABLE: Final = re.compile(r"accuracy|_iou|energy|labels$|windows$")
# Not of the commit that ran the benchmark.
_PEERS: Final = re.compile(r"/published/|true_labels$")

_CIRCUMSTANCES: Final = {"machine", "commit", "versions", "date", "settings"}
_NAMES: Final = ("window", "recording", "what", "pool", "size")  # keys that say what a row is about


def figures_of(written: dict[str, Any]) -> dict[str, float]:
    """Every number of a benchmark's JSON by its place, such as "240x180_15k/cold_cpu_s"."""
    figures: dict[str, float] = {}
    for key, rows in written.items():
        if key not in _CIRCUMSTANCES:
            _collect(rows, "", figures)  # the names of the outermost lists say nothing
    return figures


def _collect(item: Any, place: str, figures: dict[str, float]) -> None:
    if isinstance(item, list):
        parts = [(_identity(row, index), row) for index, row in enumerate(item)]
    elif isinstance(item, dict):
        parts = list(item.items())
    else:
        if place and isinstance(item, int | float) and not isinstance(item, bool):
            figures.setdefault(place, float(item))  # rows of one name share what is ours, not the peer
        return
    for name, part in parts:
        _collect(part, f"{place}/{name}" if place else name, figures)


def _identity(row: Any, index: int) -> str:
    if not isinstance(row, dict):
        return str(index)
    names = [str(row[key]) for key in _NAMES if key in row]
    if "threads" in row:
        names.append(f"threads {row['threads']}")
    # Kernels print figures of the run behind a colon or in brackets.
    return re.split(r": | \(", ", ".join(names))[0] or str(index)


def is_time(place: str) -> bool:
    """Whether a figure is a time that the commit answers for, less being better."""
    return not _PEERS.search(place) and any(_TIME.search(part) for part in place.split("/")[-2:])


def is_quality(place: str) -> bool:
    """Whether a figure says how good the answer is, or how much memory it took."""
    own = not _PEERS.search(place) and not is_time(place)  # a stage is called labels
    return own and bool(_QUALITY.search(place.split("/")[-1]))


def is_repeatable(place: str) -> bool:
    """Whether a figure must be the same in every run of one commit."""
    return is_quality(place) and bool(_REPEATABLE.search(place.split("/")[-1]))
