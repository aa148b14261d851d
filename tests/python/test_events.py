"""EventArray: what comes in is validated once, and what is in stays valid."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from emseg.events import EVENT_DTYPE, EventArray


def make(n: int = 5, **changes: Any) -> EventArray:
    columns: dict[str, Any] = {
        "x": np.arange(n) % 8,
        "y": np.arange(n) % 6,
        "t": np.arange(n) * 10,
        "p": np.arange(n) % 2,
    }
    size = {"width": 8, "height": 6} | {k: changes.pop(k) for k in ("width", "height") if k in changes}
    return EventArray(**(columns | changes), **size)


@st.composite
def event_arrays(draw: st.DrawFn, min_size: int = 0) -> EventArray:
    n = draw(st.integers(min_size, 40))
    width, height = draw(st.integers(1, 50)), draw(st.integers(1, 50))
    return EventArray(
        draw(hnp.arrays(np.uint16, n, elements=st.integers(0, width - 1))),
        draw(hnp.arrays(np.uint16, n, elements=st.integers(0, height - 1))),
        np.sort(draw(hnp.arrays(np.int64, n, elements=st.integers(-(10**15), 10**15)))),
        draw(hnp.arrays(np.uint8, n, elements=st.integers(0, 1))),
        width=width,
        height=height,
    )


def test_right_columns_are_not_copied_and_cannot_be_written() -> None:
    x = np.array([1, 2], np.uint16)
    t = np.array([5, 5], np.int64)
    events = EventArray(x, x, t, np.array([0, 1], np.uint8), width=4, height=4)
    assert np.shares_memory(events.x, x)
    assert np.shares_memory(events.t, t)
    assert x.flags.writeable  # the caller's own array is left alone
    with pytest.raises(ValueError, match="read-only"):
        events.x[0] = 3
    with pytest.raises(AttributeError, match="frozen"):
        events.width = 3  # type: ignore[misc]
    with pytest.raises(AttributeError, match="frozen"):
        del events.width


@pytest.mark.parametrize("dtype", [np.int8, np.int32, np.uint64, np.float32, np.float64, ">i4", ">u2"])
def test_other_types_are_converted_when_nothing_is_lost(dtype: Any) -> None:
    events = make(x=np.arange(5).astype(dtype), t=np.arange(5).astype(dtype))
    assert [getattr(events, c).dtype for c in "xytp"] == [np.uint16, np.uint16, np.int64, np.uint8]
    assert events.x.tolist() == events.t.tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("polarity", [[1, -1, 1, 1, -1], [True, False, True, True, False], [1.0, 0, 1, 1, 0]])
def test_polarities(polarity: Any) -> None:
    assert make(p=polarity).p.tolist() == [1, 0, 1, 1, 0]


def test_strided_columns_become_contiguous() -> None:
    t = np.arange(10, dtype=np.int64)[::2]
    assert make(t=t).t.flags.c_contiguous


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": [0, 10, 5, 20, 1]}, r"event 2 has time 5 us, before its predecessor's 10 us"),
        ({"x": [0, 1, 8, 3, 9]}, r"event 2 has x = 8, outside the sensor, expected 0\.\.7"),
        ({"x": np.array([0, 1, 8, 3, 9], np.uint16)}, r"event 2 lies at \(8, 2\), outside the sensor of 8x6"),
        ({"y": [0, 1, 2, -3, 9]}, r"event 3 has y = -3, outside the sensor"),
        ({"x": [0, 1, 2.5, 3, 4]}, r"event 2 has x = 2\.5, expected a whole number"),
        ({"x": [0, 1, np.nan, 3, 4]}, r"event 2 has x = nan, expected a finite number"),
        ({"t": [0, 1, 2, 3, np.inf]}, r"event 4 has t = inf"),
        ({"t": [0.0, 0.001, 0.002, 1, 2]}, r"event 1 has t = 0\.001, expected whole microseconds \(seconds"),
        ({"t": np.array([0, 1, 2, 3, 2**63], np.uint64)}, r"event 4 has t = 9223372036854775808"),
        ({"t": [0, 1, 2, 3, 1e300]}, r"event 4 has t = 1e\+300"),
        ({"p": [0, 1, 2, 1, 0]}, r"event 2 has polarity 2, expected 0 or 1"),
        ({"p": np.array([0, 1, 2, 1, 0], np.uint8)}, r"event 2 has polarity 2, expected 0 or 1"),
        ({"p": [0, 1, -1, 1, 0]}, r"event 0 has polarity 0, expected -1 or 1"),
        ({"p": [0, 1, -2, 1, 0]}, r"event 2 has polarity -2"),
        ({"x": [0, 1]}, r"different lengths: x 2, y 5, t 5, p 5"),
        ({"x": np.zeros((5, 1), int)}, r"x has shape \(5, 1\), expected one dimension"),
        ({"x": list("abcde")}, r"x has dtype <U1, expected whole numbers"),
        ({"x": [True] * 5}, r"x has dtype bool"),
        ({"x": np.zeros(5, complex)}, r"x has dtype complex128"),
        ({"x": [[1], [2, 3]]}, r"x is no array of numbers"),
        ({"width": 0}, r"sensor width is 0, expected 1\.\.65536"),
        ({"height": 2.5}, r"sensor height is 2\.5, expected a whole number"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(**changes)


def test_empty() -> None:
    events = EventArray([], [], [], [], width=3, height=2)
    assert len(events) == events.duration == 0
    assert repr(events) == "EventArray(0 events, 3x2, empty)"
    assert events[0:0] == events == EventArray.concatenate([events, events])


@given(event_arrays(), st.integers(-50, 50), st.integers(-50, 50))
def test_slices_are_views_of_the_same_events(events: EventArray, a: int, b: int) -> None:
    part = events[a:b]
    assert part.t.tolist() == events.t.tolist()[a:b]
    assert (part.width, part.height) == (events.width, events.height)
    if len(part):
        assert np.shares_memory(part.x, events.x)


@given(event_arrays(), st.data())
def test_masks_and_rising_indices_keep_order(events: EventArray, data: st.DataObject) -> None:
    mask = data.draw(hnp.arrays(bool, len(events)))
    assert events[mask] == events[np.flatnonzero(mask)]
    assert events[mask].to_structured().tolist() == events.to_structured()[mask].tolist()


@pytest.mark.parametrize(
    ("index", "error"),
    [
        (slice(None, None, -1), ValueError),
        ([2, 1], ValueError),
        ([-1, 0], ValueError),
        ([0, 5], IndexError),
        ([-6], IndexError),
        (np.ones(4, bool), IndexError),
        (1, TypeError),
        ("x", TypeError),
        ([0.5], TypeError),
    ],
)
def test_bad_indices(index: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        make()[index]


@given(event_arrays())
def test_round_trips(events: EventArray) -> None:
    structured = events.to_structured()
    assert structured.dtype == EVENT_DTYPE
    size = {"width": events.width, "height": events.height}
    assert EventArray.from_structured(structured, **size) == events
    assert pickle.loads(pickle.dumps(events)) == events
    half = len(events) // 2
    assert EventArray.concatenate([events[:half], events[half:]]) == events


def test_structured_names_of_other_tools() -> None:
    dtype = [("timestamp", "<i8"), ("x", "<i2"), ("y", "<i2"), ("polarity", "i1")]
    events = EventArray.from_structured(np.array([(7, 1, 2, 1)], dtype), width=4, height=4)
    assert events.to_structured().tolist() == [(1, 2, 7, 1)]
    with pytest.raises(ValueError, match="lacks p"):
        EventArray.from_structured(np.array([(7, 1, 2)], dtype[:3]), width=4, height=4)
    with pytest.raises(ValueError, match="has no fields"):
        EventArray.from_structured(np.zeros(3), width=4, height=4)


def test_concatenate_refuses_what_does_not_follow() -> None:
    with pytest.raises(ValueError, match="event 5 has time 0 us, before"):
        EventArray.concatenate([make(), make()])
    with pytest.raises(ValueError, match="different sizes: 8x6, 9x6"):
        EventArray.concatenate([make(), make(width=9)])
    with pytest.raises(ValueError, match="nothing to concatenate"):
        EventArray.concatenate([])


@given(event_arrays(), st.integers(-(10**15), 10**15), st.integers(0, 10**15))
def test_between_is_half_open(events: EventArray, start: int, length: int) -> None:
    inside = (events.t >= start) & (events.t < start + length)
    assert events.between(start, start + length) == events[inside]


def test_equality_is_by_value() -> None:
    assert make() == make()
    assert make() != make(width=9)
    assert make() != make(p=[0] * 5)
    assert make() != "events"
    assert make().duration == 40
