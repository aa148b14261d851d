"""What stands still and what moves: features of parts, and the classifiers' answers."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from windows_of_parts import HEIGHT, ROWS, WIDTH, events_at, no_loss

import emseg
from emseg import EventArray, MotionModel
from emseg.parts import Part, Window, find_parts
from emseg.scene import (
    STILL,
    Perceptron,
    ambiguity,
    appearance,
    choose_background,
    firmness,
    moving_logits,
    parallax_doubt,
)


def test_a_perceptron_by_hand() -> None:
    network = Perceptron(
        mean=np.array([1.0, 2.0]),
        scale=np.array([2.0, 4.0]),
        hidden=np.array([[1.0, -1.0], [0.5, 2.0]]),
        bias=np.array([0.25, -0.5]),
        out=np.array([3.0, -2.0]),
        level=0.75,
    )
    # (3, 4) is (1, 1/2) in standard units: 1 + 1/4 + 1/4 and -1 + 1 - 1/2.
    expected = 3 * np.tanh(1.5) - 2 * np.tanh(-0.5) + 0.75
    middle = 3 * np.tanh(0.25) - 2 * np.tanh(-0.5) + 0.75
    np.testing.assert_allclose(network(np.array([[3.0, 4.0], [1.0, 2.0]])), [expected, middle])


def looks(*, speed: float = 0.0, went: float = 1.0, across: float = 2.0) -> np.ndarray:
    """The appearance of a part as far as its ambiguity goes: px, share, px over the window."""
    features = np.zeros(15)
    features[[7, 8, 12]] = speed / 10, went, across
    return features


AMBIGUOUS = looks(speed=30.0, went=0.0, across=0.0)

shares, pixels = st.floats(-0.5, 1.5), st.floats(0, 30)


@settings(max_examples=100)
@given(st.lists(st.builds(looks, speed=pixels, went=shares, across=st.floats(0, 2)), min_size=1, max_size=5))
def test_only_what_is_fast_along_an_axis_and_does_not_go_is_ambiguous(own: list[np.ndarray]) -> None:
    doubt = ambiguity(np.array(own))
    assert doubt.shape == (len(own),)
    assert ((doubt >= 0) & (doubt <= 1)).all()
    for features, value in zip(own, doubt, strict=True):
        speed, went, across = features[7] * 10, features[8], features[12]
        # Surely not.
        for change in ({"speed": 2.0}, {"went": 0.9}, {"across": 2.0}):
            assert ambiguity(looks(**{"speed": speed, "went": went, "across": across, **change})[None]) == 0
        # Faster, less gone, nearer to an axis: no less ambiguous.
        for change in ({"speed": speed + 3}, {"went": went - 0.2}, {"across": across / 2}):
            more = ambiguity(looks(**{"speed": speed, "went": went, "across": across, **change})[None])
            assert more >= value
    assert ambiguity(AMBIGUOUS[None]) == 1


@pytest.mark.parametrize(("goes", "ambiguous"), [(True, False), (False, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_edge_that_stays_is_ambiguous_and_one_that_goes_is_not(
    axis: int, goes: bool, ambiguous: bool
) -> None:
    """25 px along a column or a row of pixels within 50 ms, by what the motion says."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.integers(0, 50_000, 900))
    places = np.empty((900, 2))
    places[:, axis] = rng.uniform(90, 150, 900) + (500e-6 * t if goes else 0.0)
    places[:, 1 - axis] = rng.uniform(100, 102, 900)
    events = events_at(places, t, size=(WIDTH, HEIGHT))
    velocity = (500.0, 0.0) if axis == 0 else (0.0, 500.0)
    (part,) = find_parts(events, [(np.arange(900), MotionModel("translation", velocity))])
    window = Window(events, 0.05, lambda *_: [0.5])
    assert ambiguity(appearance(part, window)[None])[0] == float(ambiguous)


@pytest.mark.parametrize(
    ("lost", "firm"),
    [(-0.2, 0.01), (0.0, 0.01), (0.005, 0.01), (0.0125, 0.0625), (0.025, 0.25), (0.05, 1.0), (3.0, 1.0)],
)
@pytest.mark.parametrize("speed", [0.0, 19.0], ids=["stands", "creeps"])
def test_firmness_by_hand(speed: float, lost: float, firm: float) -> None:
    """Of what goes less than a pixel: by the mean loss of motions 4 px off, full from 0.05 nats on."""
    events = events_at(np.full((50, 2), 30), size=(WIDTH, HEIGHT))
    model = MotionModel("translation", (0.0, speed))
    (part,) = find_parts(events, [(np.arange(50), model)])

    def loss(
        own: EventArray, first: MotionModel, other: MotionModel, offsets: list[tuple[float, float]]
    ) -> list[float]:
        assert (len(own), first, other) == (50, model, model)
        np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 4.0)
        assert len({(round(x, 6), round(y, 6)) for x, y in offsets}) == 8
        return [lost + x for x, _ in offsets]  # which cancel

    assert firmness(part, Window(events, 0.05, loss)) == pytest.approx(firm)


@pytest.mark.parametrize("velocity", [(21.0, 0.0), (0.0, -21.0), (-600.0, 400.0)])
def test_what_moves_in_the_image_is_firm(velocity: tuple[float, float]) -> None:
    events = events_at(np.full((50, 2), 30), size=(WIDTH, HEIGHT))
    (part,) = find_parts(events, [(np.arange(50), MotionModel("translation", velocity))])
    assert firmness(part, Window(events, 0.05, no_loss)) == 1


FIRM = np.ones(3)


def test_the_background_is_large_and_likely_still() -> None:
    areas, own = [10 / ROWS, 4 / ROWS, 5 / 300], np.array([looks()] * 3)  # the last under 3 % of the view
    assert choose_background(areas, own, np.array([-3.0, -3.0, -9.0]), FIRM) == 0
    assert choose_background(areas, own, np.array([0.9, -3.0, -9.0]), FIRM) == 1  # .29 √10 < .95 √4
    assert (
        choose_background(areas, own, np.array([2.0, 3.0, -9.0]), FIRM) is None
    )  # neither likely stands still
    assert choose_background([], np.empty((0, 15)), np.empty(0), FIRM[:0]) is None


def test_the_background_is_rather_not_ambiguous() -> None:
    surely = np.array([-3.0, -3.0])
    assert choose_background([0.3, 0.2], np.array([looks(), looks()]), surely, FIRM[:2]) == 0
    assert choose_background([0.3, 0.2], np.array([AMBIGUOUS, looks()]), surely, FIRM[:2]) == 1
    assert choose_background([0.3, 0.2], np.array([AMBIGUOUS, AMBIGUOUS]), surely, FIRM[:2]) == 0
    assert choose_background([0.3], AMBIGUOUS[None], surely[:1], FIRM[:1]) == 0  # better than nothing


def test_the_background_is_rather_firm() -> None:
    surely, own = np.array([-3.0, -3.0]), np.array([looks(), looks()])
    assert choose_background([0.3, 0.2], own, surely, np.array([0.5, 1.0])) == 1
    assert choose_background([0.3, 0.2], own, surely, np.array([0.9, 1.0])) == 0  # .9 √.3 > √.2
    assert choose_background([0.3, 0.2], own, surely, np.array([0.01, 0.01])) == 0
    assert choose_background([0.3], own[:1], surely[:1], np.array([0.01])) == 0  # better than nothing


@settings(max_examples=50)
@given(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_any_logit_will_do(logits: list[float]) -> None:
    chosen = choose_background(
        [0.2, 0.4, 0.6], np.array([looks(), AMBIGUOUS, looks()]), np.array(logits), FIRM
    )
    assert (chosen is None) == (min(logits) > np.log(3) + 1e-9)


def test_parallax_is_doubted_as_far_as_the_camera_moves() -> None:
    apart, along = np.array([0.0, 1.0, 3.0, 4.0, 9.0]), np.array([5.0, 5.0, 0.5, 5.0, 5.0])
    against = np.zeros((5, 12))
    against[:, 3], against[:, 4] = apart / 10, along / 10
    assert np.allclose(parallax_doubt(against), [8, 6, 1, 0, 0])  # 2 for every px below 4
    against[:, 4] = 0  # what moves before a camera that stands still is no parallax
    assert not parallax_doubt(against).any()


# Whole windows --------------------------------------------------------------------------------------------


@cache
def plane_and_patch(*, camera_speed: float = 150.0) -> tuple[EventArray, np.ndarray]:
    """50 ms of a plane of points that the camera passes, and of a patch before it that goes its own way."""
    rng = np.random.default_rng(1)
    points = rng.uniform((-20, -20), (WIDTH + 20, HEIGHT + 20), (700, 2))
    points = points[(np.abs(points - (200, 120)) > 34).any(axis=1)]
    patch = rng.uniform((172, 92), (228, 148), (120, 2))
    label = np.repeat([0, 1], [15_000, 4_000])
    t = rng.integers(0, 50_000, len(label))
    order = np.argsort(t, kind="stable")
    label, t = label[order], t[order]
    point = np.where(label == 0, rng.integers(0, len(points), len(t)), rng.integers(0, 120, len(t)))
    start = np.concatenate([points, patch])[point + label * len(points)]
    velocity = np.array([(camera_speed, 40.0), (-160.0, 170.0)])[label]
    place = np.rint(start + velocity * ((t - 25_000) * 1e-6)[:, None])
    inside = ((place >= 0) & (place < (WIDTH, HEIGHT))).all(axis=1)
    events = EventArray(
        *place[inside].astype(np.int64).T, t[inside], point[inside] % 2, width=WIDTH, height=HEIGHT
    )
    return events, label[inside]


def window_of(events: EventArray) -> Window:
    segmenter = emseg.Segmenter(events.width, events.height)
    seconds = events.duration * 1e-6
    return Window(events, seconds, partial(segmenter.motion_losses, t_ref=25_000, duration=seconds))


def judge(
    events: EventArray, groups: list[tuple[np.ndarray, MotionModel]]
) -> tuple[list[Part], np.ndarray, Part | None, MotionModel]:
    parts = find_parts(events, groups)
    return parts, *moving_logits(parts, window_of(events))


def test_a_patch_moves_before_a_plane_that_stands_still() -> None:
    events, truth = plane_and_patch()
    models = [MotionModel("translation", (150.0, 40.0), 0), MotionModel("translation", (-160.0, 170.0), 1)]
    groups = [(np.flatnonzero(truth == k), models[k]) for k in (0, 1)]
    parts, logits, background, still = judge(events, groups)
    assert background is parts[0]
    assert logits[0] < 0 < logits[1]
    window = Window(events, 0.05, no_loss)
    np.testing.assert_allclose(window.displacement(still, 160, 120), (7.5, 2.0), atol=0.1)


def test_what_lies_where_objects_are_expected_is_not_the_background() -> None:
    events, truth = plane_and_patch()
    models = [MotionModel("translation", (150.0, 40.0), 0), MotionModel("translation", (-160.0, 170.0), 1)]
    left = (truth == 0) & (events.x < 200)
    groups = [(np.flatnonzero(left), models[0]), (np.flatnonzero((truth == 0) & ~left), models[0])]
    parts = find_parts(events, [*groups, (np.flatnonzero(truth == 1), models[1])])
    window = window_of(events)
    nowhere = np.zeros_like(parts[0].tiles)
    assert moving_logits(parts, window, nowhere)[1] is parts[0]
    assert moving_logits(parts, window, parts[0].tiles)[1] is parts[1]


def test_points_that_lie_still_are_firm_and_noise_is_not() -> None:
    rng = np.random.default_rng(4)
    t = np.sort(rng.integers(0, 50_000, 6000))
    points = rng.uniform((0, 0), (WIDTH - 1, HEIGHT - 1), (300, 2))[rng.integers(0, 300, len(t))]
    noise = rng.uniform((0, 0), (WIDTH - 1, HEIGHT - 1), (len(t), 2))
    firm = []
    for places in (points, noise):
        events = events_at(places, t, size=(WIDTH, HEIGHT))
        (part,) = find_parts(events, [(np.arange(len(t)), STILL)])
        firm.append(firmness(part, window_of(events)))
    assert firm[0] == 1
    assert firm[1] < 0.1


def test_a_part_of_the_plane_that_was_cut_off_stands_still() -> None:
    events, truth = plane_and_patch()
    plane = MotionModel("translation", (150.0, 40.0), 0)
    thing = MotionModel("translation", (-160.0, 170.0), 1)
    corner = (truth == 0) & (events.x < 80) & (events.y < 80)
    groups = [(np.flatnonzero((truth == 0) & ~corner), plane), (np.flatnonzero(corner), plane)]
    groups.append((np.flatnonzero(truth == 1), thing))
    _, logits, _, _ = judge(events, groups)
    assert logits[1] < 0 < logits[2]


def test_the_segmenter_says_the_same() -> None:
    events, truth = plane_and_patch()
    found = emseg.Segmenter(WIDTH, HEIGHT).segment(events)
    assert emseg.evaluate(truth, found.labels)["moving_iou_deployed"] > 0.9


@pytest.mark.parametrize("count", [1, 2, 29])
def test_parts_of_a_few_events_are_judged_without_harm(count: int) -> None:
    events, truth = plane_and_patch()
    plane, few = np.flatnonzero(truth == 0), np.flatnonzero(truth == 1)[:count]
    models = [MotionModel("translation", (150.0, 40.0), 0), MotionModel("translation", (-160.0, 170.0), 1)]
    parts, logits, background, _ = judge(events, [(plane, models[0]), (few, models[1])])
    assert background is parts[0]
    assert np.isfinite(logits).all()


def test_a_window_without_events_has_no_parts() -> None:
    nothing = EventArray([], [], [], [], width=WIDTH, height=HEIGHT)
    assert find_parts(nothing, []) == []
    logits, background, still = moving_logits([], Window(nothing, 1e-6, no_loss))
    assert (len(logits), background) == (0, None)
    assert still == STILL
    found = emseg.Segmenter(WIDTH, HEIGHT).segment(nothing)
    assert len(found.labels) == 0
    assert [model.label for model in found.models] == [0]
