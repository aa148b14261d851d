"""The scene suite: scenes named after what the literature tests, each random from a seed.

Names follow the Extreme Event Dataset of Mitrokhin et al. (IROS 2018), EV-IMO (IROS 2019), and a master
thesis on motion segmentation with event cameras, which failed at slow_cam and fast_cam.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

from emseg.simulation.randomness import Random
from emseg.simulation.scene import Scene
from emseg.simulation.suite_scenes import SCENES

__all__ = ["DURATION", "NAMES", "SPLITS", "split_of", "suite_scene"]

NAMES: Final = tuple(SCENES)
"""The scenes of the suite."""

DURATION: Final = 0.5  # s

Split = Literal["train", "validation", "test"]

SPLITS: Final[Mapping[Split, range]] = MappingProxyType(
    {"train": range(0, 10_000), "validation": range(10_000, 11_000), "test": range(11_000, 12_000)}
)
"""Which seeds are for what."""


def split_of(seed: int) -> Split:
    """The split that a seed belongs to.

    Raises:
        ValueError: where it belongs to none.
    """
    for split, seeds in SPLITS.items():
        if seed in seeds:
            return split
    raise ValueError(f"seed is {seed}, expected 0..{SPLITS['test'][-1]}")


def suite_scene(name: str, seed: int, *, duration: float = DURATION) -> Scene:
    """A scene of the suite.

    Args:
        name: One of :data:`NAMES`.
        seed: Any; :data:`SPLITS` says which are for training, validation and testing.
        duration: Length, s.

    Raises:
        ValueError: for an unknown name.
    """
    if name not in SCENES:
        raise ValueError(f"unknown scene '{name}', expected one of {', '.join(NAMES)}")
    scene = SCENES[name](Random("suite", name, seed), duration)
    return scene.model_copy(update={"name": f"{name}_{seed:05d}", "seed": seed})
