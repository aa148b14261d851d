"""next_duration: its bounds, and which way it goes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emseg import MotionModel
from emseg.tracking import Objects
from emseg.window_length import next_duration

SHORTEST, CALM, LONGEST = 2_000, 25_000, 60_000


def found(*objects: tuple[float, int], along: float = 0.0) -> Objects:
    """Objects by how far they moved against the background, px, and their events; and how far that moved."""
    nobody, still = np.empty(0, np.int32), [MotionModel("translation", label=0)]
    flows = [(np.array([0.6, -0.8]) * apart, events) for apart, events in objects]
    return Objects(nobody, still, nobody, still, flows, np.array([along, 0.0]))


distances = st.floats(0, 1e4)


@given(
    st.integers(1, 10**9),
    st.lists(st.tuples(distances, st.integers(1, 10**6)), max_size=6),
    distances,
)
def test_durations_stay_within_bounds_and_change_by_half_or_twice_at_most(
    duration: int, objects: list[tuple[float, int]], along: float
) -> None:
    wanted = next_duration(duration, found(*objects, along=along))
    assert SHORTEST <= wanted <= LONGEST
    least = SHORTEST if along > 15 else CALM
    assert wanted >= least
    # The bounds come last: what is beyond them is brought back at once.
    if wanted not in (least, LONGEST):
        assert duration / 2 - 1 <= wanted <= duration * 2 + 1


@pytest.mark.parametrize(
    ("apart", "along", "expected"),
    [
        (10.0, 20.0, 30_000),  # as is wanted
        (5.5, 20.0, 30_000),  # near enough
        (17.5, 20.0, 30_000),
        (4.0, 12.0, 60_000),  # 10 / 4, but twice at most
        (25.0, 20.0, 15_000),  # 10 / 25, but half at most
        (20.0, 20.0, 15_000),
        (20.0, 10.0, 25_000),  # nothing is short where the background is calm
        (10.0, 60.0, 15_000),  # the background goes too far
        (10.0, 40.0, 22_500),
        (25.0, 2.0, 30_000),  # its edges would look false in a shorter one
    ],
)
def test_windows_of_30_ms(apart: float, along: float, expected: int) -> None:
    assert next_duration(30_000, found((apart, 1000), along=along)) == expected


def test_where_nothing_moves_windows_grow() -> None:
    assert next_duration(30_000, found()) == 45_000
    assert next_duration(50_000, found()) == LONGEST


def test_the_slower_objects_count_by_their_events() -> None:
    """A fast object shortens windows only where less than three tenths of the moving events are slower."""
    slow, fast = (10.0, 400), (40.0, 600)
    assert next_duration(30_000, found(fast, slow, along=20.0)) == 30_000
    assert next_duration(30_000, found((40.0, 800), (10.0, 200), along=20.0)) == 15_000
