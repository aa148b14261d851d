"""The recordings that benchmarks run through: the scenes of ../shared/data/sim, else the package's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emseg import EventArray
from emseg.datasets import bundled

SIM_DIR: Final = Path(__file__).resolve().parents[2] / "shared" / "data" / "sim"


@dataclass(frozen=True)
class Recording:
    """A recording; where known, its truth per event: 0 background, 1.. objects, -1 noise."""

    name: str
    events: EventArray
    truth: NDArray[np.int64] | None = None


def simulated() -> list[str]:
    """The simulated scenes, if they are at hand."""
    return sorted(path.stem for path in SIM_DIR.glob("*.npz"))


def names() -> list[str]:
    """Every recording at hand."""
    return [*simulated(), *sorted(bundled())]


def load(name: str, seconds: float | None = None) -> Recording:
    """A recording by name, or its first seconds."""
    with np.load(bundled().get(name) or SIM_DIR / f"{name}.npz") as archive:
        keys = [*"xytp", "width", "height", *(["label"] if "label" in archive else [])]
        arrays: dict[str, Any] = {key: archive[key] for key in keys}
    t = arrays["t"]
    stop = len(t) if seconds is None else int(np.searchsorted(t, t[0] + round(1e6 * seconds)))
    columns = (arrays[column][:stop] for column in "xytp")
    events = EventArray(*columns, width=int(arrays["width"]), height=int(arrays["height"]))
    return Recording(name, events, arrays["label"][:stop].astype(np.int64) if "label" in arrays else None)
