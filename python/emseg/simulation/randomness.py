"""Random numbers for scenes, the same on any machine and in any version of NumPy."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

__all__ = ["Random", "seed_from"]

Item = TypeVar("Item")


def seed_from(*parts: object) -> int:
    """A seed, 0 .. 2⁶³-1, from names and numbers."""
    digest = hashlib.sha256("/".join(map(str, parts)).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1


class Random:
    """Draws from the raw bits of PCG64, whose stream NumPy promises never to change."""

    def __init__(self, *seed: object) -> None:
        self._bits = np.random.PCG64(seed_from(*seed))

    def uniform(self, low: float, high: float) -> float:
        """A number between the two."""
        return low + (high - low) * (int(self._bits.random_raw()) >> 11) * 2.0**-53

    def spread(self, low: float, high: float) -> float:
        """A number between the two, evenly in its logarithm."""
        return float(low * (high / low) ** self.uniform(0, 1))

    def integer(self, low: int, high: int) -> int:
        """A whole number, both ends included."""
        return low + int(self.uniform(0, 1) * (high - low + 1))

    def choice(self, items: Sequence[Item]) -> Item:
        """One of the items."""
        return items[self.integer(0, len(items) - 1)]

    def sign(self) -> int:
        """-1 or 1."""
        return self.choice((-1, 1))

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return self.uniform(0, 1) < probability

    def shuffled(self, items: Sequence[Item]) -> list[Item]:
        """The items in another order."""
        left = list(items)
        return [left.pop(self.integer(0, len(left) - 1)) for _ in range(len(left))]
