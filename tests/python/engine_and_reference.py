"""What the tests of the engine share: the same window for the engine and for the reference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reference_windows import recorded

import emseg
from emseg import reference

REAL = Path(__file__).resolve().parents[3] / "shared" / "data" / "real"
# What the reference computes and the published code did: it knows neither signs, nor scatter, nor objects,
# nor doubts about motions.
AS_PUBLISHED: dict[str, Any] = {
    "polarity": "ignored",
    "footprint": "point",
    "flicker": "kept",
    "background": "widest",
    "lambda_speed": 0.0,
    "lambda_edge": 0.0,
    "sigma": 1.0,
}
KINDS = list(reference.DEGREES_OF_FREEDOM)

DISTSURF = emseg.Camera(
    346, 260, fx=289.77, fy=288.81, cx=185.98, cy=132.58, distortion=(-0.3617, 0.1587, 0.0, 0.0)
)


def real(name: str) -> Path:
    """A real recording; skips the test where it is not at hand."""
    path = REAL / name
    if not path.exists():
        pytest.skip(f"{path} is not there: recordings lie beside the repository, in ../shared")
    return path


def event_array(x: Any, y: Any, t: Any, *, width: int, height: int, p: Any = None) -> emseg.EventArray:
    """Events of which polarity does not matter, unless it is given."""
    return emseg.EventArray(x, y, t, np.arange(len(x)) % 2 if p is None else p, width=width, height=height)


def scattered_events(
    seed: int, count: int, *, width: int = 240, height: int = 180, duration: int = 50_000
) -> emseg.EventArray:
    """Events anywhere on the sensor at any time, µs, from a second on."""
    rng = np.random.default_rng(seed)
    t = 1_000_000 + np.sort(rng.integers(0, duration, count))
    x, y = rng.integers(0, width, count), rng.integers(0, height, count)
    return event_array(x, y, t, width=width, height=height, p=rng.integers(0, 2, count))


def lens(width: int, height: int) -> emseg.Camera:
    """A camera with the distortion of the published recordings, for a sensor of any size."""
    focal_length = 0.8 * width
    return emseg.Camera(
        width,
        height,
        fx=focal_length,
        fy=1.01 * focal_length,
        cx=0.51 * width,
        cy=0.49 * height,
        distortion=(-0.36, 0.15, 0.001, -0.0005),
    )


def reference_camera(camera: emseg.Camera) -> reference.Camera:
    return reference.Camera(camera.fx, camera.fy, camera.cx, camera.cy, distortion=camera.distortion)


def reference_window(
    events: emseg.EventArray, camera: emseg.Camera | None = None, *, t_ref: int | None = None
) -> reference.Window:
    """The events as the reference takes them."""
    return reference.make_window(
        events.x,
        events.y,
        events.t,
        width=events.width,
        height=events.height,
        camera=reference_camera(camera) if camera else None,
        t_ref=t_ref,
    )


def reference_model(model: emseg.MotionModel) -> reference.MotionModel:
    return reference.MotionModel(model.kind, tuple(model.params.tolist()))


def reference_graph(events: emseg.EventArray) -> reference.EventGraph:
    """The engine's graph, which test_event_graph.py holds against the reference's; that takes seconds."""
    indptr, indices = emseg.event_graph(events)
    tails = np.repeat(np.arange(len(events)), np.diff(indptr))
    return reference.graph_of_edges(np.column_stack([tails, indices]).astype(np.int64), len(events))


def random_model(kind: str, rng: np.random.Generator, *, speed: float = 1500.0) -> emseg.MotionModel:
    """Motions up to well beyond those of the published recordings."""
    velocity = rng.uniform(-speed, speed, 2)
    rates = rng.uniform(-3, 3, 6)
    if kind == "rotation":
        return emseg.MotionModel(kind, rng.uniform(-5, 5, 3))
    return emseg.MotionModel(kind, [*velocity, *rates][: reference.DEGREES_OF_FREEDOM[kind]])  # type: ignore[arg-type]


@dataclass(frozen=True)
class PublishedWindow:
    """One of the nine windows that the published code has segmented too."""

    events: emseg.EventArray
    camera: emseg.Camera | None
    truth: Any  # labels (n,)
    true_pool: list[
        emseg.MotionModel
    ]  # about the image centre, as the engine's models; t_ref: the first event
    arrays: dict[str, Any]


@cache
def published_window(name: str) -> PublishedWindow:
    """A window by name, such as 240x180_15k; skips the test where the recordings are not at hand."""
    arrays = recorded(name)
    width, height = int(arrays["width"]), int(arrays["height"])
    t = np.rint(arrays["t"] * 1e6).astype(np.int64)
    events = event_array(arrays["x"], arrays["y"], t, width=width, height=height, p=arrays["p"] > 0)
    return PublishedWindow(
        events,
        DISTSURF if width == 346 else None,
        arrays["label"],
        [about_centre(row, width, height) for row in arrays["models"]],
        arrays,
    )


def about_centre(published: Any, width: int, height: int) -> emseg.MotionModel:
    """A published similarity (vx, vy, s, θ), which turns about pixel (0, 0), as one about the image centre.

    v + B x = (v + B c) + B (x - c) with B = (1 + s) R(θ) - I.
    """
    vx, vy, s, theta = published
    rotation = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    velocity = (vx, vy) + ((1 + s) * rotation - np.eye(2)) @ [(width - 1) / 2, (height - 1) / 2]
    return emseg.MotionModel("similarity", [*velocity, s, theta])
