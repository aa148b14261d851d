"""The image motion of the still scene from that of its parts, which do not see all of it."""

from __future__ import annotations

import numpy as np
import pytest
from windows_of_parts import COLUMNS, HEIGHT, ROWS, WIDTH, events_at, no_loss

from emseg import EventArray, MotionModel
from emseg.parts import Part, Window, find_parts
from emseg.scene import STILL
from emseg.still_scene import agreed_motion, sight, still_motion

UPRIGHT = np.diag([1.0, 0.0])  # sight of upright edges: sideways only


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
    sights: list[np.ndarray] | None = None,
) -> float:
    """Of the flow found over the middle of the view, px over a window of 40 ms."""
    window = Window(events_at(np.zeros((1, 2)), size=(WIDTH, HEIGHT)), 0.04, no_loss)
    n = len(parts)
    found = still_motion(parts, window, ambiguous or [0.0] * n, firm or [1.0] * n, sights or [np.eye(2)] * n)
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
    clear = [np.eye(2)] * len(parts)
    firm, loose = (still_motion(parts, window, sure, [value] * len(parts), clear) for value in (1.0, 0.1))
    np.testing.assert_allclose(loose.params, firm.params, rtol=1e-9)


def test_along_edges_the_other_parts_have_the_say() -> None:
    """Two thirds of the view are upright edges that seem to go 36 px down; their 4 px sideways are true."""
    true, false = (100.0, 30.0), (100.0, 900.0)
    parts = stripes(true, false, false, period=3)
    sights = [np.eye(2) if part.model.params[1] == 30 else UPRIGHT for part in parts]
    planar = (*true, *[0.0] * 6)
    assert worst_error(parts, planar, sights=sights) < 0.5
    assert worst_error(parts, planar) > 5


def window_of_lines(angle: float) -> tuple[Window, Part]:
    """Parallel lines that go slowly across themselves, the angle is theirs to the rows."""
    rng = np.random.default_rng(5)
    n = 12_000
    t = np.sort(rng.integers(0, 50_000, n))
    along, line = rng.uniform(-300, 300, n), rng.integers(-12, 12, n) * 12.0
    direction = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-direction[1], direction[0]])
    places = (160, 120) + along[:, None] * direction + (line + 40e-6 * t)[:, None] * normal
    inside = ((places >= 0) & (places < (WIDTH - 1, HEIGHT - 1))).all(axis=1)
    events = events_at(places[inside], t[inside], size=(WIDTH, HEIGHT))
    (part,) = find_parts(events, [(np.arange(len(events)), STILL)])
    return Window(events, 0.05, no_loss), part


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2, 2.5])
def test_lines_are_seen_to_go_across_themselves(angle: float) -> None:
    window, part = window_of_lines(angle)
    seen = sight(part, window)
    direction = np.array([np.cos(angle), np.sin(angle)])
    normal = np.array([-direction[1], direction[0]])
    assert normal @ seen @ normal > 0.95
    assert direction @ seen @ direction < 0.3
    assert np.linalg.eigvalsh(seen)[1] == pytest.approx(1)


def test_dots_are_seen_to_go_any_way_and_so_is_what_holds_no_tile() -> None:
    rng = np.random.default_rng(6)
    dots = rng.uniform((5, 5), (WIDTH - 5, HEIGHT - 5), (150, 2))[rng.integers(0, 150, 6000)]
    events = events_at(dots, size=(WIDTH, HEIGHT))
    (part,) = find_parts(events, [(np.arange(6000), STILL)])
    window = Window(events, 0.006, no_loss)
    np.testing.assert_allclose(sight(part, window), np.eye(2), atol=0.05)
    few = Part(part.own[:2], STILL, np.zeros_like(part.tiles), part.box)
    np.testing.assert_array_equal(sight(few, window), np.eye(2))


SECONDS = 0.04


def agreed(
    flows: list[tuple[float, float]], sights: list[np.ndarray], weights: list[float]
) -> tuple[float, float]:
    """That of the first, px over a window."""
    window = Window(EventArray([0], [0], [0], [0], width=WIDTH, height=HEIGHT), SECONDS, no_loss)
    parts = [
        tiles_part(MotionModel("similarity", (x / SECONDS, y / SECONDS, 0, 0)), slice(0, 1), slice(0, 1))
        for x, y in flows
    ]
    model = agreed_motion(parts, 0, window, sights, np.array(weights))
    assert model.kind == "similarity"
    x, y = window.displacement(model, 160, 120)
    return float(x), float(y)


def test_along_its_edges_a_part_goes_as_the_others_say() -> None:
    flows = [(3.0, 1.0), (3.5, -8.0), (13.0, -7.0)]  # edges, a poster, and something that moves
    assert agreed(flows, [UPRIGHT, np.eye(2), np.eye(2)], [0.5, 0.1, 0.1]) == pytest.approx((3, -8))
    # What is seen by itself needs nobody, and nobody else sees anything along edges as its own.
    assert agreed(flows, [np.eye(2)] * 3, [0.5, 0.1, 0.1]) == (3, 1)
    assert agreed(flows, [UPRIGHT, UPRIGHT, np.eye(2)], [0.5, 0.1, 0.1]) == pytest.approx((3, 1))
    # Some is seen along the edges, and weighs more than one that says something else.
    assert agreed(flows, [np.diag([1.0, 0.5]), np.eye(2), np.eye(2)], [0.5, 0.1, 0.1]) == pytest.approx(
        (3, 1)
    )


def test_of_others_that_differ_most_weight_decides() -> None:
    flows = [(0.0, 0.0), (0.0, 6.0), (0.0, 6.5), (0.5, -6.0)]
    sights = [UPRIGHT, *[np.eye(2)] * 3]
    x, y = agreed(flows, sights, [0.5, 0.1, 0.1, 0.15])
    assert (x, y) == pytest.approx((0, 6.25), abs=0.3)
    assert agreed(flows, sights, [0.5, 0.1, 0.1, 0.3]) == pytest.approx((0, -6))


def test_a_rotation_stays_as_it_is() -> None:
    window = Window(EventArray([0], [0], [0], [0], width=WIDTH, height=HEIGHT), SECONDS, no_loss)
    turn = MotionModel("rotation", (0.1, 0.2, 0.3))
    parts = [tiles_part(turn, slice(0, 1), slice(0, 1)), tiles_part(STILL, slice(1, 2), slice(0, 1))]
    assert agreed_motion(parts, 0, window, [UPRIGHT, np.eye(2)], np.ones(2)) is turn
