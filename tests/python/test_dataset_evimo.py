"""EV-IMO and EVIMO2 in every layout: written by the simulator, with an object added that stands still."""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import emseg
from emseg.datasets import DatasetError, open_dataset
from emseg.datasets.evimo import moving_mask
from emseg.datasets.poses import moving_objects, pose_matrix
from emseg.simulation import Simulation
from emseg.simulation.evimo import write_evimo, write_evimo2, write_text
from emseg.simulation.simulator import Poses

SCENE = """
duration: 0.2
seed: 4
camera: {width: 64, height: 48, motion: {velocity: [0.5, 0, 0]}, fx: 60, distortion: [-0.1, 0.01, 0, 0]}
bodies:
- shape: {kind: rectangle, size: [9, 9]}
  motion: {position: [0, 0, 3], rotation: [0, 10, 0]}
- shape: {kind: ball, radius: 0.3}
  motion: {position: [0, 0, 2], velocity: [0.6, 0, 0]}
"""
MOVING, STILL, UNPOSED = 1, 2, 3


def with_a_still_object(poses: Poses) -> Poses:
    standing = np.tile(np.eye(4), (len(poses.t), 1, 1, 1))
    standing[:, 0, :3, 3] = [1, 1, 2]
    both = np.concatenate([poses.T_world_object, standing], axis=1)
    return replace(poses, T_world_object=both, labels=np.append(poses.labels, STILL))


@pytest.fixture(scope="module")
def simulation(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    """Of the mask's corners, one belongs to a still object and one to an object without poses."""
    path = tmp_path_factory.mktemp("scene") / "small.yaml"
    path.write_text(SCENE)
    made = emseg.simulate(path)
    mask = made.truth.mask.copy()
    mask[:, :8, :8], mask[:, -8:, -8:] = STILL, UNPOSED
    truth = replace(made.truth, mask=mask, poses=with_a_still_object(made.truth.poses))
    return replace(made, truth=truth, trajectory=with_a_still_object(made.trajectory))


LAYOUTS: dict[str, tuple[str, Callable[[Path, Simulation], None], str]] = {
    "EV-IMO npz": ("evimo", lambda root, made: write_evimo(root / "eval/table/seq_01.npz", made), "table"),
    "EV-IMO text": ("evimo", lambda root, made: write_text(root / "eval/fast/seq_01", made), "fast"),
    "EVIMO2 v1": ("evimo2", lambda root, made: write_evimo(root / "samsung_mono/imo/a.npz", made), ""),
    "EVIMO2 v2": ("evimo2", lambda root, made: write_evimo2(root / "samsung_mono/imo/a", made), ""),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_was_written_is_read(simulation: Simulation, tmp_path: Path, layout: str) -> None:
    name, write, group = LAYOUTS[layout]
    if "text" in layout:
        pytest.importorskip("cv2", reason="reading PNG needs the extra 'viz'")
    write(tmp_path, simulation)
    dataset = open_dataset(name, tmp_path)
    assert len(dataset) == 1
    recording = dataset[0]
    assert recording.name == dataset.names[0]
    assert recording.group == group
    assert recording.events == simulation.events
    assert recording.camera is not None
    np.testing.assert_allclose(recording.camera.K, simulation.camera.K, rtol=1e-6)
    np.testing.assert_allclose(recording.camera.distortion, simulation.camera.distortion, rtol=1e-6)
    masks, depth = recording.truth.masks, recording.truth.depth
    assert masks is not None
    assert depth is not None
    assert masks.t.tolist() == simulation.truth.t.tolist()
    written = simulation.truth.mask
    assert (written == MOVING).any()
    assert (written == STILL).any()
    for k in (0, len(masks) // 2, len(masks) - 1):
        mask = masks[k]
        assert ((mask == MOVING) == (written[k] == MOVING)).all()
        assert (mask[written[k] == STILL] == 0).all()
        assert (mask[written[k] == UNPOSED] == -1).all()
        np.testing.assert_allclose(depth[k], simulation.truth.depth[k], atol=6e-4)  # it is kept in mm


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_span_is_a_part(simulation: Simulation, tmp_path: Path, layout: str) -> None:
    name, write, _ = LAYOUTS[layout]
    write(tmp_path, simulation)
    events = simulation.events
    part = open_dataset(name, tmp_path).load(0, span=(0.02, 0.05)).events
    first = int(events.t[0])
    assert part == events.between(first + 20_000, first + 50_000)
    assert 0 < len(part) < len(events)


def test_frames_without_truth_are_left_out(simulation: Simulation, tmp_path: Path) -> None:
    """EVIMO2 v2 keeps the classical camera's frames where the poses are lost."""
    write_evimo2(tmp_path / "a", simulation)
    for what in ("mask", "depth"):
        path = tmp_path / "a" / f"dataset_{what}.npz"
        with np.load(path) as archive:
            kept = {key: archive[key] for key in archive.files if not key.endswith("0003")}
        np.savez(path, **kept)
    masks = open_dataset("evimo2", tmp_path)[0].truth.masks
    assert masks is not None
    assert len(masks) == len(simulation.truth.t) - 1
    assert 30_000 not in masks.t
    assert ((masks[3] == MOVING) == (simulation.truth.mask[4] == MOVING)).all()


def test_code_in_meta_is_not_run(simulation: Simulation, tmp_path: Path) -> None:
    write_evimo(tmp_path / "a.npz", simulation)

    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return print, ("run",)

    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    header = members["meta.npy"][: members["meta.npy"].index(b"\n") + 1]
    members["meta.npy"] = header + pickle.dumps(Trap())
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(DatasetError, match=r"a\.npz: meta: builtins\.print in it, which is not plain data"):
        open_dataset("evimo", tmp_path)[0]


def test_damage_is_named(simulation: Simulation, tmp_path: Path) -> None:
    write_text(tmp_path / "seq", simulation)
    (tmp_path / "seq" / "meta.txt").write_text("{'frames': ")
    with pytest.raises(DatasetError, match=r"meta\.txt: .*expected a Python dictionary"):
        open_dataset("evimo", tmp_path)[0]
    (tmp_path / "seq" / "meta.txt").write_text("{'frames': [], 'meta': {'res_x': nan}}")
    with pytest.raises(DatasetError, match="res_x is None, expected the sensor's size"):
        open_dataset("evimo", tmp_path)[0]
    with pytest.raises(DatasetError, match="holds no recording of evimo2, expected"):
        open_dataset("evimo2", tmp_path / "seq" / "img")


def pose(x: float = 0, z: float = 0, *, turn: float = 0) -> dict[str, dict[str, dict[str, float]]]:
    """Off the origin in m, turned about z by radians."""
    q = {"w": np.cos(turn / 2), "x": 0.0, "y": 0.0, "z": np.sin(turn / 2)}
    return {"pos": {"t": {"x": x, "y": 0.0, "z": z}, "q": q}}


def test_pose_matrix_by_hand() -> None:
    matrix = pose_matrix(pose(1, 2, turn=np.pi / 2)["pos"])
    np.testing.assert_allclose(matrix, [[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]], atol=1e-12)


def test_motion_is_judged_in_the_world() -> None:
    """The camera moves at 0.5 m/s; 1 moves with it, 2 stands, 3 moves on its own, 4 turns, 5 moves slowly."""
    trajectory = []
    for ts in np.arange(0, 0.5, 0.005):
        way = 0.5 * ts
        entry = {"ts": float(ts), "id": 7, "gt_frame": "x.png", "cam": pose(way)}
        entry |= {"1": pose(0, 1), "2": pose(-way, 1), "3": pose(-way, 1 + 0.2 * ts)}
        entry |= {"4": pose(-way, 1, turn=2 * ts), "5": pose(-way, 1 + 0.02 * ts)}
        if ts < 0.2:
            entry["6"] = pose(0, 1)
        trajectory.append(entry)
    early, late = moving_objects(trajectory, [0.1, 0.4])
    assert early == {1: True, 2: False, 3: True, 4: True, 5: False, 6: True}
    assert late == {1: True, 2: False, 3: True, 4: True, 5: False}
    assert moving_objects(trajectory, [0.1], min_speed=0.3)[0][3] is False


def test_moving_mask_by_hand() -> None:
    mask = np.array([[0, 1000, 2000], [3000, 22_000, 1000]], np.uint16)
    found = moving_mask(mask, {1: True, 2: False, 22: True})
    assert found.tolist() == [[0, 1, 0], [-1, 22, 1]]
