"""Curves of what `bench.experiments` measures: a figure a parameter, panels of quality, clusters and time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import LogLocator

from bench.experiment_tables import mean
from bench.plots import STYLE

PANELS: Final = (
    ("moving_iou_deployed", "moving IoU"),
    ("object_iou", "object IoU"),
    ("clusters_per_motion", "clusters per motion"),
    ("cpu_s_a_mega_event", "CPU s per million events"),
)
LOGARITHMIC: Final = ("num_events_per_image", "lambda_smooth", "lambda_label", "lambda_data")


def plot_parameters(
    rows: Sequence[dict[str, Any]], parameters: Sequence[str], folder: Path, *, caption: str
) -> dict[str, Path]:
    """Draw every parameter's curves, experiments_<parameter>.svg; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(STYLE):
        return {
            name: _plot(
                [row for row in rows if row["what"] == name],
                name,
                folder / f"experiments_{name}.svg",
                caption,
            )
            for name in parameters
        }


def _plot(rows: Sequence[dict[str, Any]], parameter: str, path: Path, caption: str) -> Path:
    figure, axes = plt.subplots(1, len(PANELS), figsize=(13, 3.6))
    scenes = list(dict.fromkeys(row["experiment"] for row in rows))
    values = sorted({row["value"] for row in rows})
    for panel, (name, title) in zip(axes, PANELS, strict=True):
        for scene in scenes:
            own = [row for row in rows if row["experiment"] == scene]
            panel.plot(values, _curve(own, values, name), "-o", label=scene, markersize=3, linewidth=1)
        panel.plot(values, _curve(rows, values, name), "k-", label="mean", linewidth=2)
        if name == "moving_iou_deployed":
            oracle = _curve(rows, values, "moving_iou_oracle")
            panel.plot(values, oracle, "k--", label="mean, best background (oracle)", linewidth=1.2)
        if name.startswith(("moving", "object")):
            panel.set_ylim(0, 1)
        else:
            panel.set_yscale("log")
            panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            panel.yaxis.set_major_formatter("{x:g}")
        if name == "clusters_per_motion":
            panel.axhline(1, color="0.6", linestyle=":")
        if parameter in LOGARITHMIC:
            if values[0] > 0:
                panel.set_xscale("log")
            else:  # linear up to the next value
                panel.set_xscale("symlog", linthresh=values[1], linscale=0.4)
        panel.set_xticks(values, [_short(value) for value in values])
        panel.minorticks_off()
        panel.set_xlabel(parameter)
        panel.set_title(title, fontsize=9)
        panel.grid(True, color="0.92")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower left", ncols=len(labels), fontsize=7, frameon=False)
    figure.text(0.99, 0.02, caption, ha="right", fontsize=6, color="0.4")
    figure.tight_layout(rect=(0, 0.07, 1, 1))
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
    return path


def _short(value: float) -> str:
    return f"{value / 1000:g}k" if value >= 1000 else f"{value:g}"


def _curve(rows: Sequence[dict[str, Any]], values: Sequence[float], name: str) -> list[float]:
    found = (mean([row for row in rows if row["value"] == value], name) for value in values)
    return [float("nan") if value is None else value for value in found]
