"""Parts and pairs of objects, beside SciPy, which is slow to import and so not used there."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.ndimage import label
from scipy.optimize import linear_sum_assignment

from emseg.tracking import best_pairs, connected_components


@settings(max_examples=200, deadline=None)
@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_components_are_scipys(occupied: np.ndarray) -> None:
    expected, _ = label(occupied, structure=np.ones((3, 3)))
    assert np.array_equal(connected_components(occupied), expected - 1)


def test_a_spiral_is_one_component() -> None:
    spiral = np.array(
        [
            [1, 1, 1, 1, 1, 1, 1],
            [0, 0, 0, 0, 0, 0, 1],
            [1, 1, 1, 1, 1, 0, 1],
            [1, 0, 0, 0, 1, 0, 1],
            [1, 0, 1, 1, 1, 0, 1],
            [1, 0, 0, 0, 0, 0, 1],
            [1, 1, 1, 1, 1, 1, 1],
        ],
        bool,
    )
    assert set(connected_components(spiral)[spiral].tolist()) == {0}
    assert (connected_components(spiral)[~spiral] == -1).all()


def gains(rows: int, columns: int) -> st.SearchStrategy[np.ndarray]:
    """Mostly nothing, as of boxes that rarely overlap, or anything; eighths, so that sums are exact."""
    rare, any_ = (st.sampled_from(values) for values in ([0, 0, 0, 1, 5], range(9)))
    eighths = arrays(int, (rows, columns), elements=rare) | arrays(int, (rows, columns), elements=any_)
    return eighths.map(lambda values: values / 8)


@settings(max_examples=300, deadline=None)
@given(st.tuples(st.integers(1, 7), st.integers(1, 7)).flatmap(lambda shape: gains(*shape)))
def test_pairs_gain_the_most(gain: np.ndarray) -> None:
    pairs = best_pairs(gain)
    assert len(pairs) == min(gain.shape)
    assert sum(gain[pair] for pair in pairs) == gain[linear_sum_assignment(-gain)].sum()
    for side in zip(*pairs, strict=True):
        assert len(set(side)) == len(side)
