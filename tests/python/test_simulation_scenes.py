"""Descriptions of scenes: YAML both ways, clear errors, motions and shapes against oracles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from emseg import _core
from emseg.simulation import Scene, simulate
from emseg.simulation.build import native_sensor
from emseg.simulation.motion import Motion, Shake, Wave, Waypoint
from emseg.simulation.person import parts_of_person
from emseg.simulation.randomness import Random
from emseg.simulation.scene import Ball, Box, Cylinder, Mesh, Person, Sensor, Texture
from emseg.simulation.shapes import surfaces_of
from emseg.simulation.suite import NAMES, SPLITS, split_of, suite_scene
from emseg.simulation.trajectories import SAMPLE_INTERVAL, Track
from emseg.yaml_files import ConfigError

WALL = "bodies:\n- shape: {kind: rectangle, size: [9, 9]}\n  motion: {position: [0, 0, 3]}\n"


def read(tmp_path, text: str) -> Scene:
    path = tmp_path / "room.yaml"
    path.write_text(text)
    return Scene.from_yaml(path)


# --- files -------------------------------------------------------------------------------------------------


def test_a_scene_file_takes_its_name(tmp_path) -> None:
    scene = read(tmp_path, WALL)
    assert scene.name == "room"
    assert scene.labels() == (0,)


@pytest.mark.parametrize("name", NAMES)
def test_yaml_gives_the_same_scene_again(name: str, tmp_path) -> None:
    scene = suite_scene(name, 3)
    assert read(tmp_path, scene.to_yaml()) == scene


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("bodies: []\n", "bodies: .* at least 1 item"),
        ("duration: 0\n" + WALL, "duration: .*greater than 0, not 0"),
        ("duraton: 1\n" + WALL, "duraton: unknown key, did you mean 'duration'?"),
        ("camera: {width: 3}\n" + WALL, "camera.width: .*greater than or equal to 8, not 3"),
        ("camera: {fx: 100, field_of_view: 60}\n" + WALL, "camera: field_of_view and fx or fy given"),
        ("camera: {fx: 100, distortion: [9, 9]}\n" + WALL, "camera: .*2 distortion coefficients"),
        ("sensor: {threshold_on: -1}\n" + WALL, "sensor.threshold_on: .*greater than 0, not -1"),
        ("sensor: {treshold_on: 1}\n" + WALL, "sensor.treshold_on: unknown key"),
        (WALL.replace("size: [9, 9]", "size: [9]"), "bodies.0.shape.rectangle.size.1: Field required"),
        (WALL.replace("rectangle", "rectangel"), "bodies.0.shape: .*'rectangel'.*expected"),
        (WALL.replace("[0, 0, 3]", "[0, 0, far]"), "bodies.0.motion.position.2: .*valid number, not 'far'"),
        (WALL + "  light: lamp\n", "bodies.0.light is 'lamp', expected a flicker of: none"),
        (WALL + "  person: {}\n", "bodies.0: shape and person given"),
        (WALL + "  label: 999\n", "bodies.0.label: .*less than or equal to 127"),
        (
            WALL.replace("position: [0, 0, 3]", "waypoints: [{at: 1}, {at: 1}]"),
            "bodies.0.motion: waypoints are at .* rising times",
        ),
        (WALL.replace("position: [0, 0, 3]", "pauses: [[2, 1]]"), "bodies.0.motion: pauses are .* rising"),
        ("bodies:\n- parts: [{name: a, parent: b, shape: {kind: ball, radius: 1}}]\n", "'a' hangs on 'b'"),
        ("bodies:\n- {}\n", "bodies.0: none given, expected one of shape, parts, person"),
        ("bodies: {}\n", "bodies: .*valid tuple"),
        ("bodies: [\n", "line 2: no valid YAML"),
    ],
)
def test_bad_scene_files_get_one_line(text: str, complaint: str, tmp_path) -> None:
    with pytest.raises(ConfigError, match=complaint) as caught:
        read(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'room.yaml'}: ")
    assert "\n" not in message


def test_sensor_defaults_are_the_native_ones() -> None:
    native = _core.SensorOptions()
    options = _core.SimulationOptions()
    for name, value in Sensor().model_dump().items():
        assert getattr(native if hasattr(native, name) else options, name) == value, name
    ours = native_sensor(Sensor(threshold_on=0.5, hot_rate=7.0), 0)
    assert (ours.threshold_on, ours.hot_rate) == (0.5, 7.0)


# --- motions -----------------------------------------------------------------------------------------------


def times(track: Track) -> np.ndarray:
    return np.arange(len(track.position)) * SAMPLE_INTERVAL


def test_waypoints_are_a_natural_spline() -> None:
    points = [(0.0, 1.0), (0.1, -1.0), (0.25, 0.5), (0.4, 2.0)]
    waypoints = tuple(Waypoint(at=t, position=(x, 0, -x), rotation=(0, 0, 10 * x)) for t, x in points)
    track = Track.of(Motion(position=(1, 2, 3), waypoints=waypoints), 0.5)
    spline = CubicSpline(*zip(*points, strict=True), bc_type="natural")
    x = spline(np.clip(times(track), 0, 0.4))
    np.testing.assert_allclose(track.position, np.stack([1 + x, 2 + 0 * x, 3 - x], axis=1), atol=1e-9)
    turned = Rotation.from_quat(track.quaternion, scalar_first=True).as_rotvec(degrees=True)
    np.testing.assert_allclose(turned[:, 2], 10 * x, atol=1e-6)


def test_motions_add_up() -> None:
    wave = Wave(amplitude=(0.1, 0, 0.2), frequency=3, phase=0.1)
    motion = Motion(position=(1, 0, 0), velocity=(0, 2, 0), acceleration=(0, 0, 4), waves=(wave,))
    track = Track.of(motion, 0.3)
    t = times(track)
    sine = np.sin(2 * np.pi * (3 * t + 0.1))
    expected = np.stack([1 + 0.1 * sine, 2 * t, 2 * t**2 + 0.2 * sine], axis=1)
    np.testing.assert_allclose(track.position, expected, atol=1e-9)


def test_spin_and_swing_are_rotations_of_the_body() -> None:
    swing = Wave(amplitude=(0, 30, 0), frequency=2)
    track = Track.of(Motion(rotation=(90, 0, 0), spin=(0, 0, 100), swings=(swing,)), 0.2)
    t = times(track)
    expected = (
        Rotation.from_rotvec([90, 0, 0], degrees=True)
        * Rotation.from_rotvec(np.outer(t, [0, 0, 100]), degrees=True)
        * Rotation.from_rotvec(np.outer(np.sin(4 * np.pi * t), [0, 30, 0]), degrees=True)
    )
    ours = Rotation.from_quat(track.quaternion, scalar_first=True)
    assert (ours * expected.inv()).magnitude().max() < 1e-8


def test_a_pause_stops_and_goes_on() -> None:
    track = Track.of(Motion(velocity=(1, 0, 0), pauses=((0.2, 0.4),)), 0.6)
    x = track.position[:, 0]
    t = times(track)
    assert x[150] == pytest.approx(0.15, abs=1e-9)
    assert np.ptp(x[(t > 0.235) & (t < 0.365)]) < 1e-9
    assert x[500] - x[450] == pytest.approx(0.05, abs=1e-9)
    assert np.diff(x).min() >= -1e-12
    assert np.abs(np.diff(x, 2)).max() < 1e-4  # without a jerk of the velocity


@given(seed=st.integers(0, 1000), size=st.floats(0.001, 1))
@settings(max_examples=20, deadline=None)
def test_trembling_is_as_strong_as_asked(seed: int, size: float) -> None:
    track = Track.of(Motion(shake=Shake(translation=size, rotation=0.5, frequency=20, seed=seed)), 4)
    strength = np.sqrt(np.mean(np.sum(track.position**2, axis=1)))
    assert 0.6 * size < strength < 1.5 * size


def test_parts_move_in_their_parents_frame() -> None:
    parent = Track.of(Motion(position=(1, 0, 0), spin=(0, 0, 90)), 1)
    child = Track.of(Motion(position=(2, 0, 0)), 1)
    place = (parent @ child).position[1000]
    np.testing.assert_allclose(place, [1, 2, 0], atol=1e-9)


def test_motions_are_the_same_on_a_coarse_grid() -> None:
    """What libraries differ by, some 1e-16, is far below the grid of 1.5e-11 that samples lie on."""
    track = Track.of(Motion(velocity=(0.1, 0, 0)), 0.1)
    assert (track.position * 2.0**36 == np.rint(track.position * 2.0**36)).all()


# --- people ------------------------------------------------------------------------------------------------


def walk(person: Person, duration: float) -> dict[str, Track]:
    tracks: dict[str | None, Track] = {None: Track.of(Motion(), duration)}
    for part in parts_of_person(person, Texture()):
        tracks[part.name] = tracks[part.parent] @ Track.of(part.motion, duration)
    return {name: track for name, track in tracks.items() if name is not None}


def angle_of(track: Track) -> np.ndarray:
    """Rotation about z, degrees."""
    turned = Rotation.from_quat(track.quaternion, scalar_first=True).as_rotvec(degrees=True)
    return turned[:, 2] * np.ones(len(track.quaternion))


def test_a_person_walks() -> None:
    person = Person(height=1.8, cadence=1.0, swing=30)
    tracks = walk(person, 1)
    left, right = angle_of(tracks["left thigh"]), angle_of(tracks["right thigh"])
    assert np.ptp(left) == pytest.approx(60, abs=0.1)
    np.testing.assert_allclose(left, -right, atol=1e-5)  # in opposite phase
    assert np.corrcoef(left, angle_of(tracks["left upper arm"]))[0, 1] < -0.99
    for side in ("left", "right"):
        knee = angle_of(tracks[f"{side} shank"]) - angle_of(tracks[f"{side} thigh"])
        elbow = angle_of(tracks[f"{side} forearm"]) - angle_of(tracks[f"{side} upper arm"])
        assert knee.min() > -1e-5  # backwards only
        assert knee.max() == pytest.approx(45, abs=0.1)
        assert elbow.max() < 1e-5
    # The lower foot is about on the floor.
    ends = [
        tracks[f"{side} shank"] @ Track(np.array([[0, 0.27 * 1.8, 0]]), np.array([[1.0, 0, 0, 0]]))
        for side in ("left", "right")
    ]
    lowest = np.maximum(*(end.position[:, 1] for end in ends))
    assert np.abs(lowest).max() < 0.12


@given(low=st.floats(0.01, 1), high=st.floats(0.01, 1))
def test_people_wear_any_texture(low: float, high: float) -> None:
    texture = Texture(low=min(low, high), high=max(low, high))
    for part in parts_of_person(Person(), texture):
        worn = part.texture or texture
        assert 0 < worn.low <= worn.high <= texture.high


def test_a_standing_person_stands() -> None:
    assert all(track.is_still for track in walk(Person(cadence=0), 1).values())


# --- shapes ------------------------------------------------------------------------------------------------


def corners_of(surface) -> np.ndarray:
    u, v = np.array(surface.axis_u), np.array(surface.axis_v)
    return np.array(surface.origin) + np.array(surface.polygon) @ np.stack([u, v])


def area_of(surface) -> float:
    u, v = np.array(surface.polygon).T
    return float(np.sum(u * np.roll(v, -1) - v * np.roll(u, -1)) / 2)


@pytest.mark.parametrize(
    ("shape", "side", "area"),
    [
        (Box(size=(1, 2, 3)), 1, 22),
        (Box(size=(1, 2, 3), seen_from="inside"), -1, 22),
        (Ball(radius=2, detail=0), 1, 5 * np.sqrt(3) * (4 / np.sqrt(10 + 2 * np.sqrt(5)) * 2) ** 2),
        (Ball(radius=1, detail=2), 1, 4 * np.pi * 0.97),
    ],
)
def test_solids_are_closed_and_face_outwards(shape, side: int, area: float) -> None:
    surfaces = surfaces_of(shape)
    assert sum(map(area_of, surfaces)) == pytest.approx(area, rel=0.02)
    edges: dict[tuple, int] = {}
    for surface in surfaces:
        corners = corners_of(surface)
        normal = np.cross(surface.axis_u, surface.axis_v)
        assert np.sign(np.dot(normal, corners.mean(axis=0))) == side
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            key = tuple(sorted((tuple(np.round(a, 9) + 0.0), tuple(np.round(b, 9) + 0.0))))
            edges[key] = edges.get(key, 0) + 1
    assert set(edges.values()) == {2}  # each edge joins two faces


def test_a_cylinder_has_sides_and_caps() -> None:
    surfaces = surfaces_of(Cylinder(radius=0.5, height=2, sides=24))
    sides = [surface for surface in surfaces if surface.outline == "polygon"]
    assert len(sides) == 24
    assert sum(map(area_of, sides)) == pytest.approx(np.pi * 2, rel=0.01)
    for surface in surfaces:
        assert np.dot(np.cross(surface.axis_u, surface.axis_v), surface.origin) > 0


def test_meshes_are_checked() -> None:
    square = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))
    (surface,) = surfaces_of(Mesh(vertices=square, faces=((0, 1, 2, 3),)))
    assert area_of(surface) == pytest.approx(1)
    np.testing.assert_allclose(np.cross(surface.axis_u, surface.axis_v), [0, 0, 1], atol=1e-12)
    bent = Mesh(vertices=(*square[:3], (0, 1, 0.5)), faces=((0, 1, 2, 3),))
    with pytest.raises(ValueError, match="face 0 is not flat"):
        surfaces_of(bent)
    with pytest.raises(ValueError, match="face 0 has no area"):
        surfaces_of(Mesh(vertices=((0, 0, 0), (1, 0, 0), (2, 0, 0)), faces=((0, 1, 2),)))
    with pytest.raises(ValueError, match=r"names vertex 7, expected 0\.\.3"):
        Mesh(vertices=square, faces=((0, 1, 7),))


# --- the suite ---------------------------------------------------------------------------------------------


def test_splits_do_not_overlap_and_cover_their_seeds() -> None:
    assert split_of(0) == "train"
    assert split_of(10_000) == "validation"
    assert split_of(11_999) == "test"
    assert len(set().union(*SPLITS.values())) == sum(map(len, SPLITS.values()))
    with pytest.raises(ValueError, match=r"seed is 12000, expected 0\.\.11999"):
        split_of(12_000)


@pytest.mark.parametrize("name", NAMES)
def test_suite_scenes_differ_by_seed_and_hold_one_to_eight_objects(name: str) -> None:
    scenes = [suite_scene(name, seed) for seed in range(20)]
    assert len({scene.to_yaml() for scene in scenes}) == 20
    assert suite_scene(name, 7) == scenes[7]
    for scene in scenes:
        assert 1 <= len(set(scene.labels()) - {0}) <= 8
        assert 0 in scene.labels()


def test_the_suite_has_what_it_is_to_have() -> None:
    scenes = {name: [suite_scene(name, seed) for seed in range(30)] for name in NAMES}
    every = [scene for of_name in scenes.values() for scene in of_name]
    sizes = {(scene.camera.width, scene.camera.height) for scene in every}
    assert sizes == {(240, 180), (346, 260), (640, 480), (1280, 720)}
    counts = {len(set(scene.labels()) - {0}) for scene in scenes["multiple_objects"]}
    assert {2, 8} <= counts
    assert any(body.motion.pauses for scene in every for body in scene.bodies)
    for name in ("slow_cam", "fast_cam", "corridor"):
        assert all(any(body.person for body in scene.bodies) for scene in scenes[name])
    shapes = {type(body.shape).__name__ for scene in every for body in scene.bodies}
    assert {"Rectangle", "Disc", "Blob", "Net", "Box", "Cylinder", "Ball"} <= shapes
    assert all(scene.lighting.flickers for name in ("strobe", "light_variations") for scene in scenes[name])
    assert all(scene.camera.motion.is_still for name in ("hands", "passers_by") for scene in scenes[name])
    passing = [any(body.person for body in scene.bodies) for scene in scenes["passers_by"]]
    assert 0.5 < np.mean(passing) <= 1


def test_blinds_are_straight_edges_near_columns_and_rows_before_which_things_pass() -> None:
    angles = []
    for seed in range(30):
        scene = suite_scene("blinds", seed)
        slats = [body for body in scene.bodies if body.name == "slats"]
        angles += [body.motion.rotation[2] for body in slats]
        assert slats
        assert all(body.motion.is_still for body in slats)
        assert set(scene.labels()) == {0, 1}
    off = [abs((angle + 45) % 90 - 45) for angle in angles]
    assert max(off) < 10
    assert min(off) < 1  # hardly off an axis
    assert any(abs(angle) > 45 for angle in angles)


def test_blinds_have_events_of_what_stands_and_of_what_passes() -> None:
    scene = suite_scene("blinds", 1, duration=0.12)
    made, again = (simulate(scene, threads=threads) for threads in (1, 2))
    assert made.events == again.events
    np.testing.assert_array_equal(made.owners, again.owners)
    assert np.count_nonzero(made.owners == 0) > 1000
    assert np.count_nonzero(made.owners == 1) > 100


def test_draws_are_reproducible() -> None:
    random = Random("a", 1)
    draws = [random.integer(0, 9) for _ in range(200)]
    assert draws[:5] == [Random("a", 1).integer(0, 9), *draws[1:5]]
    assert set(draws) == set(range(10))
    assert sorted(random.shuffled("abc")) == list("abc")
    with pytest.raises(ValueError, match="unknown scene 'hand'"):
        suite_scene("hand", 0)
