"""The windows that benchmarks segment: the nine of ../shared/data/reference, else the bundled recordings."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emseg import Camera, EventArray
from emseg.datasets import bundled

REFERENCE_DIR: Final = Path(__file__).resolve().parents[2] / "shared" / "data" / "reference"
BUNDLED_EVENTS: Final = 30_000  # of the first events of each bundled recording

# The lens of the 346x260 reference windows (DistSurf's calibration).
DISTSURF: Final = Camera(
    346, 260, fx=289.77, fy=288.81, cx=185.98, cy=132.58, distortion=(-0.3617, 0.1587, 0.0, 0.0)
)


@dataclass(frozen=True)
class Published:
    """What the published code made of a window: see data/README.md of the shared recordings.

    labels: int (n,), below 0 where an event got none.  pool: (models, 4) similarities about pixel (0, 0)
    with t_ref at the window's first event.  figures: its row of figures.json.
    """

    labels: NDArray[np.int64]
    pool: NDArray[np.float64]
    figures: dict[str, Any]


@dataclass(frozen=True)
class BenchWindow:
    """A window; where known, its truth per event (-1 noise) and the published code's results by variant."""

    name: str
    events: EventArray
    camera: Camera | None = None
    truth: NDArray[np.int64] | None = None
    published: dict[str, Published] = field(default_factory=dict)


def names() -> list[str]:
    """The windows to segment, small sensors and small windows first."""
    return recorded() or sorted(bundled())


def recorded() -> list[str]:
    """The reference windows, by size and events, if they are at hand."""
    return sorted(path.stem.removeprefix("syn_") for path in REFERENCE_DIR.glob("syn_*.npz"))


def load(name: str) -> BenchWindow:
    """A window by name: a recorded or a bundled one, or any that an .npz file of these arrays holds."""
    known = bundled().get(name, REFERENCE_DIR / f"syn_{name}.npz")
    path = Path(name) if name.endswith(".npz") else known
    with np.load(path) as archive:
        arrays: dict[str, Any] = dict(archive)
    width, height = int(arrays["width"]), int(arrays["height"])
    t = arrays["t"]
    if t.dtype.kind == "f":  # seconds
        t = np.rint(t * 1e6).astype(np.int64)
    kept = slice(BUNDLED_EVENTS if name in bundled() else None)
    events = EventArray(
        arrays["x"][kept], arrays["y"][kept], t[kept], arrays["p"][kept], width=width, height=height
    )
    truth = arrays["label"][kept].astype(np.int64) if "label" in arrays else None
    if name in bundled():
        return BenchWindow(name, events, truth=truth)
    published = {
        key.removeprefix("labels_"): Published(
            arrays[key].astype(np.int64),
            arrays[key.replace("labels_", "pool_")],
            _figures(path.parent).get((path.stem, key.removeprefix("labels_")), {}),
        )
        for key in arrays
        if key.startswith("labels_")
    }
    return BenchWindow(name, events, DISTSURF if width == DISTSURF.width else None, truth, published)


@cache
def _figures(folder: Path) -> dict[tuple[str, str], dict[str, Any]]:
    path = folder / "figures.json"
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return {(row["window"], row["variant"]): row for row in rows}
