"""Draw every scene of the suite, frame beside events, into docs/suite.png.

python scripts/suite_picture.py [SEED [TARGET]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import emseg
from emseg.render import label_picture
from emseg.simulation.suite import NAMES, suite_scene
from emseg.writers import write_png

ROOT = Path(__file__).resolve().parents[1]
WIDTH, HEIGHT = 160, 120  # px, of a cell
COLUMNS = 3
SLICE_US = 12_000


def shrunk(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture at the size of a cell, by the mean of what falls into each of its pixels."""
    height, width = picture.shape[:2]
    scale = max(width / WIDTH, height / HEIGHT)
    cell = np.full((HEIGHT, WIDTH, 3), 255.0)
    rows, columns = int(height / scale), int(width / scale)
    sums = np.add.reduceat(picture.astype(float), (np.arange(rows) * scale).astype(int), axis=0)
    sums = np.add.reduceat(sums, (np.arange(columns) * scale).astype(int), axis=1)
    counts = np.add.reduceat(np.ones((height, width)), (np.arange(rows) * scale).astype(int), axis=0)
    counts = np.add.reduceat(counts, (np.arange(columns) * scale).astype(int), axis=1)
    cell[:rows, :columns] = sums / counts[..., None]
    return cell.astype(np.uint8)


def pair(name: str, seed: int) -> NDArray[np.uint8]:
    """Frame and events of a scene, 0.15 s after its beginning."""
    simulation = emseg.simulate(suite_scene(name, seed, duration=0.2))
    moment = int(np.searchsorted(simulation.truth.t, 150_000))
    grey = (255 * np.clip(simulation.truth.frame[moment], 0, 1) ** 0.5).astype(np.uint8)
    start, stop = np.searchsorted(simulation.events.t, [150_000 - SLICE_US, 150_000])
    size = f"{simulation.events.width}x{simulation.events.height}"
    labelled = label_picture(
        simulation.events[start:stop],
        simulation.owners[start:stop].astype(np.int32),
        caption=f"{name} {size}".replace("_", " "),
    )
    return np.concatenate([shrunk(np.repeat(grey[..., None], 3, axis=2)), shrunk(labelled)], axis=1)


def main() -> None:
    """Draw and write."""
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs" / "suite.png"
    pairs = [pair(name, seed) for name in NAMES]
    while len(pairs) % COLUMNS:
        pairs.append(np.full_like(pairs[0], 255))
    rows = [np.concatenate(pairs[k : k + COLUMNS], axis=1) for k in range(0, len(pairs), COLUMNS)]
    write_png(target, np.concatenate(rows, axis=0))
    print(target)


if __name__ == "__main__":
    main()
