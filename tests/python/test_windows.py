"""Windows by count and by duration, against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from emseg import _core

INT64 = np.iinfo(np.int64)


@given(event_count=st.integers(0, 500), count=st.integers(1, 600))
def test_windows_by_count_partition_the_events(event_count: int, count: int) -> None:
    windows = _core.windows_by_count(event_count, count)
    assert windows.dtype == np.int64
    assert windows.shape[1:] == (2,)
    starts = list(range(0, event_count, count))
    assert windows.tolist() == [[start, min(start + count, event_count)] for start in starts]


@given(
    t=hnp.arrays(np.int64, st.integers(0, 60), elements=st.integers(INT64.min, INT64.max)).map(np.sort),
    duration=st.integers(1, INT64.max),
)
def test_windows_by_duration_group_by_interval_for_any_times(t: np.ndarray, duration: int) -> None:
    interval = [(int(time) - int(t[0])) // duration for time in t]
    expected = []
    for k, index in enumerate(interval):
        if k == 0 or index != interval[k - 1]:
            expected.append([k, k])
        expected[-1][1] = k + 1
    windows = _core.windows_by_duration(t, duration)
    assert windows.dtype == np.int64
    assert windows.tolist() == expected


@given(
    steps=hnp.arrays(np.int64, st.integers(1, 80), elements=st.integers(0, 40)), duration=st.integers(1, 100)
)
def test_windows_by_duration_do_not_depend_on_the_origin_of_time(steps: np.ndarray, duration: int) -> None:
    t = np.cumsum(steps)
    shifted = _core.windows_by_duration(t - 10**15, duration)
    assert np.array_equal(_core.windows_by_duration(t, duration), shifted)


def test_empty_recordings_have_no_window() -> None:
    assert _core.windows_by_count(0, 5).shape == (0, 2)
    assert _core.windows_by_duration(np.empty(0, np.int64), 5).shape == (0, 2)


def test_bad_lengths_are_refused() -> None:
    t = np.arange(3)
    with pytest.raises(ValueError, match="window count is 0"):
        _core.windows_by_count(3, 0)
    with pytest.raises(ValueError, match="window duration is -4 us"):
        _core.windows_by_duration(t, -4)
    with pytest.raises(ValueError, match="event 1 has time 1 us, before its predecessor's 2 us"):
        _core.windows_by_duration(t[::-1].copy(), 4)
