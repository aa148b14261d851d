"""Plots of what `bench.growth` measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

# Text stays text, and one measurement gives one file.
STYLE: Final[Any] = {"svg.fonttype": "none", "svg.hashsalt": "emseg", "font.size": 9}


def plot_growth(parts: Mapping[str, Sequence[dict[str, Any]]], folder: Path) -> list[Path]:
    """Logarithmic plots of CPU seconds by events and labels, of memory by events; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    with mpl.rc_context(STYLE):
        if parts.get("events"):
            rows = parts["events"]
            written.append(_plot_times(rows, "events", "events in the window", folder / "growth_events.svg"))
            written.append(_plot_memory(rows, folder / "growth_memory.svg"))
        if parts.get("pools"):
            rows = parts["pools"]
            written.append(
                _plot_times(rows, "pool_labels", "labels in the pool", folder / "growth_labels.svg")
            )
    return written


def _plot_times(rows: Sequence[dict[str, Any]], key: str, title: str, path: Path) -> Path:
    figure, axes = plt.subplots(figsize=(5.2, 3.6))
    sizes = [row[key] for row in rows]
    axes.loglog(sizes, [row["cpu_s"] for row in rows], "k-o", label="all", markersize=4)
    for stage in rows[0]["stages_cpu_s"]:
        axes.loglog(sizes, [row["stages_cpu_s"][stage] for row in rows], "-o", label=stage, markersize=3)
    if "expansion_cpu_s" in rows[0]:
        axes.loglog(sizes, [row["expansion_cpu_s"] for row in rows], "--s", label="expansion alone", ms=3)
    linear = [rows[-1]["cpu_s"] * size / sizes[-1] for size in sizes]
    axes.loglog(sizes, linear, color="0.7", linestyle=":", label="linear")
    axes.set_xlabel(title)
    axes.set_ylabel("CPU s, one thread")
    return _save(figure, axes, path)


def _plot_memory(rows: Sequence[dict[str, Any]], path: Path) -> Path:
    figure, axes = plt.subplots(figsize=(5.2, 3.6))
    sizes = [row["events"] for row in rows]
    memory = [row["peak_mb_over_events"] for row in rows]
    axes.loglog(sizes, memory, "k-o", label="peak over the events", markersize=4)
    axes.loglog(
        sizes, [memory[-1] * n / sizes[-1] for n in sizes], color="0.7", linestyle=":", label="linear"
    )
    axes.set_xlabel("events in the window")
    axes.set_ylabel("MB")
    return _save(figure, axes, path)


def _save(figure: Any, axes: Any, path: Path) -> Path:
    axes.grid(True, which="both", color="0.92")
    axes.legend(fontsize=7, ncols=2)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path
