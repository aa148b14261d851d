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
    recording = load_file(bundled().get(name) or SIM_DIR / f"{name}.npz", name=name)
    return recording if seconds is None else _part(recording, 0.0, seconds)


def load_file(path: Path, *, name: str = "", middle: float | None = None) -> Recording:
    """A recording of a file of arrays, as the simulated ones are, or the seconds in its middle."""
    with np.load(path) as archive:
        keys = [*"xytp", "width", "height", *(["label"] if "label" in archive else [])]
        missing = sorted(set(keys) - set(archive))
        if missing:
            raise ValueError(f"{path} has no {', '.join(missing)}, expected a recording with its size")
        arrays: dict[str, Any] = {key: archive[key] for key in keys}
    events = EventArray(
        *(arrays[column] for column in "xytp"), width=int(arrays["width"]), height=int(arrays["height"])
    )
    truth = arrays["label"].astype(np.int64) if "label" in arrays else None
    recording = Recording(name or path.stem, events, truth)
    if middle is None:
        return recording
    return _part(recording, max(0.0, 0.5e-6 * events.duration - 0.5 * middle), middle)


def _part(recording: Recording, begin: float, seconds: float) -> Recording:
    events, truth = recording.events, recording.truth
    span = events.t[0] + np.rint(1e6 * np.array([begin, begin + seconds])).astype(np.int64)
    start, stop = np.searchsorted(events.t, span).tolist()
    return Recording(recording.name, events[start:stop], None if truth is None else truth[start:stop])
