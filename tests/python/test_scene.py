"""What stands still and what moves: parts, the flow of all that is still, and the classifiers' answers."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import emseg
from emseg import EventArray, MotionModel
from emseg.scene import (
    STILL,
    Part,
    Perceptron,
    Window,
    ambiguity,
    appearance,
    choose_background,
    find_parts,
    firmness,
    moving_logits,
    parallax_doubt,
    still_motion,
)

WIDTH, HEIGHT = 320, 240
ROWS, COLUMNS = 15, 20  # tiles of 16 px


def events_at(places: np.ndarray, t: np.ndarray | None = None, *, size: tuple[int, int]) -> EventArray:
    times = np.arange(len(places)) if t is None else t
    signs = np.zeros(len(places), np.uint8)
    return EventArray(*np.rint(places).astype(np.int64).T, times, signs, width=size[0], height=size[1])


def no_loss(*_: object) -> list[float]:
    raise AssertionError("nothing is held against another motion here")


def test_tiles_belong_to_who_has_most_of_their_events() -> None:
    """Four tiles of a sensor of 40 x 20: 16, 16 and 8 px wide, 16 and 4 high."""
    places = [(3, 3)] * 5 + [(4, 9)] * 6 + [(20, 3)] * 4 + [(39, 19)] * 3 + [(3, 18)] * 2
    events = events_at(np.array(places), size=(40, 20))
    first = np.r_[0:5, 11:15, 18:20]  # five in the first tile, four in the second, two below
    second = np.r_[5:11, 15:18]  # six in the first, three in the last
    groups = [(first, MotionModel("translation", label=0)), (second, MotionModel("translation", label=1))]
    a, b = find_parts(events, groups)
    assert a.tiles.tolist() == [[False, True, False], [False, False, False]]  # two events make no tile
    assert b.tiles.tolist() == [[True, False, False], [False, False, True]]
    assert (a.area, b.area) == (1 / 6, 2 / 6)
    assert a.box == (3.0, 3.0, 20.0, 18.0)
    assert b.centre == ((4 + 39) / 2, (9 + 19) / 2)


@pytest.mark.parametrize("count", [1, 10])
def test_parts_of_a_few_events(count: int) -> None:
    events = events_at(np.full((count, 2), 7), size=(40, 20))
    (part,) = find_parts(events, [(np.arange(count), STILL)])
    assert part.tiles.sum() == (count > 2)
    assert part.box == (7.0, 7.0, 7.0, 7.0)


@pytest.mark.parametrize(
    "model",
    [
        MotionModel("translation", (120.0, -80.0)),
        MotionModel("similarity", (120.0, -80.0, 0.4, -0.7)),
        MotionModel("affine", (50.0, 20.0, 0.3, -0.2, 0.5, 0.1)),
        MotionModel("homography", (50.0, 20.0, 0.3, -0.2, 0.5, 0.1, 0.6, -0.4)),
    ],
    ids=lambda model: model.kind,
)
@pytest.mark.parametrize(
    "camera",
    [None, emseg.Camera(WIDTH, HEIGHT, fx=250, fy=260, cx=150, cy=130, distortion=(-0.3, 0.1, 0, 0))],
    ids=["plain", "camera"],
)
def test_displacements_are_where_warps_bring_events_from(
    model: MotionModel, camera: emseg.Camera | None
) -> None:
    places = np.array([[0.0, 0.0], [100.0, 30.0], [319.0, 239.0]])
    window = Window(events_at(np.zeros((1, 2)), size=(WIDTH, HEIGHT)), 0.04, no_loss, camera)
    # An event as much before the reference time as another after it.
    both = events_at(np.tile(places, (2, 1)), np.repeat([0, 40_000], 3), size=(WIDTH, HEIGHT))
    moved = emseg.warp(both, model, 20_000, camera=camera)
    many = window.displacements(model, places)
    np.testing.assert_allclose(many, moved[:3] - moved[3:], atol=1e-3)
    for place, displacement in zip(places, many, strict=True):
        np.testing.assert_array_equal(window.displacement(model, *place), displacement)


def tiles_part(model: MotionModel, rows: slice, columns: slice) -> Part:
    tiles = np.zeros((ROWS, COLUMNS), bool)
    tiles[rows, columns] = True
    return Part(np.arange(100), model, tiles, (0.0, 0.0, 0.0, 0.0))


def flow_of(params: tuple[float, ...], place: np.ndarray) -> np.ndarray:
    """Planar flow, px/s: linear, and second order over the sensor's longer side."""
    x, y = place[:, 0] - (WIDTH - 1) / 2, place[:, 1] - (HEIGHT - 1) / 2
    vx, vy, a, b, c, d, g, h = params
    perspective = (g * x + h * y) / WIDTH
    return np.stack([vx + a * x + b * y + perspective * x, vy + c * x + d * y + perspective * y], axis=-1)


def planar_parts(params: tuple[float, ...]) -> list[Part]:
    """Parts of three by four tiles, each with the translation that a planar motion has in its middle."""
    parts = []
    for row in range(0, ROWS, 3):
        for column in range(0, COLUMNS, 4):
            middle = np.array([[(column + 2) * 16.0, (row + 1.5) * 16.0]])
            velocity = flow_of(params, middle)[0].tolist()
            parts.append(
                tiles_part(
                    MotionModel("translation", velocity), slice(row, row + 3), slice(column, column + 4)
                )
            )
    return parts


PLANAR = (200.0, -100.0, 0.8, -0.5, 0.6, 0.9, 0.7, -0.6)


def worst_error(
    parts: list[Part],
    params: tuple[float, ...],
    ambiguous: list[float] | None = None,
    firm: list[float] | None = None,
) -> float:
    """Of the flow found over the middle of the view, px over a window of 40 ms."""
    window = Window(events_at(np.zeros((1, 2)), size=(WIDTH, HEIGHT)), 0.04, no_loss)
    found = still_motion(parts, window, ambiguous or [0.0] * len(parts), firm or [1.0] * len(parts))
    assert found.kind == "homography"
    places = np.stack(np.meshgrid([60.0, 160.0, 260.0], [60.0, 120.0, 180.0]), axis=-1).reshape(-1, 2)
    expected = flow_of(params, places) * window.duration
    return float(np.linalg.norm(window.displacements(found, places) - expected, axis=1).max())


def test_still_motion_is_the_planar_motion_of_its_parts() -> None:
    assert (
        np.linalg.norm(flow_of(PLANAR, np.array([[60.0, 60.0]])) - PLANAR[:2]) * 0.04 > 4
    )  # far from uniform
    assert worst_error(planar_parts(PLANAR), PLANAR) < 0.5


def test_one_false_part_hardly_bends_the_motion_of_the_others() -> None:
    parts = planar_parts(PLANAR)
    true = worst_error(parts, PLANAR)
    false = MotionModel("translation", (-2000.0, 3000.0))  # 144 px over the window
    parts[7] = Part(parts[7].own, false, parts[7].tiles, parts[7].box)
    assert worst_error(parts, PLANAR) < true + 0.25


def stripes(*motions: tuple[float, float], period: int) -> list[Part]:
    """Columns of tiles of one translation each, in turn: the last of a period is the last motion's."""
    models = [MotionModel("translation", velocity) for velocity in motions]
    return [
        tiles_part(models[min(column % period, len(models) - 1)], slice(0, ROWS), slice(column, column + 1))
        for column in range(COLUMNS)
    ]


def test_along_an_ambiguous_motion_the_other_parts_have_the_say() -> None:
    """Two thirds of the view seem to go 36 px along the columns, where 1.2 px are true."""
    true, false = (0.0, 30.0), (0.0, 900.0)
    parts = stripes(true, false, false, period=3)
    doubted = [float(part.model.params[1] == 900) for part in parts]
    planar = (*true, *[0.0] * 6)
    assert worst_error(parts, planar, doubted) < 0.5
    assert worst_error(parts, planar) > 5


def test_across_their_motions_ambiguous_parts_count_in_full() -> None:
    """Edges along the columns say that nothing goes across them, those along the rows the like."""
    parts = stripes((0.0, 900.0), (-900.0, 0.0), period=2)
    assert worst_error(parts, (0.0,) * 8, [1.0] * len(parts)) < 0.5
    assert worst_error(parts, (0.0,) * 8) > 5


def test_firm_parts_have_the_say() -> None:
    """Two thirds of the view seem to go 36 px down, but hardly hold to that."""
    parts = stripes((0.0, 30.0), (0.0, 900.0), (0.0, 900.0), period=3)
    firm = [1.0 if part.model.params[1] == 30 else 0.1 for part in parts]
    planar = (0.0, 30.0, *[0.0] * 6)
    assert worst_error(parts, planar, firm=firm) < 0.5
    assert worst_error(parts, planar) > 5


def test_where_all_are_as_firm_it_does_not_matter_how_firm() -> None:
    window = Window(events_at(np.zeros((1, 2)), size=(WIDTH, HEIGHT)), 0.04, no_loss)
    parts = planar_parts(PLANAR)
    sure = [0.0] * len(parts)
    firm, loose = (still_motion(parts, window, sure, [value] * len(parts)) for value in (1.0, 0.1))
    np.testing.assert_allclose(loose.params, firm.params, rtol=1e-9)


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
