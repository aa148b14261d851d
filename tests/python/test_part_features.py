"""What is measured of a window's parts, natively, against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage

import emseg
from emseg import Camera, EventArray, MotionModel, _core
from emseg.motion import warp_frame, warp_some

WIDTH, HEIGHT = 70, 50


def random_events(seed: int, count: int) -> EventArray:
    rng = np.random.default_rng(seed)
    # Squared, so that some places have most of the events.
    x, y = ((rng.random(count) ** 2 * side).astype(np.uint16) for side in (WIDTH, HEIGHT))
    t = np.sort(rng.integers(0, 50_000, count))
    return EventArray(x, y, t, rng.integers(0, 2, count), width=WIDTH, height=HEIGHT)


def columns(events: EventArray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return events.x, events.y, events.t


counts = st.integers(1, 400)
seeds = st.integers(0, 2**32 - 1)


# Parts ----------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_components_are_scipys(occupied: np.ndarray) -> None:
    expected, _ = ndimage.label(occupied, structure=np.ones((3, 3)))
    assert np.array_equal(_core.connected_components(occupied), expected - 1)


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
    assert set(_core.connected_components(spiral)[spiral].tolist()) == {0}
    assert (_core.connected_components(spiral)[~spiral] == -1).all()


def numpy_split(places: np.ndarray, gap: int) -> np.ndarray:
    """By the cells of a grid, whose components SciPy finds, column by column."""
    cells = np.floor(places / gap).astype(int)
    cells -= cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0) + 1, bool)
    occupied[tuple(cells.T)] = True
    part = ndimage.label(occupied, structure=np.ones((3, 3)))[0][tuple(cells.T)] - 1
    sizes = np.bincount(part)
    rank = np.empty(len(sizes), int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    rank[sizes < min(max(30, sizes.max() / 25), sizes.max())] = -1
    return rank[part]


@settings(max_examples=150, deadline=None)
@given(seeds, st.integers(1, 9), st.integers(1, 12))
def test_places_are_split_where_cells_of_the_gap_are_empty(seed: int, clumps: int, gap: int) -> None:
    rng = np.random.default_rng(seed)
    middles, sizes = rng.uniform(-90, 90, (clumps, 2)), rng.integers(1, 80, clumps)
    spread = rng.choice([1.0, 6.0, 20.0], clumps)
    places = np.concatenate(
        [m + rng.normal(0, s, (n, 2)) for m, s, n in zip(middles, spread, sizes, strict=True)]
    ).astype(np.float32)
    places = rng.permutation(places)
    np.testing.assert_array_equal(_core.split_apart(places, gap), numpy_split(places, gap))


def test_a_part_of_thirty_is_no_crumb_unless_another_is_far_larger() -> None:
    def clumps(*sizes: int) -> list[int]:
        places = np.repeat(100.0 * np.arange(len(sizes)), sizes)[:, None] * (1.0, 0.0)
        return _core.split_apart(places.astype(np.float32), 10)[np.cumsum(sizes) - 1].tolist()

    assert clumps(40, 30, 29) == [0, 1, -1]
    assert clumps(40, 1000, 39) == [1, 0, -1]
    assert clumps(5, 3) == [0, -1]  # the largest stays, however small
    assert clumps(50, 50) == [0, 1]  # of like size: the left one first


def test_places_far_out_and_undefined_ones_do_no_harm() -> None:
    places = np.array([[0.0, 0.0]] * 40 + [[1e30, -1e30]] * 35 + [[np.nan, 1.0], [np.inf, 0.0]], np.float32)
    assert _core.split_apart(places, 10).tolist() == [0] * 40 + [1] * 35 + [-1, -1]
    assert _core.split_apart(places[-2:], 10).tolist() == [-1, -1]
    assert _core.split_apart(places[:0], 10).tolist() == []
    with pytest.raises(ValueError, match="gap is 0 px, expected above 0"):
        _core.split_apart(places, 0)


@given(arrays(np.int32, st.integers(0, 60), elements=st.integers(-2, 6)), st.integers(0, 5))
def test_positions_of_values_are_where_they_stand(values: np.ndarray, count: int) -> None:
    found = _core.positions_of_values(values, count)
    assert [own.tolist() for own in found] == [np.flatnonzero(values == v).tolist() for v in range(count)]


# Where parts lie ------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(seeds, counts, st.integers(0, 4), st.integers(1, 20))
def test_tiles_are_won_by_most_events(seed: int, count: int, groups: int, side: int) -> None:
    events = random_events(seed, count)
    owner = np.random.default_rng(seed).integers(0, groups + 1, count)
    parts = [np.flatnonzero(owner == g) for g in range(groups)]
    shape = -(-HEIGHT // side), -(-WIDTH // side)
    votes = np.zeros((groups + 2, *shape), int)
    np.add.at(votes, (owner + 1, events.y // side, events.x // side), 1)
    votes[0] = 2  # nobody's
    expected = votes[: groups + 1].argmax(axis=0) - 1
    winners = _core.winners_of_tiles(*columns(events), parts, WIDTH, HEIGHT, side)
    np.testing.assert_array_equal(winners, expected)


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=15)))
def test_the_spread_of_tiles_is_by_their_covariance(held: np.ndarray) -> None:
    if not held.any():
        assert _core.spread_of_tiles(held) == 0
        return
    covariance = np.cov(np.nonzero(held), bias=True) + np.eye(2) / 12
    expected = 12 * np.sqrt(np.linalg.det(covariance)) / held.size
    assert _core.spread_of_tiles(held) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", [(1, 1), (15, 20)])
def test_all_tiles_span_all_of_the_view(shape: tuple[int, int]) -> None:
    assert _core.spread_of_tiles(np.ones(shape, bool)) == pytest.approx(1)


@given(seeds, counts)
def test_inner_boxes_leave_a_fiftieth_out_on_every_side(seed: int, count: int) -> None:
    events = random_events(seed, 2 * count)
    own = np.sort(np.random.default_rng(seed).choice(2 * count, count, replace=False))
    low, high = count // 50, count - 1 - count // 50
    x, y = (np.sort(values[own])[[low, high]].tolist() for values in (events.x, events.y))
    assert _core.inner_box(*columns(events), own, WIDTH, HEIGHT) == (x[0], y[0], x[1], y[1])


@settings(max_examples=200)
@given(seeds, st.integers(1, 2000))
def test_outer_boxes_are_quantiles(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    places = (rng.normal(100, 40, (count, 2)) * (1, 0.5)).astype(np.float32)
    places[rng.random(count) < 0.3] = places[0]  # ties
    expected = np.quantile(places.astype(np.float64), (0.01, 0.99), axis=0).ravel()
    np.testing.assert_allclose(_core.outer_box(places), expected, rtol=1e-12)


def test_outer_boxes_leave_out_what_is_not_finite() -> None:
    places = np.array([[1, 2], [np.nan, 5], [3, 8], [np.inf, -np.inf]], np.float32)
    np.testing.assert_allclose(_core.outer_box(places), (1.02, 2.06, 2.98, 7.94))
    assert _core.outer_box(places[3:]) == (0, 0, 0, 0)


# How parts move -------------------------------------------------------------------------------------------


def numpy_share_gone(events: EventArray, own: np.ndarray, along: np.ndarray) -> float:
    """How much further along the late third's tenth, middle and last but tenth lie than the early third's."""
    speed = np.linalg.norm(along)
    if speed < 5 or len(own) < 30:
        return 0.5
    own = own[np.linspace(0, len(own) - 1, min(len(own), 1500)).astype(int)]
    t, place = events.t[own], np.column_stack([events.x[own], events.y[own]]) @ along / speed
    third = (t[-1] - t[0]) / 3
    early, late = place[t < t[0] + third], place[t > t[-1] - third]
    if min(len(early), len(late)) < 10:
        return 0.5
    gone = np.mean(
        [
            np.quantile(late, q, method="lower") - np.quantile(early, q, method="lower")
            for q in (0.1, 0.5, 0.9)
        ]
    )
    return float(np.clip(gone / (speed * 2 / 3), -0.5, 1.5))


@settings(deadline=None)
@given(seeds, st.integers(1, 3000), st.sampled_from([(0, 0), (3, 4), (30, 0), (-20, 11), (6, -2)]))
def test_how_far_parts_went(seed: int, count: int, along: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 50_000, count))
    moved = rng.uniform(0, 25, (count, 2)) + np.outer(t / 50_000, np.array(along) * rng.uniform(-0.5, 1.5))
    x, y = np.clip(moved + 20, 0, (WIDTH - 1, HEIGHT - 1)).astype(np.uint16).T
    events = EventArray(x, y, t, np.zeros(count, np.uint8), width=WIDTH, height=HEIGHT)
    own = np.flatnonzero(rng.random(count) < 0.8)
    expected = numpy_share_gone(events, own, np.array(along, float))
    assert _core.share_gone(*columns(events), own, *along) == pytest.approx(expected, abs=1e-12)


def test_what_goes_with_its_motion_has_gone_all_of_it_and_what_stays_nothing() -> None:
    t = np.sort(np.random.default_rng(0).integers(0, 50_000, 1200))
    still = np.full(len(t), 20, np.uint16)
    along = (20 + 24 * t / 50_000).astype(np.uint16)
    for x, share in ((along, 1.0), (still, 0.0)):
        gone = _core.share_gone(x, still, t, np.arange(len(t)), 24.0, 0.0)
        assert gone == pytest.approx(share, abs=0.1)


def numpy_beyond(events: EventArray, own: np.ndarray, along: np.ndarray) -> float:
    """By looking up every event, moved on and aside by whole pixels, in the image of all signs."""
    own = own[np.linspace(0, len(own) - 1, min(len(own), 4000)).astype(int)]
    far, signs = 100, 2.0 * events.p[own] - 1
    image = np.zeros((HEIGHT + 2 * far, WIDTH + 2 * far))
    np.add.at(image, (events.y[own] + far, events.x[own] + far), signs)
    length = np.linalg.norm(along)
    ahead = along / length
    aside = np.array([-ahead[1], ahead[0]])

    def met(lag: float, away: float) -> float:
        right, down = np.rint(lag * ahead + away * aside).astype(int) + far
        return float((signs * image[events.y[own] + down, events.x[own] + right]).mean())

    lags = [way * (share * length + 2.5) for way in (-1, 1) for share in (1.3, 1.6, 2.0)]
    return float(np.mean([max(met(lag, away) for away in range(-3, 4)) for lag in lags]))


@settings(deadline=None)
@given(seeds, st.integers(1, 6000), st.sampled_from([(6, 0), (3, 4), (0, -30), (-20, 11)]))
def test_what_parts_meet_beyond_where_they_go(seed: int, count: int, along: tuple[float, float]) -> None:
    events = random_events(seed, count)
    own = np.flatnonzero(np.random.default_rng(seed).random(count) < 0.8)
    found = _core.events_beyond(*columns(events), events.p, own, *along, WIDTH, HEIGHT)
    if len(own):
        assert found == pytest.approx(numpy_beyond(events, own, np.array(along, float)), abs=1e-9)
    else:
        assert found == 0


MODELS = [
    MotionModel("translation", (120.0, -80.0)),
    MotionModel("rotation", (0.4, -0.7, 1.5)),
    MotionModel("similarity", (120.0, -80.0, 0.4, -0.7)),
    MotionModel("affine", (50.0, 20.0, 0.3, -0.2, 0.5, 0.1)),
    MotionModel("homography", (50.0, 20.0, 0.3, -0.2, 0.5, 0.1, 0.6, -0.4)),
]
CAMERA = Camera(WIDTH, HEIGHT, fx=60, fy=58, cx=33, cy=26, distortion=(-0.2, 0.05, 1e-3, -1e-3))


@pytest.mark.parametrize("camera", [None, CAMERA], ids=["plain", "camera"])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_velocities_are_what_warps_take_back(model: MotionModel, camera: Camera | None) -> None:
    """Central differences of the warp by its time, over 20 ms, of floats."""
    x, y = (side.ravel().astype(np.uint16) for side in np.meshgrid([0, 20, 69], [0, 30, 49]))
    n = len(x)
    events = EventArray(
        np.tile(x, 3),
        np.tile(y, 3),
        np.repeat([0, 10_000, 20_000], n),
        np.zeros(3 * n, int),
        width=WIDTH,
        height=HEIGHT,
    )
    early, places, late = emseg.warp(events, model, 10_000, camera=camera).astype(np.float64).reshape(3, n, 2)
    frame = warp_frame(events, camera)
    velocities = _core.image_velocities(*model.native(), frame, places)
    np.testing.assert_allclose(velocities, (early - late) / 0.02, atol=0.02)
    for place, velocity in zip(places, velocities, strict=True):
        assert _core.image_velocity(*model.native(), frame, *place) == tuple(velocity)


@pytest.mark.parametrize("camera", [None, CAMERA], ids=["plain", "camera"])
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_some_events_are_warped_as_all_are(model: MotionModel, camera: Camera | None) -> None:
    events = random_events(1, 300)
    own = np.array([299, 0, 17, 17, 250])
    warped = warp_some(events, own, model, 20_000, camera=camera)
    assert warped.dtype == np.float32
    np.testing.assert_array_equal(warped, emseg.warp(events, model, 20_000, camera=camera)[own])
    assert warp_some(events, own[:0], model, 0, camera=camera).shape == (0, 2)


# What is no part ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("position", [-1, 10])
def test_positions_that_are_no_events_are_refused(position: int) -> None:
    events, own = random_events(2, 10), np.array([3] * 30 + [position])
    for refuse in (
        lambda: warp_some(events, own, MODELS[0], 0),
        lambda: _core.inner_box(*columns(events), own, WIDTH, HEIGHT),
        lambda: _core.winners_of_tiles(*columns(events), [own], WIDTH, HEIGHT, 16),
        lambda: _core.share_gone(*columns(events), own, 9.0, 0.0),
        lambda: _core.events_beyond(*columns(events), events.p, own, 9.0, 0.0, WIDTH, HEIGHT),
    ):
        with pytest.raises(ValueError, match=f"position {position}, expected one of 10 events"):
            refuse()


def test_other_senseless_calls_are_refused() -> None:
    events, own = random_events(2, 10), np.arange(10)
    off = np.full(10, 99, np.uint16), events.y, events.t
    for refuse, message in (
        (lambda: _core.inner_box(*columns(events), own[:0], WIDTH, HEIGHT), "no events"),
        (lambda: _core.inner_box(*off, own, WIDTH, HEIGHT), "event 0 is outside the sensor"),
        (lambda: _core.winners_of_tiles(*off, [own], WIDTH, HEIGHT, 16), "event 0 is outside the sensor"),
        (lambda: _core.winners_of_tiles(*columns(events), [], WIDTH, HEIGHT, 0), "0 px wide"),
        (lambda: _core.winners_of_tiles(events.x[:9], *off[1:], [], WIDTH, HEIGHT, 16), "9, 10, 10"),
        (lambda: _core.outer_box(np.zeros((4, 3), np.float32)), "second of length 2"),
        (lambda: _core.spread_of_tiles(np.zeros(4, bool)), "1 dimensions, expected 2"),
        (lambda: _core.positions_of_values(np.zeros(4, np.int32), -1), "count is -1"),
    ):
        with pytest.raises(ValueError, match=message):
            refuse()
