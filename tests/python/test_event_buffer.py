"""Recordings in chunks: the same windows and labels as whole ones, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import emseg
from emseg.datasets import bundled
from emseg.event_buffer import EventBuffer
from emseg.events import EventArray

RULES = {
    "by count": emseg.Config(num_events_per_image=9_000),
    "by duration": emseg.Config(window_duration=0.02),
    "adaptive": emseg.Config(),
}


def events_at(times: list[int]) -> EventArray:
    """Events at these times whose columns number them."""
    number = np.arange(len(times))
    return EventArray(number % 50, number // 50 % 50, sorted(times), number % 2, width=50, height=50)


def cut(events: EventArray, at: list[int]) -> list[EventArray]:
    edges = [0, *sorted(min(edge, len(events)) for edge in at), len(events)]
    return [events[start:stop] for start, stop in pairwise(edges)]


def buffer_of(chunks: EventArray | list[EventArray]) -> EventBuffer:
    return EventBuffer(chunks, width=50, height=50)


TIMES = st.lists(st.integers(-100, 100) | st.integers(-(2**63), 2**63 - 1), max_size=30)


@given(TIMES, st.lists(st.integers(0, 30), max_size=8), st.integers(0, 12), st.integers(1, 60))
def test_what_is_ahead_reaches_as_far_as_asked(
    times: list[int], at: list[int], count: int, duration: int
) -> None:
    events = events_at(times)
    for chunks in (events, cut(events, at)):
        buffer = buffer_of(chunks)
        while len(ahead := buffer.look_ahead(count=count, duration_us=duration)):
            rest = events[buffer.taken :]
            assert ahead == rest[: len(ahead)]
            seen = int(ahead.t[-1]) - int(ahead.t[0])
            assert len(ahead) == len(rest) or len(ahead) > count or seen >= duration
            assert buffer.take(3) == ahead[:3]
        assert buffer.taken == len(events)


@given(TIMES, st.lists(st.integers(0, 30), max_size=8), st.integers(1, 60))
def test_windows_by_duration_are_those_of_the_core(times: list[int], at: list[int], duration: int) -> None:
    """The core finds them in the whole array at once."""
    events = events_at(times)
    buffer = buffer_of(cut(events, at))
    found = []
    while size := len(buffer.take(buffer.count_to_multiple(duration))):
        found.append([buffer.taken - size, buffer.taken])
    assert found == emseg._core.windows_by_duration(events.t, duration).tolist()


def without_crumb(rest: list[int], duration: int, most: int) -> int:
    """How long the next window is to be, of events so long after its first."""
    left = rest[-1] + 1
    if len(rest) > 2 * most or left >= 2 * duration:
        return duration
    return left if left <= 1.25 * duration else (left + 1) // 2


@pytest.mark.parametrize("to_end", [False, True], ids=["cut", "whole"])
@given(TIMES, st.lists(st.integers(0, 30), max_size=8), st.integers(1, 60), st.integers(1, 12))
def test_what_comes_within_a_duration_is_counted_and_the_end_leaves_no_crumb(
    to_end: bool, times: list[int], at: list[int], duration: int, most: int
) -> None:
    events = events_at(times)
    buffer = buffer_of(cut(events, at))
    count_next = buffer.count_to_end if to_end else buffer.count_within
    while buffer.taken < len(events):
        rest = [int(t) - int(events.t[buffer.taken]) for t in events.t[buffer.taken :]]
        wanted = without_crumb(rest, duration, most) if to_end else duration
        count = count_next(duration, most=most)
        assert count == min(most, sum(since < wanted for since in rest))
        buffer.take(count)
    assert count_next(duration, most=most) == 0


def test_the_last_windows_by_hand() -> None:
    buffer = buffer_of(events_at(list(range(100))))
    assert buffer.count_to_end(40, most=200) == 40
    assert buffer.count_to_end(60, most=200) == 50  # and 50 are left, not 40
    assert buffer.count_to_end(80, most=200) == 100
    assert buffer.count_to_end(79, most=200) == 50


def test_no_more_is_held_than_asked_for() -> None:
    drawn = 0

    def chunks() -> Iterator[EventArray]:
        nonlocal drawn
        for start in range(0, 1000, 10):
            drawn += 10
            yield events_at(list(range(start, start + 10)))

    buffer = EventBuffer(chunks(), width=50, height=50)
    for taken in range(0, 900, 30):
        ahead = buffer.look_ahead(count=45, duration_us=200)
        assert len(ahead) <= 45 + 10
        assert drawn <= taken + 45 + 10
        buffer.take(30)


def test_chunks_that_do_not_follow_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="event 2 has t = 4, expected 5 or later"):
        buffer_of([events_at([1, 5]), events_at([4, 9])]).look_ahead(count=9)
    buffer = buffer_of([events_at([1, 5]), events_at([4, 9])])
    buffer.look_ahead(count=1)
    buffer.take(2)  # what was taken is remembered
    with pytest.raises(ValueError, match="event 2 has t = 4"):
        buffer.look_ahead(count=1)
    with pytest.raises(ValueError, match="the events' sensor is 50x50, the segmenter's 40x50"):
        EventBuffer(events_at([1]), width=40, height=50).look_ahead(count=1)


@cache
def made_scene() -> EventArray:
    return emseg.read(bundled()["made_scene"])[:45_000]


@pytest.mark.parametrize("rule", list(RULES))
def test_how_a_recording_is_cut_changes_nothing(rule: str) -> None:
    events = made_scene()
    config = replace(RULES[rule], threads=1)
    pieces = [
        events,
        cut(events, [7, 7, 1_000, 20_000, 20_001, 44_999]),
        cut(events, [*range(0, 45_000, 333)]),
    ]
    runs = [
        [
            (seg.start, seg.stop, seg.t_ref, seg.labels.tolist(), seg.boxes.tolist())
            for seg in emseg.Segmenter(events.width, events.height, config=config).run(piece)
        ]
        for piece in pieces
    ]
    assert len(runs[0]) > 1
    assert runs[0][-1][1] == len(events)
    assert runs[0] == runs[1] == runs[2]
