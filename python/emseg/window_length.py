"""How long windows last: by the motion that was found in the last one."""

from __future__ import annotations

from typing import Final

import numpy as np

from emseg.tracking import Objects

__all__ = ["FIRST_TRIAL_US", "MOST_EVENTS", "next_duration"]

FIRST_TRIAL_US: Final = 60_000
"""Duration that the first window of a recording is tried with."""

MOST_EVENTS: Final = 500_000
"""Of a window, however long it is to last: what is in memory at a time."""

# px that objects shall move against the background: enough to be told from it, and uniform
_APART: Final = 10.0
_TOO_NEAR, _TOO_FAR = 5.0, 18.0  # px: a window in between is left as long as it is
_SLOW_SHARE: Final = 0.3  # of the moving events, that may move less
_ALONG_LEAST: Final = 4.0  # px that a moving background moves at least: its edges look false with less
_ALONG_MOST: Final = 30.0  # px that the background shall move at the most
_LONGEST_US: Final = 60_000
_SHORTEST_US: Final = 2_000
_CALM_US: Final = 25_000  # where the background moves little: shorter ones show false motions of edges


def next_duration(duration_us: int, found: Objects) -> int:
    """Duration, µs, that the window after one of `duration_us` shall have.

    It is at most twice as long or as short, but for the bounds, which come last.

    Slower objects count, not faster ones: too short a window makes false motions, which are fast, too long a
    one loses the fastest objects only.
    """
    factor = 1.5
    if found.flows:
        speeds = np.array([np.linalg.norm(flow) for flow, _ in found.flows])
        counts = np.array([count for _, count in found.flows])
        order = np.argsort(speeds)
        rank = int(np.searchsorted(np.cumsum(counts[order]), _SLOW_SHARE * counts.sum()))
        apart = max(1e-6, float(speeds[order[min(rank, len(order) - 1)]]))
        factor = 1.0 if _TOO_NEAR < apart < _TOO_FAR else _APART / apart
    along = max(1e-6, float(np.linalg.norm(found.background_flow)))
    if 0.5 < along < _ALONG_LEAST:
        factor = max(1.0, factor)
    wanted = duration_us * float(np.clip(min(factor, _ALONG_MOST / along), 0.5, 2.0))
    shortest = _SHORTEST_US if along > _ALONG_MOST / 2 else _CALM_US
    return round(float(np.clip(wanted, shortest, _LONGEST_US)))
