"""One motion of the camera past layers that stand still: found again from points in space, and doubted by."""

from __future__ import annotations

import numpy as np
import pytest
from engine_and_reference import real
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import emseg
from emseg import EventArray, MotionModel
from emseg.layers import layer_doubt
from emseg.parts import Part, Window
from emseg.rigid_motion import RigidMotion, doubt_of_layers, fit_rigid_motion, layers_of

FOCAL_LENGTH = 240.0
SIDEWAYS, UP, AHEAD = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)


def seen(
    direction: tuple[float, ...],
    depths: np.ndarray,
    *,
    turn: tuple[float, float, float] = (0, 0, 0),
    distance: float = 0.01,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Places (p, 3, 2) and flows of points at the depths (p,), m, as a pinhole camera's two images have them.

    The camera moves by `distance`, m, in the direction; the scene turns about its axes by `turn`, px.
    """
    rng = np.random.default_rng(seed)
    places = rng.uniform((-100, -70), (100, 70), (len(depths), 1, 2)) + rng.uniform(
        -20, 20, (len(depths), 3, 2)
    )
    rays = np.concatenate([places / FOCAL_LENGTH, np.ones((len(depths), 3, 1))], axis=-1)
    points = rays * depths[:, None, None] - distance * np.array(direction)
    wx, wy, wz = np.array(turn) / FOCAL_LENGTH
    points = points + points @ np.array([[0, -wz, wy], [wz, 0, -wx], [-wy, wx, 0]]).T
    return places, points[..., :2] / points[..., 2:] * FOCAL_LENGTH - places


def unit(vector: tuple[float, ...]) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


DEPTHS = np.array([2.0, 0.9, 0.5, 1.3, 0.35, 0.7])


@pytest.mark.parametrize(
    "direction", [SIDEWAYS, UP, (-0.8, 0.6, 0.0), (0.6, 0.5, 0.6), (0.7, -0.2, -0.5), AHEAD, (0, 0, -1.0)]
)
def test_directions_and_depths_are_found_again(direction: tuple[float, ...]) -> None:
    places, flows = seen(direction, DEPTHS, distance=0.02)
    motion = fit_rigid_motion(places, flows, np.ones(6), FOCAL_LENGTH)
    assert motion.direction @ unit(direction) > np.cos(np.radians(3))
    np.testing.assert_allclose(motion.rotation, 0, atol=0.15)
    assert motion.errors.max() < 0.15
    assert motion.misfit < 0.01
    if direction[2] == 0:  # else the second image is nearer or farther
        np.testing.assert_allclose(motion.depths, FOCAL_LENGTH * 0.02 / DEPTHS, rtol=0.05)


def test_a_little_rotation_is_told_from_the_translation() -> None:
    """A scene that turns one way is a camera that turns the other; what is expected is that it does not."""
    places, flows = seen(SIDEWAYS, DEPTHS, turn=(1.5, 0, 1.0), distance=0.02)
    motion = fit_rigid_motion(places, flows, np.ones(6), FOCAL_LENGTH)
    assert -1.5 < motion.rotation[0] < -0.5
    assert -1.0 < motion.rotation[2] < -0.3
    assert motion.errors.max() < 1
    assert motion.direction[0] > 0.95


@pytest.mark.parametrize("own", [(0.0, 9.0), (9.0, 0.0), (4.0, -8.0)])
def test_what_goes_its_own_way_is_not_explained(own: tuple[float, float]) -> None:
    """Across the others, or the way that the camera goes itself, which nothing does that stands still."""
    places, flows = seen(SIDEWAYS, DEPTHS, distance=0.02)
    flows[3] = own
    motion = fit_rigid_motion(places, flows, np.ones(6), FOCAL_LENGTH)
    others = np.delete(motion.errors, 3)
    assert motion.errors[3] > 3
    assert others.max() < 1
    assert motion.direction[0] > 0.97


def test_a_part_that_counts_much_is_explained_before_many_that_do_not() -> None:
    places, flows = seen(SIDEWAYS, DEPTHS, distance=0.02)
    flows[4:] = (0.0, 12.0)
    motion = fit_rigid_motion(places, flows, np.array([1, 1, 1, 1, 0.01, 0.01]), FOCAL_LENGTH)
    assert motion.direction[0] > 0.98
    assert motion.errors[4:].min() > 5


@settings(max_examples=40, deadline=None)
@given(angle=st.floats(0, 2 * np.pi), heading=st.floats(0, 2 * np.pi), seed=st.integers(0, 1000))
def test_a_turned_image_gives_the_turned_motion(angle: float, heading: float, seed: int) -> None:
    """Of a camera that moves to the side, at any angle to its rows of pixels."""
    places, flows = seen((np.cos(heading), np.sin(heading), 0.0), DEPTHS, distance=0.02, seed=seed)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    one, other = (
        fit_rigid_motion(a, b, np.ones(6), FOCAL_LENGTH)
        for a, b in ((places, flows), (places @ turn.T, flows @ turn.T))
    )
    np.testing.assert_allclose(one.direction[:2] @ turn.T, other.direction[:2], atol=0.02)
    np.testing.assert_allclose(one.depths, other.depths, rtol=0.02)
    assert other.misfit == pytest.approx(one.misfit, abs=1e-4)


def test_nothing_that_moves_is_no_motion() -> None:
    motion = fit_rigid_motion(np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.ones(2), FOCAL_LENGTH)
    assert np.linalg.norm(motion.direction) == pytest.approx(1)
    assert (motion.misfit, motion.depths.tolist()) == (0, [0, 0])


def test_no_parts_are_refused() -> None:
    with pytest.raises(ValueError, match="places has no parts, expected at least one"):
        fit_rigid_motion(np.zeros((0, 3, 2)), np.zeros((0, 3, 2)), np.ones(0), FOCAL_LENGTH)


# Layers ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("depths", "layers"),
    [
        ([], []),
        ([4.0], [4.0]),
        ([3.0, 4.4], [3.7]),  # 1.5 px tell two apart,
        ([3.0, 4.6], [3.0, 4.6]),
        ([20.0, 25.0], [22.5]),  # or 22 hundredths
        ([20.0, 26.0], [20.0, 26.0]),
        ([12.9, 3.2, 6.5, 8.4, 7.5, 9.9], [3.2, 7.0, 9.15, 12.9]),  # no chain of near ones is one layer
    ],
)
def test_layers_by_hand(depths: list[float], layers: list[float]) -> None:
    np.testing.assert_allclose(layers_of(np.array(depths)), layers)


@given(st.lists(st.floats(-5, 60), max_size=12), st.randoms())
def test_layers_hold_what_lies_in_them(depths: list[float], random: object) -> None:
    layers = layers_of(np.array(depths))
    assert len(layers) <= len(depths)
    assert (np.diff(layers) > 0).all()
    for depth in depths:
        assert np.abs(layers - depth).min() <= max(1.5, 0.22 * depth) + 1e-9
    random.shuffle(depths)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(layers_of(np.array(depths)), layers)


# Doubt ----------------------------------------------------------------------------------------------------


def found(
    depths: list[float],
    *,
    errors: list[float] | None = None,
    direction: tuple[float, ...] = SIDEWAYS,
    misfit: float = 0.0,
) -> RigidMotion:
    wrong = np.array(errors) if errors else np.zeros(len(depths))
    return RigidMotion(unit(direction), np.zeros(3), np.array(depths), wrong, misfit)


def doubts(motion: RigidMotion, *, area: float = 0.2, clear: list[bool] | None = None) -> list[float]:
    count = len(motion.depths)
    known = np.array(clear) if clear else np.ones(count, bool)
    return doubt_of_layers(motion, np.full(count, area), clear=known, background=0).tolist()


def test_the_more_layers_the_more_doubt() -> None:
    two, three, four, six = (
        doubts(found(depths)) for depths in ([3, 6], [3, 6, 9], [3, 5, 7, 9], [2.5, 4.1, 5.7, 7.3, 9.1])
    )
    assert two == [0, 0]
    assert min(three[1:]) > 4
    assert min(four[1:]) > 1.5 * max(three[1:])
    assert max(six) <= 16  # of which no more is to be had


@pytest.mark.parametrize(
    "motion",
    [
        found([3, 6, 9], errors=[3, 0, 0]),  # the background is not explained
        found([0.5, 6, 9]),  # nor has it moved
        found([3, 6, 9], errors=[0, 0, 2]),  # a layer is not explained
        found([3, 6, 9], misfit=0.9),  # too much is not
        found([3, 6, 9], direction=AHEAD),  # any three parts are layers of a motion ahead
        found([3, 6.1, 7.2]),  # two layers
    ],
)
def test_no_doubt_without_three_layers_of_one_motion(motion: RigidMotion) -> None:
    assert doubts(motion) == [0, 0, 0]


def test_parts_that_are_no_layers_make_no_doubt_but_have_it() -> None:
    motion = found([3, 6, 9])
    assert doubts(motion, clear=[True, True, False]) == [0, 0, 0]
    four = found([3, 6, 9, 9.5])
    assert doubts(four, clear=[True, True, True, False])[3] > 4


def test_doubt_is_less_of_what_is_less_likely_a_layer() -> None:
    plain = doubts(found([3, 6, 9, 9]))
    assert doubts(found([3, 6, 9, 9], errors=[0, 0, 0, 1.2]))[3] < 0.6 * plain[3]
    assert doubts(found([3, 6, 9, 9]), area=0.02)[3] < 0.4 * plain[3]  # hardly anything fills the view
    assert doubts(found([3, 6, 9, 9], misfit=0.4))[3] == pytest.approx(0.5 * plain[3])
    assert doubts(found([3, 6, 9, 30]))[3] < 0.3 * doubts(found([3, 6, 9, 12]))[3]  # ten times as near


# Parts of a window ----------------------------------------------------------------------------------------

WIDTH, HEIGHT = 320, 240
SECONDS = 0.05


def still_part(row: int, displacement: tuple[float, float], *, columns: slice = slice(None)) -> Part:
    """Three rows of tiles that move by a displacement, px."""
    tiles = np.zeros((15, 20), bool)
    tiles[row : row + 3, columns] = True
    velocity = (displacement[0] / SECONDS, displacement[1] / SECONDS)
    return Part(np.arange(200), MotionModel("translation", velocity), tiles, (0.0, 0.0, 0.0, 0.0))


def window(camera: emseg.Camera | None = None) -> Window:
    def no_loss(*_: object) -> list[float]:
        raise AssertionError("nothing is held against another motion here")

    return Window(EventArray([], [], [], [], width=WIDTH, height=HEIGHT), SECONDS, no_loss, camera)


SHELVES = [still_part(0, (-3.0, 0.0)), still_part(3, (-6.0, 0.0)), still_part(6, (-9.0, 0.0))]


@pytest.mark.parametrize(
    "camera",
    [None, emseg.Camera(WIDTH, HEIGHT, fx=300, fy=300, cx=155, cy=125, distortion=(-0.1, 0.02, 0, 0))],
    ids=["plain", "camera"],
)
def test_layers_that_a_camera_slides_past_are_doubted_and_what_falls_is_not(
    camera: emseg.Camera | None,
) -> None:
    parts = [*SHELVES, still_part(12, (-4.0, 12.0), columns=slice(8, 12))]
    doubt = layer_doubt(parts, window(camera), 0, np.ones(4), np.array([-9.0, 2.0, 2.0, 4.0]))
    assert doubt[1:3].min() > 3
    assert doubt[3] < 0.01


def test_limbs_belong_with_the_body_that_no_camera_explains() -> None:
    """The same limb, far from the body and touching it."""
    body = still_part(12, (-4.0, 12.0), columns=slice(8, 14))
    firm, logits = np.ones(5), np.array([-9.0, 2.0, 2.0, 4.0, 3.0])
    apart, together = (
        layer_doubt([*SHELVES, body, still_part(12, (-7.0, 0.0), columns=at)], window(), 0, firm, logits)
        for at in (slice(0, 3), slice(14, 17))
    )
    assert apart[4] > 2 * together[4] > 0
    np.testing.assert_allclose(apart[1:3], together[1:3], rtol=0.1)


@pytest.mark.parametrize(
    ("parts", "firm", "logits"),
    [
        (SHELVES, [1, 1, 1], [-9, -4, -3]),  # nothing is thought to move
        (SHELVES[:2], [1, 1], [-9, 4]),  # two layers
        (SHELVES, [1, 1, 0.05], [-9, 4, 4]),  # noise is no layer
        (SHELVES, [0.05, 1, 1], [-9, 4, 4]),  # nor is the background known
        ([SHELVES[0]] * 3, [1, 1, 1], [-9, 4, 4]),  # all as fast
    ],
)
def test_no_doubt_where_there_is_nothing_to_see(
    parts: list[Part], firm: list[float], logits: list[float]
) -> None:
    doubt = layer_doubt(parts, window(), 0, np.array(firm, float), np.array(logits, float))
    assert not doubt.any()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=5), st.integers(0, 4))
def test_doubt_is_finite_and_never_speaks_for_motion(
    displacements: list[tuple[float, float]], background: int
) -> None:
    assume(background < len(displacements))
    parts = [still_part(3 * k, displacement) for k, displacement in enumerate(displacements)]
    doubt = layer_doubt(parts, window(), background, np.ones(len(parts)), np.full(len(parts), 3.0))
    assert np.isfinite(doubt).all()
    assert (doubt >= 0).all()


def test_a_camera_that_slides_past_a_still_scene_sees_no_objects() -> None:
    """One event in seven was an object's before layers were told from objects."""
    events = emseg.read(real("slider_depth/slider_depth.npz"))
    windows = list(emseg.Segmenter(events.width, events.height).run(events))
    moving = sum(int((window.labels > 0).sum()) for window in windows)
    assert moving <= 0.02 * len(events)
