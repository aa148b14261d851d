"""Curves of trainings, from the metrics.csv that `emseg nets train` leaves.

python -m bench.nets_curves RUN... --out bench/results/nets/curves.svg
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from bench.plots import STYLE

PANELS = {
    "total loss": (("train/total", "training"), ("validation/total", "validation")),
    "moving-mask IoU at events": (
        ("validation/mask/iou", "validation"),
        ("validation/mask/iou_all_moving", "all moving"),
    ),
}


def read_curve(path: Path, column: str) -> tuple[list[int], list[float]]:
    """Epochs from 1 on, and the values of a column; the last of an epoch counts."""
    values: dict[int, float] = {}
    with path.open(encoding="utf-8") as file:
        for line in csv.DictReader(file):
            if line.get(column) and line.get("epoch"):
                values.setdefault(int(float(line["epoch"])) + 1, float(line[column]))
    return list(values), list(values.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    with mpl.rc_context(STYLE):
        figure, rows = plt.subplots(
            len(arguments.runs), len(PANELS), figsize=(8, 2.8 * len(arguments.runs)), squeeze=False
        )
        for run, row in zip(arguments.runs, rows, strict=True):
            for (title, columns), axes in zip(PANELS.items(), row, strict=True):
                for column, label in columns:
                    axes.plot(*read_curve(run / "metrics.csv", column), "-o", markersize=3, label=label)
                axes.set_title(f"{run.name}: {title}")
                axes.set_xlabel("epoch")
                axes.legend()
        figure.tight_layout()
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(arguments.out, metadata={"Date": None})


if __name__ == "__main__":
    main()
