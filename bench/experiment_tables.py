"""Tables of what `bench.experiments` measures, in Markdown."""

from __future__ import annotations

import contextlib
import io
import statistics
from collections.abc import Iterable, Sequence
from typing import Any, Final

from bench.common import number, print_table

Rows = Sequence[dict[str, Any]]

CLAIMS: Final = {
    "num_events_per_image": "more events a window capture more motion, but risk over-segmentation.",
    "lambda_smooth": "it trades over- against under-segmentation.",
    "lambda_label": "a small one gives too many clusters.",
    "lambda_data": "it weighs the fit.",
    "bracket": "larger ones find finer motion, but may add errors.",
}
"""What the thesis' Table 6.3 says of each parameter."""

SETTINGS: Final = ("thesis", "published", "auto")
MEAN: Final = "mean of scenes"


def settings_table(rows: Rows, experiments: Sequence[str]) -> str:
    """A line a scene and setting, and the means over the scenes."""
    heading = (
        "scene",
        "settings",
        "moving IoU",
        "oracle",
        "object IoU",
        "detected",
        "clusters/motion",
        "switches, most",
        "windows",
        "ms/window",
        "CPU s/Mev",
        "peak MB",
    )
    lines = []
    present = [name for name in experiments if any(row["experiment"] == name for row in rows)]
    for name in [*present, MEAN]:
        for what in SETTINGS:
            own = [row for row in rows if row["what"] == what and name in (row["experiment"], MEAN)]
            if not own:
                continue
            lines.append(
                (
                    name,
                    what,
                    _cell(own, "moving_iou_deployed", ".3f"),
                    _cell(own, "moving_iou_oracle", ".3f"),
                    _cell(own, "object_iou", ".3f"),
                    _cell(own, "detection_rate", ".3f"),
                    _cell(own, "clusters_per_motion", ".2f"),
                    str(max(row["switches"] for row in own)),
                    str(sum(row["windows"] for row in own)),
                    _cell(own, "ms_a_window", ".0f"),
                    _cell(own, "cpu_s_a_mega_event", ".2f"),
                    _cell(own, "peak_mb", ".0f"),
                )
            )
    return _table(heading, lines, left=(0, 1))


def parameter_table(rows: Rows, parameter: str) -> str:
    """A line a value: means over the scenes."""
    heading = (parameter, "moving IoU", "oracle", "object IoU", "clusters/motion", "labels", "CPU s/Mev")
    return _table(heading, [_means(own, f"{value:g}") for value, own in _by_value(rows, parameter)])


def sweep_table(rows: Rows, smoothness: Sequence[int]) -> str:
    """The thesis' sweep on hands; empty if it was not run."""
    heading = (
        "smoothness, label cost",
        "moving IoU",
        "oracle",
        "object IoU",
        "clusters/motion",
        "labels",
        "CPU s/Mev",
    )
    lines = [
        _means(own, f"{smooth}, {value:g}")
        for smooth in smoothness
        for value, own in _by_value(rows, f"hands, smoothness {smooth}")
    ]
    return _table(heading, lines) if lines else ""


def mean(rows: Rows, name: str) -> float | None:
    """Mean of a figure over the rows where it is defined."""
    known = [row[name] for row in rows if row[name] is not None]
    return statistics.fmean(known) if known else None


def _means(own: Rows, label: str) -> tuple[str, ...]:
    return (
        label,
        _cell(own, "moving_iou_deployed", ".3f"),
        _cell(own, "moving_iou_oracle", ".3f"),
        _cell(own, "object_iou", ".3f"),
        _cell(own, "clusters_per_motion", ".2f"),
        _cell(own, "labels", ".1f"),
        _cell(own, "cpu_s_a_mega_event", ".2f"),
    )


def _cell(own: Rows, name: str, form: str) -> str:
    return number(mean(own, name), form)


def _by_value(rows: Rows, what: str) -> list[tuple[float, list[dict[str, Any]]]]:
    values = sorted({row["value"] for row in rows if row["what"] == what})
    return [
        (value, [row for row in rows if row["what"] == what and row["value"] == value]) for value in values
    ]


def _table(heading: Sequence[str], lines: Iterable[Sequence[str]], *, left: Iterable[int] = (0,)) -> str:
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        print_table(heading, lines, left=left)
    return text.getvalue().rstrip()
