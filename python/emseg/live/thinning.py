"""Thinning: which events of a window to leave out where there are more than the machine can do.

The rule: of n events, k are kept evenly by number, the i-th kept being event floor(i n / k), so that no
moment, pixel or polarity is favoured.  How many are kept follows from how many were done in how much time
before; given these numbers, the same events are kept again.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["Thinning", "even_sample"]

FEWEST: Final = 2_000
"""Events that are kept in any case: fewer tell little."""

FIRST_RATE: Final = 400_000.0
"""Events a second that are counted on before any were done."""

_LOAD: Final = 0.85  # share of the time that is planned with
# Share of the rate so far that is kept with each new window: what is too slow must be met at once, what is
# faster than thought may be chance.
_MEMORY_OF_FASTER: Final = 0.3
_MEMORY_OF_SLOWER: Final = 0.7


def even_sample(count: int, kept: int) -> npt.NDArray[np.intp]:
    """Which of `count` events to keep: (kept,) numbers, rising, evenly spread; all where they are no more."""
    if kept >= count:
        return np.arange(count, dtype=np.intp)
    return np.arange(kept, dtype=np.intp) * count // max(kept, 1)


class Thinning:
    """Sizes windows by the rate at which the last ones were done.

    Attributes:
        rate: Events done a second.
    """

    def __init__(self) -> None:
        self.rate = FIRST_RATE

    def keep(self, count: int, seconds: float) -> int:
        """How many of a window's `count` events can be done in some time, s."""
        return min(count, max(FEWEST, int(self.rate * _LOAD * max(seconds, 0.0))))

    def note(self, count: int, seconds: float) -> None:
        """Take into account that `count` events took some time, s."""
        rate = count / max(seconds, 1e-6)
        memory = _MEMORY_OF_FASTER if rate < self.rate else _MEMORY_OF_SLOWER
        self.rate = memory * self.rate + (1 - memory) * rate
