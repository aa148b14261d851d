"""Windows of any number of events: outlines on four surfaces that move before each other, sampled at will.

What moves is the same for every number of events of a sensor; only how often each outline is reported grows,
as with a lower contrast threshold.  So a time that grows faster than the events does so by itself.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.windows import BenchWindow
from emseg import EventArray

WINDOW_US: Final = 50_000
JITTER_PX: Final = 0.3
NOISE: Final = 0.02  # share of the events
CIRCLES_PER_PX: Final = 1 / 1500  # of every surface
# Of the background and of three discs before it, px/s.
VELOCITIES: Final = ((-115.0, 40.0), (190.0, 30.0), (-120.0, -195.0), (60.0, 230.0))
# Middle and radius of the discs at mid-window, in parts of the sensor's width, height and height.
DISCS: Final = ((0.25, 0.3, 0.18), (0.75, 0.35, 0.2), (0.5, 0.75, 0.17))

Floats = NDArray[np.float64]


def moving_outlines(events: int, width: int, height: int, *, seed: int = 0) -> BenchWindow:
    """A window of so many events over 50 ms, with the truth of each."""
    rng = np.random.default_rng(seed)
    noise = round(NOISE * events)
    sides = np.array([[width], [height], [1.0]])
    places = rng.uniform(0, 1, (3, noise)) * sides - [[0], [0], [0.5]]
    parts = [np.vstack([places, np.full(noise, -1.0)])]
    # Each pixel shows one of the surfaces, so that of as many samples of each about one surface's worth is
    # seen; some fall beside the sensor.
    samples = 2 * events
    for label in range(len(VELOCITIES)):
        x, y, t = _sampled_outlines(rng, label, samples, width, height)
        seen = (x > -0.5) & (y > -0.5) & (x < width - 0.5) & (y < height - 0.5)
        seen &= _surface_at(x, y, t, width, height) == label
        parts.append(np.stack([x[seen], y[seen], t[seen], np.full(int(seen.sum()), float(label))]))
    found = np.concatenate(parts, axis=1)
    kept = rng.permutation(np.arange(noise, found.shape[1]))[: events - noise]
    assert len(kept) == events - noise
    found = found[:, np.concatenate([np.arange(noise), kept])]
    times = np.rint((found[2] + 0.5) * WINDOW_US).astype(np.int64)
    order = np.argsort(times, kind="stable")
    x, y = (np.clip(np.rint(found[k]), 0, side - 1) for k, side in ((0, width), (1, height)))
    columns = (x.astype(np.uint16), y.astype(np.uint16), times, rng.integers(0, 2, events, dtype=np.uint8))
    array = EventArray(*(column[order] for column in columns), width=width, height=height)
    return BenchWindow(
        f"outlines {width}x{height}, {events} events", array, truth=found[3][order].astype(np.int64)
    )


def _sampled_outlines(
    rng: np.random.Generator, label: int, samples: int, width: int, height: int
) -> tuple[Floats, Floats, Floats]:
    """Events of circles on a surface, hidden or not: x, y (px) and time from mid-window (in windows)."""
    texture = np.random.default_rng(label)  # the same for every number of events
    circles = max(20, round(CIRCLES_PER_PX * width * height))
    middle = texture.uniform(-20, [[width + 20], [height + 20]], (2, circles))
    radius = texture.uniform(4, 20, circles)
    which = rng.choice(circles, samples, p=radius / radius.sum())
    angle, t = rng.uniform(0, 2 * np.pi, samples), rng.uniform(-0.5, 0.5, samples)
    moved = np.multiply.outer(VELOCITIES[label], t * WINDOW_US * 1e-6)
    outline = middle[:, which] + radius[which] * np.stack([np.cos(angle), np.sin(angle)])
    x, y = outline + moved + rng.normal(0, JITTER_PX, (2, samples))
    return x, y, t


def _surface_at(x: Floats, y: Floats, t: Floats, width: int, height: int) -> NDArray[np.int64]:
    """Which surface a place shows at a time."""
    surface = np.zeros(len(x), np.int64)
    for label, (column, row, radius) in enumerate(DISCS, start=1):
        vx, vy = VELOCITIES[label]
        dx = x - (column * width + vx * t * WINDOW_US * 1e-6)
        dy = y - (row * height + vy * t * WINDOW_US * 1e-6)
        surface[dx * dx + dy * dy < (radius * height) ** 2] = label
    return surface
