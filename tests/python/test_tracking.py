"""Objects of parts through time.

Pairs are held against SciPy, which is slow to import and so not used there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from engine_and_reference import reference_camera
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linear_sum_assignment

from emseg import Camera, EventArray, MotionModel, scene, tracking
from emseg.parts import Part, Window
from emseg.tracking import Objects, Tracker, best_pairs


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


# Objects --------------------------------------------------------------------------------------------------

Thing = tuple[float, float, float, float]  # middle at the window's middle, px; velocity, px/s
SIDE, EVENTS = 40, 2000


def window(
    *things: Thing, t_ref: int = 20_000, weights: Sequence[int] | None = None
) -> tuple[EventArray, np.ndarray, list[MotionModel], int]:
    """Squares of 40 px that move for 40 ms before a still ground all over the view; labels as by motion."""
    rng = np.random.default_rng(0)
    sizes = [4 * EVENTS, *(weights or [EVENTS] * len(things))]
    label = np.repeat(np.arange(len(sizes)), sizes)
    t = rng.integers(-20_000, 20_000, len(label))
    order = np.argsort(t, kind="stable")
    label, t = label[order], t[order]
    middle = np.array([(160.0, 120.0), *(thing[:2] for thing in things)])[label]
    velocity = np.array([(0.0, 0.0), *(thing[2:] for thing in things)])
    side = np.where(label == 0, 1, SIDE)[:, None] * np.where((label == 0)[:, None], (320, 240), (1, 1))
    place = middle + (rng.random((len(t), 2)) - 0.5) * side + velocity[label] * (t * 1e-6)[:, None]
    pixel = np.clip(place, 0, (319, 239)).astype(np.int64)
    events = EventArray(*pixel.T, t + t_ref, label % 2, width=320, height=240)
    models = [MotionModel("translation", v, k) for k, v in enumerate(velocity)]
    return events, label.astype(np.int32), models, t_ref


def assign(tracker: Tracker, *things: Thing, t_ref: int = 20_000, **others: Sequence[int]) -> Objects:
    return tracker.assign(*window(*things, t_ref=t_ref, **others))


ToldTracker = Callable[[Sequence[float]], Tracker]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> ToldTracker:
    """Makes a tracker that is told how likely the one thing of each window moves, as logits."""

    def make(logits: Sequence[float]) -> Tracker:
        answers = iter(logits)

        def answer(
            parts: Sequence[Part], *_: Window | np.ndarray | None
        ) -> tuple[np.ndarray, Part, MotionModel]:
            return np.array([-9.0, *[next(answers)] * (len(parts) - 1)]), parts[0], scene.STILL

        monkeypatch.setattr(tracking, "moving_logits", answer)
        return Tracker(320, 240, loss=lambda *_, **__: [0.0])

    return make


LEFT, RIGHT = (100.0, 120.0), (142.0, 120.0)  # side by side


@pytest.mark.parametrize(
    ("velocity", "objects"),
    [
        ((240.0, 60.0), 1),  # as the other, nearly
        ((-200.0, 0.0), 2),  # the other way
        ((0.0, 200.0), 2),  # across
        ((40.0, 0.0), 2),  # the same way, a fifth as fast
    ],
)
def test_parts_side_by_side_are_one_body_if_they_go_alike(
    velocity: tuple[float, float], objects: int
) -> None:
    found = assign(Tracker(320, 240), (*LEFT, 200.0, 0.0), (*RIGHT, *velocity))
    assert [model.label for model in found.models] == list(range(objects + 1))
    assert [model.label for model in found.part_models] == [0, 1, 2]
    assert set(np.unique(found.labels)) - {-1} == set(range(objects + 1))
    assert set(np.unique(found.parts)) - {-1} == {0, 1, 2}


def test_parts_that_go_alike_far_from_each_other_are_two_objects() -> None:
    found = assign(Tracker(320, 240), (60.0, 60.0, 200.0, 0.0), (260.0, 180.0, 200.0, 0.0))
    assert [model.label for model in found.models] == [0, 1, 2]


def test_parts_are_numbered_within_objects_and_an_object_moves_as_its_largest_part() -> None:
    events, labels, models, t_ref = window(
        (*LEFT, 200.0, 0.0), (*RIGHT, 240.0, 60.0), (260.0, 40.0, 0.0, 300.0), weights=[1000, 2000, 1500]
    )
    found = Tracker(320, 240).assign(events, labels, models, t_ref)
    assert [model.label for model in found.models] == [0, 1, 2]
    np.testing.assert_array_equal(found.models[1].params, models[2].params)
    np.testing.assert_array_equal(found.models[2].params, models[3].params)
    # The larger of the first object's parts, its other one, then the second object's.
    for part, label in ((1, 2), (2, 1), (3, 3)):
        np.testing.assert_array_equal(found.part_models[part].params, models[label].params)
        own = found.parts == part
        assert (labels[own] == label).all()
        assert own.sum() > 0.95 * (labels == label).sum()
        assert (found.labels[own] == (2 if part == 3 else 1)).all()
    flows = {(round(float(flow[0]), 3), round(float(flow[1]), 3)) for flow, _ in found.flows}
    seconds = events.duration * 1e-6
    assert flows == {
        (round(v[0] * seconds, 3), round(v[1] * seconds, 3)) for v in (m.params for m in models[1:])
    }
    np.testing.assert_allclose(found.background_flow, 0.0)


def test_numbers_are_kept_while_objects_pass_and_a_new_one_gets_a_new_number() -> None:
    tracker = Tracker(320, 240)
    down, up, new = (100.0, 60.0, 0.0, 400.0), (220.0, 200.0, 0.0, -400.0), (30.0, 30.0, 300.0, 0.0)

    def after(thing: Thing, seconds: float) -> Thing:
        x, y, vx, vy = thing
        return x + vx * seconds, y + vy * seconds, vx, vy

    for k in range(4):
        now = [after(thing, 0.04 * k) for thing in (down, up)]
        things = now[:: 1 if k % 2 else -1]  # motions come in any order
        if k == 3:
            things.append(new)
        events, labels, models, t_ref = window(*things, t_ref=20_000 + 40_000 * k)
        found = tracker.assign(events, labels, models, t_ref)
        number_of = {tuple(model.params): model.label for model in found.models}
        if k == 0:
            first = number_of
        assert number_of[0.0, 400.0] == first[0.0, 400.0]
        assert number_of[0.0, -400.0] == first[0.0, -400.0]
    assert number_of[300.0, 0.0] == 3


@pytest.mark.parametrize(("missed_at", "number"), [(tracking.MEMORY_US, 1), (tracking.MEMORY_US + 1, 2)])
def test_an_object_that_is_missed_for_too_long_is_a_new_one(missed_at: int, number: int) -> None:
    tracker = Tracker(320, 240)
    standing = (100.0, 60.0, 1.0, 0.0)
    assert assign(tracker, standing, t_ref=0).models[1].label == 1
    assert len(assign(tracker, t_ref=missed_at).models) == 1
    assert assign(tracker, standing, t_ref=missed_at + 1).models[1].label == number


@pytest.mark.parametrize(
    ("logits", "moving"),
    [
        ([3.0, -1.0], [True, True]),  # 0.7 · 3 - 1
        ([3.0, -3.0], [True, False]),
        ([-3.0, 1.0], [False, False]),  # 1 - 0.7 · 3
        ([-3.0, 3.0], [False, True]),
        ([100.0, -5.0], [True, False]),  # no window is believed beyond 6: 0.7 · 6 - 5
    ],
)
def test_evidence_of_earlier_windows_counts(
    told: ToldTracker, logits: list[float], moving: list[bool]
) -> None:
    tracker = told(logits)
    # Too slow to say where it went, between the windows.
    found = [
        assign(tracker, (100 + 2.0 * k, 60.0, 50.0, 0.0), t_ref=20_000 + 40_000 * k)
        for k in range(len(logits))
    ]
    assert [len(objects.models) > 1 for objects in found] == moving


@pytest.mark.parametrize(("speed", "found"), [(200.0, 2), (-200.0, 1)], ids=["as it", "otherwise"])
def test_what_was_cut_off_an_object_and_goes_alike_moves_with_it(
    told: ToldTracker, speed: float, found: int
) -> None:
    """Half of it lies where the object is expected; another part is taken for that."""
    tracker = told([5.0, -0.5])
    assign(tracker, (104.0, 60.0, 200.0, 0.0), t_ref=0)
    later = assign(tracker, (108.0, 60.0, 200.0, 0.0), (120.0, 60.0, speed, 0.0), t_ref=20_000)
    assert len(later.part_models) - 1 == found


@pytest.mark.parametrize(("stays", "moves"), [(True, False), (False, True)])
def test_what_stays_where_it_was_does_not_move_for_long(told: ToldTracker, stays: bool, moves: bool) -> None:
    """A part that is said to move 20 px between two windows, and does or does not."""

    tracker = told([0.1] * 3)
    for k in range(3):
        at = 100.0 if stays else 100.0 + 20.0 * k
        found = assign(tracker, (at, 60.0, 500.0, 0.0), t_ref=20_000 + 40_000 * k)
    assert (len(found.models) > 1) == moves


def velocities(tracker: Tracker) -> list[tuple[float, ...]]:
    return sorted(tuple(known.model.params) for known in tracker.motions())


def test_motions_are_those_of_objects_each_once_and_the_last_known() -> None:
    tracker = Tracker(320, 240)
    assert tracker.motions() == []
    down, alike, up = (60.0, 60.0, 0.0, 400.0), (160.0, 60.0, 0.0, 400.0), (260.0, 200.0, 0.0, -400.0)
    assert len(assign(tracker, down, alike, up).models) == 4
    assert velocities(tracker) == [(0.0, -400.0), (0.0, 400.0)]
    # One slows down, one is missed.
    assign(tracker, (60.0, 76.0, 0.0, 350.0), (160.0, 76.0, 0.0, 400.0), t_ref=60_000)
    assert velocities(tracker) == [(0.0, -400.0), (0.0, 350.0), (0.0, 400.0)]


def places_of(events: EventArray, own: np.ndarray, model: MotionModel, t_ref: int) -> np.ndarray:
    """Where events are at t_ref by a translation, in double precision."""
    dt = (events.t[own] - t_ref) * 1e-6
    return np.column_stack([events.x[own], events.y[own]]) - dt[:, None] * model.params


def assert_some_of(places: np.ndarray, expected: np.ndarray) -> None:
    """Each of the places is one of those expected, and they lie all over these."""
    assert places.dtype == np.float32
    assert places.shape[1] == 2
    apart = np.linalg.norm(places[:, None] - expected[None], axis=2)
    assert apart.min(axis=1).max() < 1e-3
    assert apart.min(axis=0).max() < 8  # px: of a square of 40 px


def test_motions_come_with_places_and_times() -> None:
    tracker = Tracker(320, 240)
    down, alike, up = (60.0, 60.0, 0.0, 400.0), (160.0, 60.0, 0.0, 400.0), (260.0, 180.0, 0.0, -400.0)
    events, labels, models, t_ref = window(down, alike, up)
    tracker.assign(events, labels, models, t_ref)
    known = {tuple(known.model.params): known for known in tracker.motions()}
    assert [motion.t for motion in known.values()] == [t_ref] * 2
    places = known[0.0, 400.0].places
    own = np.flatnonzero((labels == 1) | (labels == 2))  # one motion, of two objects
    assert_some_of(places, places_of(events, own, models[1], t_ref))
    assert 400 <= len(places) <= 800
    places_up = known[0.0, -400.0].places
    assert_some_of(places_up, places_of(events, np.flatnonzero(labels == 3), models[3], t_ref))
    assert 200 <= len(places_up) <= 400
    # What is missed was last seen where and when it was; what goes on is where it is now.
    now = window((60.0, 76.0, 0.0, 350.0), (160.0, 76.0, 0.0, 400.0), t_ref=60_000)
    tracker.assign(*now)
    later = {tuple(known.model.params): known for known in tracker.motions()}
    assert {velocity: motion.t for velocity, motion in later.items()} == {
        (0.0, 350.0): 60_000,
        (0.0, 400.0): 60_000,
        (0.0, -400.0): t_ref,
    }
    np.testing.assert_array_equal(later[0.0, -400.0].places, places_up)
    for label, velocity in ((1, (0.0, 350.0)), (2, (0.0, 400.0))):
        own = np.flatnonzero(now[1] == label)
        assert_some_of(later[velocity].places, places_of(now[0], own, now[2][label], 60_000))


def test_one_motion_of_two_times_is_known_of_both() -> None:
    tracker = Tracker(320, 240)
    first, second = (60.0, 60.0, 0.0, 300.0), (260.0, 60.0, 0.0, 300.0)
    assign(tracker, first, second)
    assign(tracker, (60.0, 72.0, 0.0, 300.0), t_ref=60_000)
    before, now = sorted(tracker.motions(), key=lambda known: known.t)
    assert (before.t, now.t) == (20_000, 60_000)
    assert before.model.native() == now.model.native()
    assert before.places[:, 0].min() > 200
    assert now.places[:, 0].max() < 100


def test_places_are_on_the_image_plane_of_a_camera() -> None:
    camera = Camera(320, 240, fx=250, fy=260, cx=150, cy=130, distortion=(-0.3, 0.1, 0, 0))
    tracker = Tracker(320, 240, camera)
    events, labels, models, t_ref = window((60.0, 60.0, 0.0, 400.0))
    tracker.assign(events, labels, models, t_ref)
    (known,) = tracker.motions()
    own = np.flatnonzero(labels == 1)
    seen = np.column_stack([events.x[own], events.y[own]])
    shown = reference_camera(camera).undistort(seen)
    assert np.linalg.norm(shown - seen, axis=1).min() > 1
    dt = (events.t[own] - t_ref) * 1e-6
    assert_some_of(known.places, shown - dt[:, None] * models[1].params)
    assert known.t == t_ref


def test_what_has_not_moved_has_no_places(told: ToldTracker) -> None:
    """Nor is it known; once it has, it is where it was then."""
    tracker = told([-3.0, 6.0])
    standing = (100.0, 60.0, 50.0, 0.0)
    assign(tracker, standing)
    assert tracker.motions() == []
    events, labels, models, t_ref = window(standing, t_ref=60_000)
    tracker.assign(events, labels, models, t_ref)
    (known,) = tracker.motions()
    assert_some_of(known.places, places_of(events, np.flatnonzero(labels == 1), models[1], t_ref))


@pytest.mark.parametrize(("later", "known"), [(tracking.MEMORY_US, 1), (tracking.MEMORY_US + 1, 0)])
def test_motions_are_forgotten_with_their_objects(later: int, known: int) -> None:
    tracker = Tracker(320, 240)
    assign(tracker, (100.0, 60.0, 1.0, 0.0), t_ref=0)
    assign(tracker, t_ref=later)
    assert len(tracker.motions()) == known


@pytest.mark.parametrize(
    ("logits", "known"),
    [([3.0], 1), ([-3.0], 0), ([3.0, -1.0], 1), ([3.0, -5.0], 0)],
    ids=["moves", "stands", "doubted", "refuted"],
)
def test_only_motions_of_what_is_held_to_move_are_known(
    told: ToldTracker, logits: list[float], known: int
) -> None:
    tracker = told(logits)
    for k in range(len(logits)):
        assign(tracker, (100 + 2.0 * k, 60.0, 50.0, 0.0), t_ref=20_000 + 40_000 * k)
    assert len(tracker.motions()) == known


def test_a_window_without_events_has_no_objects() -> None:
    nothing = EventArray([], [], [], [], width=320, height=240)
    found = Tracker(320, 240).assign(nothing, np.empty(0, np.int32), [MotionModel("translation", label=0)], 0)
    assert len(found.labels) == len(found.parts) == 0
    assert [model.label for model in found.models] == [0]
    assert found.flows == []
