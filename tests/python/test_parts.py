"""Parts of a window: their tiles and boxes, how far they go, and the edges in them."""

from __future__ import annotations

import numpy as np
import pytest
from windows_of_parts import HEIGHT, WIDTH, events_at, no_loss

import emseg
from emseg import EventArray, MotionModel, _core
from emseg.parts import Window, find_parts
from emseg.scene import STILL


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


def defined_tensors(events: EventArray, side: int) -> np.ndarray:
    """Vote by vote: six slices in time, blur by (1 2 1)/4 each way, products of central differences."""

    def gradients(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wide = np.pad(image, 3)
        for axis in (0, 1):
            wide = (np.roll(wide, 1, axis) + 2 * wide + np.roll(wide, -1, axis)) / 4
        down, across = ((np.roll(wide, -1, a) - np.roll(wide, 1, a))[3:-3, 3:-3] / 2 for a in (0, 1))
        return across, down

    point = np.zeros((9, 9))
    point[4, 4] = 1
    single = (gradients(point)[0] ** 2).sum()
    rows, columns = -(-events.height // side), -(-events.width // side)
    tensors = np.zeros((rows, columns, 3))
    seconds = (events.t - events.t[0]).astype(np.float32) / np.float32(1e6)
    slices = np.minimum(5, np.searchsorted(seconds[-1] * np.arange(1, 6) / 6, seconds, side="right"))
    for k in range(6):
        own = events[np.flatnonzero(slices == k)]
        image = np.zeros((events.height, events.width))
        np.add.at(image, (own.y, own.x), np.where(own.p > 0, 1.0, -1.0))
        across, down = gradients(image)
        for number, product in enumerate((across**2, across * down, down**2)):
            for y, x in np.ndindex(rows, columns):
                tile = np.s_[y * side : (y + 1) * side, x * side : (x + 1) * side]
                tensors[y, x, number] += product[tile].sum()
    np.add.at(tensors, (events.y // side, events.x // side), -single * np.array([1, 0, 1]))
    return tensors


@pytest.mark.parametrize(("size", "side"), [((40, 30), 16), ((33, 17), 8), ((5, 5), 16)])
def test_structure_tensors_are_those_of_their_definition(size: tuple[int, int], side: int) -> None:
    rng = np.random.default_rng(3)
    width, height = size
    n = 700
    x, y = rng.integers(0, width, n), rng.integers(0, height, n)
    t = np.sort(rng.integers(0, 50_000, n))
    events = EventArray(x, y, t, rng.integers(0, 2, n), width=width, height=height)
    columns = events.x, events.y, events.t, events.p
    found = _core.structure_tensors(*columns, width, height, side)
    np.testing.assert_allclose(found, defined_tensors(events, side), atol=1e-4)
