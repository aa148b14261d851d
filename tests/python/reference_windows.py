"""Windows for the tests of the reference: the nine recorded ones of ../shared, and small made ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from emseg.reference import Camera, MotionModel, Window, make_window

# For properties whose first example compiles something, and for busy machines.
patient = settings(deadline=None)

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "reference"
WINDOWS = [
    f"{size}_{events}" for size in ("240x180", "346x260", "640x480") for events in ("15k", "30k", "60k")
]
DISTSURF = Camera(289.77, 288.81, 185.98, 132.58, distortion=(-0.3617, 0.1587))  # lens of the 346x260 windows


def recorded(name: str) -> dict[str, Any]:
    """Arrays of one window, by name; skips the test where the recordings are not at hand."""
    path = DATA / f"syn_{name}.npz"
    if not path.exists():
        pytest.skip(f"{path} is not there: recordings lie beside the repository, in ../shared")
    with np.load(path) as arrays:
        return dict(arrays)


def recorded_window(arrays: dict[str, Any]) -> Window:
    """The window as the published code sees it: t_ref at its start, models about pixel (0, 0)."""
    width, height = int(arrays["width"]), int(arrays["height"])
    t = np.rint(arrays["t"] * 1e6)
    camera = DISTSURF if width == 346 else None
    return make_window(
        arrays["x"], arrays["y"], t, width=width, height=height, camera=camera, t_ref=t[0], centre=(0.0, 0.0)
    )


def true_pool(arrays: dict[str, Any]) -> list[MotionModel]:
    return [MotionModel("similarity", tuple(params)) for params in arrays["models"].tolist()]


def two_patches(seed: int = 0, *, points: int = 60, events_per_point: int = 15) -> tuple[Window, Any]:
    """Two patches of random points side by side, moving apart: the window, t_ref in its middle, true labels.

    They move with `PATCH_VELOCITIES` for 40 ms on a 64 x 48 sensor.
    """
    rng = np.random.default_rng(seed)
    label = np.repeat([0, 1], points * events_per_point)
    start = np.concatenate(
        [rng.uniform((8, 8), (26, 40), (points, 2)), rng.uniform((36, 8), (54, 40), (points, 2))]
    )
    t = np.sort(rng.integers(0, 40_000, len(label)))
    shuffle = rng.permutation(len(label))
    label, start = label[shuffle], np.repeat(start, events_per_point, axis=0)[shuffle]
    place = start + PATCH_VELOCITIES[label] * ((t - 20_000) * 1e-6)[:, None]
    pixel = np.rint(place).astype(int)
    return make_window(pixel[:, 0], pixel[:, 1], t, width=64, height=48, t_ref=20_000), label


PATCH_VELOCITIES = np.array([[-150.0, 100.0], [150.0, -75.0]])  # px/s
