"""Simulated recordings against geometry: owners, masks, depth, flow, poses and inertial measurements."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import emseg
from emseg import _core
from emseg.simulation import Scene, Simulation
from emseg.simulation.build import build, native_sensor
from emseg.simulation.scene import TruthRate

WIDTH, HEIGHT = 120, 90

IDEAL = {"threshold_sigma": 0.0, "refractory": 0.0}

# A wall, two sheets and a box that all move on their own, before a still camera.
BODIES = [
    {
        "shape": {"kind": "rectangle", "size": [9, 9]},
        "motion": {"position": [0, 0, 3], "velocity": [0.7, 0.3, 0]},
        "texture": {"grain": 0.3},
        "label": 0,
    },
    {
        "shape": {"kind": "rectangle", "size": [0.9, 0.7]},
        "motion": {"position": [-0.3, 0, 2.2], "velocity": [-0.2, 0.5, 0], "spin": [0, 0, 40]},
        "texture": {"grain": 0.12, "kind": "blocks"},
    },
    {
        "shape": {"kind": "blob", "radius": 0.4},
        "motion": {"position": [0.1, 0.2, 1.8], "velocity": [0.4, -0.1, 0.3]},
        "texture": {"grain": 0.1},
    },
    {
        "shape": {"kind": "box", "size": [0.4, 0.5, 0.4]},
        "motion": {"position": [0.4, -0.2, 2], "velocity": [-0.4, 0, 0], "spin": [0, 90, 20]},
        "texture": {"grain": 0.1, "kind": "checker"},
    },
]

MOVING_CAMERA = {
    "velocity": [0.4, -0.2, 0.3],
    "spin": [5, 20, 30],
    "shake": {"translation": 0.01, "rotation": 0.5},
}


def scene(bodies: list[dict] = BODIES, duration: float = 0.1, **camera: object) -> Scene:
    return Scene.from_mapping(
        {
            "duration": duration,
            "seed": 5,
            "sensor": IDEAL,
            "camera": {"width": WIDTH, "height": HEIGHT, **camera},
            "bodies": bodies,
        }
    )


def still(body: dict) -> dict:
    motion = {key: value for key, value in body["motion"].items() if key in ("position", "rotation")}
    return body | {"motion": motion}


@pytest.fixture(scope="module")
def moving() -> Simulation:
    return emseg.simulate(scene(motion=MOVING_CAMERA))


def test_owner_is_the_surface_that_alone_would_make_the_event() -> None:
    """Every surface is moved alone; the event's owner is whose motion changes the pixel most its way."""
    duration, threshold = 5e-4, 0.005
    numbered = [body | {"label": number} for number, body in enumerate(BODIES)]

    def intensities(bodies: list[dict]) -> NDArray[np.float64]:
        truth = build(scene(bodies)).native.truth(np.array([0.0, duration]), duration)
        return np.log(truth["intensity"].astype(np.float64) + 0.02)

    changes = []
    for mover in range(len(numbered)):
        alone = [body if k == mover else still(body) for k, body in enumerate(numbered)]
        before, after = intensities(alone)
        changes.append(after - before)
    options = _core.SimulationOptions()
    options.duration = duration
    options.largest_motion = 2.0  # one step, as the changes above
    options.smallest_step = duration
    sensor = native_sensor(scene().sensor, 1)
    sensor.threshold_on = sensor.threshold_off = threshold
    events = build(scene(numbered)).native.simulate(sensor, options)
    alone = np.stack(changes)[:, events["y"], events["x"]] * np.where(events["p"] == 1, 1, -1)
    order = np.sort(alone, axis=0)
    clear = order[-1] - order[-2] > 0.2 * np.abs(order[-1])
    contested = order[-2] > 0.1 * threshold
    assert len(clear) > 2000
    assert np.mean(clear) > 0.97
    assert np.sum(contested & clear) > 20
    assert (events["owner"][clear] == np.argmax(alone, axis=0)[clear]).all()


def test_owner_at_an_outline_is_the_one_in_front_where_it_moves() -> None:
    bodies = [still(BODIES[0]), BODIES[1]]
    simulation = emseg.simulate(scene(bodies))
    assert len(simulation.events) > 1000
    assert (simulation.owners == 1).all()


def test_owner_at_an_outline_is_the_one_behind_where_that_moves() -> None:
    bodies = [BODIES[0], still(BODIES[1]) | {"label": 1}]
    simulation = emseg.simulate(scene(bodies))
    assert len(simulation.events) > 2000
    assert (simulation.owners == 0).all()
    x, y = simulation.events.x, simulation.events.y
    distances = [np.abs(x - column) + np.abs(y - row) for row, column in np.argwhere(_outline(simulation))]
    assert (np.min(distances, axis=0) <= 1).sum() > 20  # some are at the outline of what stands still


def _outline(simulation: Simulation) -> NDArray[np.bool_]:
    mask = simulation.truth.mask[0] > 0
    inside = mask[1:-1, 1:-1] & mask[2:, 1:-1] & mask[:-2, 1:-1] & mask[1:-1, 2:] & mask[1:-1, :-2]
    outline = mask.copy()
    outline[1:-1, 1:-1] &= ~inside
    return outline


def test_low_pass_does_not_confuse_owners() -> None:
    """Late events belong to what changed the pixel, not to what is there when they come."""
    bodies = [still(BODIES[0]), BODIES[1]]
    slow = scene(bodies).model_copy(update={"sensor": scene().sensor.model_copy(update={"cutoff": 60.0})})
    simulation = emseg.simulate(slow)
    assert len(simulation.events) > 1000
    assert (simulation.owners == 1).all()


def test_masks_are_where_owners_events_are(moving: Simulation) -> None:
    """Nearly all events of an object lie on its mask at the nearest moment, or within a pixel and a half."""
    nearest = np.abs(moving.events.t[:, None] - moving.truth.t).argmin(axis=1)
    for label in moving.truth.labels:
        mine = moving.owners == label
        mask = moving.truth.mask == label
        wide = mask.copy()
        for axis in (1, 2):
            wide |= np.roll(wide, 1, axis) | np.roll(wide, -1, axis)
        assert mine.sum() > 1000
        on_it = wide[nearest[mine], moving.events.y[mine], moving.events.x[mine]]
        assert on_it.mean() > 0.95


def _project(points: NDArray[np.float64], T_camera_world: NDArray[np.float64], K: NDArray[np.float64]):
    seen = points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    return (seen @ K.T)[..., :2] / seen[..., 2:]


def test_flow_is_what_depth_and_poses_say(moving: Simulation) -> None:
    """The background's and the objects' flow from depth and poses by NumPy alone; to 0.01 px."""
    truth, K = moving.truth, moving.camera.K
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    pixels = np.stack([columns, rows], axis=-1).astype(np.float64)
    rays = np.concatenate([pixels, np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ np.linalg.inv(K).T
    for k in range(len(truth.t) - 1):
        points = rays * truth.depth[k, ..., None]
        in_world = points @ truth.T_world_camera[k, :3, :3].T + truth.T_world_camera[k, :3, 3]
        for number, label in enumerate(truth.labels):
            chosen = truth.mask[k] == label
            now, later = truth.T_world_object[k, number], truth.T_world_object[k + 1, number]
            moved = later @ np.linalg.inv(now)
            in_world[chosen] = in_world[chosen] @ moved[:3, :3].T + moved[:3, 3]
        static_wall = truth.mask[k] == 0
        in_world[static_wall] += np.array([0.7, 0.3, 0]) * moving.scene.truth.interval
        there = _project(in_world, np.linalg.inv(truth.T_world_camera[k + 1]), K)
        flow = np.moveaxis(truth.flow[k], 0, -1)
        assert np.abs(there - pixels - flow).max() < 0.01
        assert np.abs(truth.flow).max() > 1


def test_a_frame_warped_by_the_flow_is_the_next() -> None:
    seldom = scene(motion=MOVING_CAMERA).model_copy(update={"truth": TruthRate(interval=0.05)})
    truth = emseg.simulate(seldom).truth
    assert np.abs(truth.flow).max() > 4
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    errors = []
    for k in range(len(truth.t) - 1):
        x, y = columns + truth.flow[k, 0], rows + truth.flow[k, 1]
        inside = (x > 1) & (x < WIDTH - 2) & (y > 1) & (y < HEIGHT - 2)
        left, top = np.floor(np.where(inside, x, 1)).astype(int), np.floor(np.where(inside, y, 1)).astype(int)
        # All four pixels around the place show the same body: neither hidden nor at an outline.
        same = inside.copy()
        for dx in (0, 1):
            for dy in (0, 1):
                same &= truth.mask[k + 1, top + dy, left + dx] == truth.mask[k]
        a, b = x - left, y - top
        frame = truth.frame[k + 1]
        above = frame[top, left] * (1 - a) + frame[top, left + 1] * a
        below = frame[top + 1, left] * (1 - a) + frame[top + 1, left + 1] * a
        warped = above * (1 - b) + below * b
        assert same.mean() > 0.7
        errors.append(np.abs(warped - truth.frame[k])[same])
        unwarped = np.abs(frame - truth.frame[k])[same]
        assert errors[-1].mean() < 0.35 * unwarped.mean()
    assert np.median(np.concatenate(errors)) < 0.01


def test_depth_of_a_box_room() -> None:
    room = {
        "shape": {"kind": "box", "size": [4, 3, 8], "seen_from": "inside"},
        "motion": {"position": [0, 0, 2]},
    }
    simulation = emseg.simulate(scene([room], duration=0.01))
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    K = simulation.camera.K
    x, y = (columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1]
    expected = np.minimum(6, np.minimum(2 / np.maximum(np.abs(x), 1e-9), 1.5 / np.maximum(np.abs(y), 1e-9)))
    # A corner's pixels show parts of two walls.
    assert np.quantile(np.abs(simulation.truth.depth[0] / expected - 1), 0.98) < 1e-4
    assert (simulation.truth.mask == 0).all()


def test_events_of_a_dense_simulation() -> None:
    """Nearly all events of a sensor in a few lines of NumPy that looks every 0.02 px, to 0.1 px of motion."""
    bodies = [
        {
            "shape": {"kind": "rectangle", "size": [9, 9]},
            "motion": {"position": [0, 0, 3], "velocity": [0.9, 0.4, 0]},
            "texture": {"grain": 0.4},
        },
        BODIES[1],
    ]
    simulation = emseg.simulate(scene(bodies, duration=0.06))
    moments = np.arange(0, 0.06 + 1e-9, 5e-4)
    truth = build(scene(bodies, duration=0.06)).native.truth(moments, 1e-3)
    log = np.log(truth["intensity"].astype(np.float64) + 0.02)
    ours = np.zeros((HEIGHT, WIDTH), int)
    rises = np.where(simulation.events.p == 1, 1, -1)
    np.add.at(ours, (simulation.events.y, simulation.events.x), rises)
    # Up and down, pixels report all but at most two thresholds of what they see.
    assert np.abs(log[-1] - log[0] - 0.25 * ours).max() < 0.5 + 0.01
    # Pixels report the path, not only its ends: replay each with the start that its own events imply.
    order = np.lexsort((simulation.events.t, simulation.events.x, simulation.events.y))
    x, y, t, p = (getattr(simulation.events, name)[order] for name in "xytp")
    checked = wrong = 0
    late = []
    for start in np.flatnonzero(np.r_[True, (np.diff(x) != 0) | (np.diff(y) != 0)])[::3]:
        stop = start
        while stop < len(x) and x[stop] == x[start] and y[stop] == y[start]:
            stop += 1
        levels = log[:, y[start], x[start]]
        # The level reported first is where the log intensity is at the first event.
        reported = np.interp(t[start] * 1e-6, moments, levels)
        predicted = []
        for k in range(int(t[start] * 1e-6 / 5e-4), len(moments) - 1):
            begin = max(moments[k], t[start] * 1e-6)
            low = np.interp(begin, moments, levels)
            high = levels[k + 1]
            while abs(high - reported) >= 0.25:
                sign = np.sign(high - reported)
                reported += 0.25 * sign
                share = (reported - low) / (high - low)
                predicted.append((begin + share * (moments[k + 1] - begin), sign))
        found = [
            (1e-6 * time, 1 if sign else -1)
            for time, sign in zip(t[start + 1 : stop], p[start + 1 : stop], strict=True)
        ]
        checked += 1
        if [sign for _, sign in predicted] != [sign for _, sign in found]:
            wrong += 1
            continue
        late += [abs(a - b) for (a, _), (b, _) in zip(predicted, found, strict=True)]
    assert checked > 300
    assert wrong / checked < 0.03
    assert len(late) > 300
    speed = simulation.camera.fx * np.hypot(0.9, 0.4) / 3  # of the wall, px/s
    assert np.quantile(late, 0.95) * speed < 0.1


def test_distortion_moves_pixels_only() -> None:
    """What a pixel of a distorted camera shows is what the pinhole camera shows where it undistorts to."""
    lens = {"fx": 100.0, "distortion": [-0.35, 0.12, 0.001, -0.001]}
    truth = emseg.simulate(scene(duration=0.01, **lens)).truth
    plain = emseg.simulate(scene(duration=0.01, fx=100.0)).truth
    camera = scene(**lens).camera.to_camera()
    x, y = camera.undistortion_table()
    inside = (x > 1) & (x < WIDTH - 2) & (y > 1) & (y < HEIGHT - 2)
    column, row = np.rint(x[inside]).astype(int), np.rint(y[inside]).astype(int)
    assert np.mean(truth.mask[0][inside] == plain.mask[0][row, column]) > 0.98
    assert np.median(np.abs(truth.depth[0][inside] - plain.depth[0][row, column])) < 1e-3
    # The flow leads to where the lens shows it: undistort both ends and compare with the pinhole's flow.
    rows, columns = np.nonzero(inside)
    step = 7
    native = camera.to_native()
    for k in range(0, len(rows), 37 * step):
        at = native.undistort_pixel(columns[k], rows[k])
        end = native.undistort_pixel(
            columns[k] + truth.flow[0, 0, rows[k], columns[k]],
            rows[k] + truth.flow[0, 1, rows[k], columns[k]],
        )
        near = plain.flow[0][:, row[k], column[k]]
        if truth.mask[0, rows[k], columns[k]] == plain.mask[0, row[k], column[k]] == 0:
            assert np.abs(np.subtract(end, at) - near).max() < 0.02


def test_inertial_measurements_of_a_turning_camera() -> None:
    motion = {"spin": [0, 0, 90], "velocity": [1, 0, 0]}
    imu = emseg.simulate(scene(motion=motion), truth="poses").imu
    assert imu["t"].tolist() == [5000 * k for k in range(21)]
    np.testing.assert_allclose(imu["gyro"], np.tile([0, 0, np.pi / 2], (21, 1)), atol=1e-5)
    angle = np.pi / 2 * imu["t"] * 1e-6
    # Gravity pulls along y, a sensor at rest is held against it.
    expected = np.stack([-9.81 * np.sin(angle), -9.81 * np.cos(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(imu["accel"][1:-1], expected[1:-1], atol=1e-3)


def test_inertial_measurements_of_a_shaken_camera() -> None:
    motion = {"waves": [{"amplitude": [0.02, 0, 0], "frequency": 3}]}
    imu = emseg.simulate(scene(duration=0.5, motion=motion), truth="poses").imu
    t = imu["t"] * 1e-6
    expected = -0.02 * (6 * np.pi) ** 2 * np.sin(6 * np.pi * t)
    np.testing.assert_allclose(imu["accel"][1:-1, 0], expected[1:-1], atol=0.03)
    np.testing.assert_allclose(imu["accel"][:, 1], -9.81, atol=1e-6)
