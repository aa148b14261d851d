"""A small made scene: textured planes before a moving camera, reported as an event camera would.

Three surfaces move rigidly in the image: a background (its motion is the camera's), a disc and a box that
move on their own.  Every millisecond they are painted back to front; a pixel reports an event whenever its
log intensity has moved by its contrast threshold, at the time found by linear interpolation; a few events
are noise.  This is the sensor of Rebecq, Gehrig, Scaramuzza, "ESIM: an Open Event Camera Simulator", CoRL
2018, at its plainest.

`python -m emseg.datasets.made_scene FILE` writes the bundled file anew.  The same numbers come out on any
machine: the random bits are those of PCG64, whose raw stream NumPy keeps fixed, and log intensities are
rounded to a grid far coarser than what mathematical libraries differ by, before any decision is taken.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float64]
Integers = NDArray[np.int64]

WIDTH, HEIGHT = 240, 180  # px
DURATION_US = 400_000
STEP_US = 1_000  # the fastest surface moves 0.2 px in it
SEED = 20
TEXTURE_SIZE = 256  # px; textures repeat
LOG_GRID = 4096  # steps of log intensity per unit
THRESHOLD = 0.42  # of log intensity
THRESHOLD_SPREAD = 0.1  # pixels differ by up to this fraction
NOISE_RATE = 0.1  # events per pixel and second


@dataclass(frozen=True)
class Surface:
    """A textured plane moving rigidly in the image, covering `extent(x, y) < 0` of its own coordinates."""

    pivot: tuple[float, float]  # its image position at t = 0, px
    velocity: tuple[float, float]  # of the pivot, px/s
    turn: float  # rad/s about the pivot, from x to y
    grain: float  # radius of the smallest discs of its texture, px; the largest are four times that
    extent: Callable[[Image, Image], Image] | None = (
        None  # signed distance to the outline, px; None: everywhere
    )

    def to_surface(self, x: Image, y: Image, seconds: float) -> tuple[Image, Image]:
        """Surface coordinates (px from the pivot, before any turning) of image positions at a time."""
        dx = x - (self.pivot[0] + self.velocity[0] * seconds)
        dy = y - (self.pivot[1] + self.velocity[1] * seconds)
        c, s = math.cos(self.turn * seconds), math.sin(self.turn * seconds)
        return c * dx + s * dy, c * dy - s * dx

    def coverage(self, u: Image, v: Image) -> Image:
        """How much of each pixel the surface covers, 0 .. 1, with an edge one pixel wide."""
        if self.extent is None:
            return np.ones_like(u)
        return np.clip(0.5 - self.extent(u, v), 0.0, 1.0)


def _disc(u: Image, v: Image) -> Image:
    return np.sqrt(u * u + v * v) - 23.0


def _box(u: Image, v: Image) -> Image:
    return np.maximum(np.abs(u) - 24.0, np.abs(v) - 17.0)


# Back to front; the index is the label.
SURFACES = (
    Surface(pivot=((WIDTH - 1) / 2, (HEIGHT - 1) / 2), velocity=(-115.0, 40.0), turn=0.3, grain=6.5),
    Surface(pivot=(48.0, 50.0), velocity=(190.0, 30.0), turn=0.8, grain=3.0, extent=_disc),
    Surface(pivot=(192.0, 138.0), velocity=(-120.0, -95.0), turn=-0.6, grain=3.0, extent=_box),
)


class _Random:
    """Uniform numbers from the raw bits of PCG64, whose stream NumPy promises never to change."""

    def __init__(self, seed: int) -> None:
        self._bits = np.random.PCG64(seed)

    def uniform(self, *shape: int) -> Image:
        raw = np.asarray(self._bits.random_raw(math.prod(shape)), np.uint64)
        return (raw >> np.uint64(11)).astype(np.float64).reshape(shape) * 2.0**-53

    def integers(self, stop: int, count: int) -> Integers:
        return (self.uniform(count) * stop).astype(np.int64)


def make(seed: int = SEED) -> dict[str, NDArray[Any]]:
    """The scene's events in time order, with the truth of each.

    Returns x, y (uint16, px), t (int64, µs), p (uint8, 0/1), label (int8: 0 background, 1 disc, 2 box, -1
    noise), width and height.  An event belongs to the front-most surface that touches its pixel at the
    beginning or at the end of its millisecond: what an outline covers or uncovers is the work of the one in
    front.
    """
    random = _Random(seed)
    textures = [dead_leaves(random, surface.grain) for surface in SURFACES]
    sensor = _Sensor(random, *render(0.0, textures))
    parts = [_noise(random)]
    for begin_us in range(0, DURATION_US, STEP_US):
        parts.append(sensor.expose(*render((begin_us + STEP_US) / 1e6, textures), begin_us))
    y, x, t, p, label = np.concatenate(parts, axis=1)
    order = np.lexsort((x, y, t))
    return {
        "x": x[order].astype(np.uint16),
        "y": y[order].astype(np.uint16),
        "t": t[order],
        "p": p[order].astype(np.uint8),
        "label": label[order].astype(np.int8),
        "width": np.array(WIDTH),
        "height": np.array(HEIGHT),
    }


def dead_leaves(random: _Random, grain: float) -> Image:
    """A periodic texture of overlapping discs of random size and brightness, 0.25 .. 1.

    Source: Lee, Mumford, Huang, "Occlusion models for natural images", IJCV 2001.
    """
    size = TEXTURE_SIZE
    texture = np.full((size, size), 0.5)
    leaves = math.ceil(0.3 * (size / grain) ** 2)  # enough to cover it twice
    for x, y, radius, brightness in random.uniform(leaves, 4) * (size, size, 1.0, 1.0):
        reach = grain * (1 + 3 * radius**2)
        rows = np.arange(math.floor(y - reach), math.ceil(y + reach) + 1)
        columns = np.arange(math.floor(x - reach), math.ceil(x + reach) + 1)
        inside = (rows[:, None] - y) ** 2 + (columns - x) ** 2 < reach**2
        patch = np.ix_(rows % size, columns % size)
        texture[patch] = np.where(inside, 0.25 * 4.0**brightness, texture[patch])
    for axis in (0, 1):  # soften the outlines over three pixels
        texture = (np.roll(texture, 1, axis) + 2 * texture + np.roll(texture, -1, axis)) / 4
    return texture


def render(seconds: float, textures: list[Image]) -> tuple[Image, Integers]:
    """Intensity, and the index of the front-most surface touching each pixel; both (HEIGHT, WIDTH)."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    intensity = np.zeros((HEIGHT, WIDTH))
    owner = np.zeros((HEIGHT, WIDTH), np.int64)
    for index, (surface, texture) in enumerate(zip(SURFACES, textures, strict=True)):
        u, v = surface.to_surface(x, y, seconds)
        coverage = surface.coverage(u, v)
        seen = coverage > 0
        part = coverage[seen]
        intensity[seen] = (1 - part) * intensity[seen] + part * _sample(texture, u[seen], v[seen])
        owner[seen] = index
    return intensity, owner


def _sample(texture: Image, u: Image, v: Image) -> Image:
    """Bilinear lookup in a periodic texture."""
    column, row = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    a, b = u - column, v - row
    mask = TEXTURE_SIZE - 1
    left, right, top, bottom = column & mask, (column + 1) & mask, row & mask, (row + 1) & mask
    above = (1 - a) * texture[top, left] + a * texture[top, right]
    below = (1 - a) * texture[bottom, left] + a * texture[bottom, right]
    mixed: Image = (1 - b) * above + b * below
    return mixed


class _Sensor:
    """Pixels that report every step of their log intensity, in integers of 1 / LOG_GRID."""

    def __init__(self, random: _Random, intensity: Image, owner: Integers) -> None:
        spread = 1 + THRESHOLD_SPREAD * (2 * random.uniform(HEIGHT, WIDTH) - 1)
        self._threshold = np.rint(THRESHOLD * LOG_GRID * spread).astype(np.int64)
        self._log = _quantised_log(intensity)
        self._owner = owner
        # Each pixel starts somewhere between two reports; from the same place all would fire together.
        phase = (random.uniform(HEIGHT, WIDTH) - 0.5) * self._threshold
        self._reported = self._log + np.rint(phase).astype(np.int64)

    def expose(self, intensity: Image, owner: Integers, begin_us: int) -> Integers:
        """Rows y, x, t, p, label of what is reported while the image changes to this one in STEP_US."""
        log = _quantised_log(intensity)
        change = log - self._reported
        count = np.abs(change) // self._threshold
        y, x = np.nonzero(count)
        repeats = count[y, x]
        first = np.cumsum(repeats) - repeats
        y, x = np.repeat(y, repeats), np.repeat(x, repeats)
        ordinal = np.arange(len(y)) - np.repeat(first, repeats) + 1
        sign = np.sign(change[y, x])
        level = self._reported[y, x] + sign * ordinal * self._threshold[y, x]
        travelled, whole = np.abs(level - self._log[y, x]), np.abs(log - self._log)[y, x]
        t = begin_us + STEP_US * travelled // whole
        label = np.maximum(self._owner, owner)[y, x]
        self._reported += np.sign(change) * count * self._threshold
        self._log, self._owner = log, owner
        polarity = (sign > 0).astype(np.int64)
        return np.stack([y, x, t, polarity, label])


def _quantised_log(intensity: Image) -> Integers:
    steps: Integers = np.rint(np.log(intensity) * LOG_GRID).astype(np.int64)
    return steps


def _noise(random: _Random) -> Integers:
    count = round(NOISE_RATE * WIDTH * HEIGHT * DURATION_US / 1e6)
    y, x, t, p = (random.integers(stop, count) for stop in (HEIGHT, WIDTH, DURATION_US, 2))
    return np.stack([y, x, t, p, np.full(count, -1)])


if __name__ == "__main__":
    np.savez_compressed(Path(sys.argv[1]), allow_pickle=False, **make())
