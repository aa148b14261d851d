"""Files of simulated recordings: npz, the layouts of EV-IMO, the suite's folder, the command line."""

from __future__ import annotations

import ast
import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import emseg
from emseg.cli import app
from emseg.simulation import Scene, Simulation
from emseg.simulation.evimo import write_evimo, write_evimo2, write_text
from emseg.simulation.generate import generate, suite_jobs, write_manifest
from emseg.simulation.suite import NAMES, suite_scene

SCENE = """
duration: 0.03
seed: 4
camera: {width: 64, height: 48, motion: {velocity: [0.5, 0, 0]}, fx: 60, distortion: [-0.1, 0.01, 0, 0]}
sensor: {shot_noise: 1}
bodies:
- shape: {kind: rectangle, size: [9, 9]}
  motion: {position: [0, 0, 3], rotation: [0, 10, 0]}
- shape: {kind: ball, radius: 0.3}
  motion: {position: [0, 0, 2], velocity: [1, 0, 0], spin: [0, 90, 0]}
"""


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "small.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def simulation(scene_file: Path) -> Simulation:
    return emseg.simulate(scene_file)


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_npz_holds_everything(simulation: Simulation, tmp_path: Path) -> None:
    simulation.save(tmp_path / "small.npz")
    events = emseg.read(tmp_path / "small.npz")
    assert events == simulation.events
    with np.load(tmp_path / "small.npz", allow_pickle=False) as arrays:
        assert arrays["label"].dtype == np.int8
        np.testing.assert_array_equal(arrays["label"], simulation.owners)
        assert (int(arrays["width"]), int(arrays["height"])) == (64, 48)
        assert arrays["gt_t"].tolist() == [0, 10_000, 20_000, 30_000]
        assert arrays["gt_mask"].shape == arrays["gt_depth"].shape == (4, 48, 64)
        assert arrays["gt_flow"].shape == (4, 2, 48, 64)
        assert arrays["gt_T_world_camera"].shape == (4, 4, 4)
        assert arrays["gt_T_world_object"].shape == (4, 1, 4, 4)
        assert arrays["gt_object_label"].tolist() == [1]
        assert len(arrays["imu_t"]) == len(arrays["imu_gyro"]) == 7
        np.testing.assert_array_equal(arrays["K"], simulation.camera.K)
        assert arrays["D"].tolist() == [-0.1, 0.01, 0, 0]
        (tmp_path / "again.yaml").write_text(str(arrays["scene"]))
    assert Scene.from_yaml(tmp_path / "again.yaml") == simulation.scene


def test_the_same_scene_gives_the_same_bytes(scene_file: Path, tmp_path: Path) -> None:
    for threads in (1, 3):
        emseg.simulate(scene_file, threads=threads).save(tmp_path / f"{threads}.npz")
    assert digest(tmp_path / "1.npz") == digest(tmp_path / "3.npz")
    other = Scene.from_yaml(scene_file).model_copy(update={"seed": 5})
    emseg.simulate(other).save(tmp_path / "other.npz")
    assert digest(tmp_path / "other.npz") != digest(tmp_path / "1.npz")


def test_truth_can_be_left_out(scene_file: Path, simulation: Simulation) -> None:
    bare = emseg.simulate(scene_file, truth="poses")
    assert bare.events == simulation.events
    assert len(bare.truth.mask) == 0
    np.testing.assert_array_equal(bare.truth.T_world_object, simulation.truth.T_world_object)


# --- EV-IMO ------------------------------------------------------------------------------------------------


def check_meta(meta: dict, simulation: Simulation) -> None:
    assert meta["meta"]["fx"] == 60
    assert meta["meta"]["k1"] == -0.1
    assert (meta["meta"]["res_x"], meta["meta"]["res_y"]) == (64, 48)
    assert [frame["ts"] for frame in meta["frames"]] == [0, 0.01, 0.02, 0.03]
    assert len(meta["full_trajectory"]) == 7
    assert len(meta["imu"]["/simulated/imu"]) == 7
    frame = meta["frames"][2]
    # The ball is where its motion takes it, seen from the camera.
    t = frame["1"]["pos"]["t"]
    assert (t["x"], t["y"], t["z"]) == pytest.approx((0.02 * (1 - 0.5), 0, 2), abs=1e-8)
    q = frame["1"]["pos"]["q"]
    half = np.radians(90 * 0.02) / 2
    assert (q["w"], q["y"]) == pytest.approx((np.cos(half), np.sin(half)), abs=1e-8)
    assert frame["cam"]["pos"]["t"]["x"] == pytest.approx(0.01, abs=1e-8)


def test_evimo2_folder(simulation: Simulation, tmp_path: Path) -> None:
    write_evimo2(tmp_path / "seq", simulation)
    folder = tmp_path / "seq"
    xy = np.load(folder / "dataset_events_xy.npy", mmap_mode="r")
    t = np.load(folder / "dataset_events_t.npy", mmap_mode="r")
    p = np.load(folder / "dataset_events_p.npy", mmap_mode="r")
    np.testing.assert_array_equal(np.rint(t * 1e6), simulation.events.t)
    np.testing.assert_array_equal(xy[:, 0], simulation.events.x)
    np.testing.assert_array_equal(xy[:, 1], simulation.events.y)
    np.testing.assert_array_equal(p, simulation.events.p)
    with np.load(folder / "dataset_depth.npz") as depth, np.load(folder / "dataset_mask.npz") as mask:
        assert sorted(depth.files) == [f"depth_{k:010d}" for k in range(4)]
        assert depth["depth_0000000001"].dtype == np.uint16
        assert np.abs(depth["depth_0000000001"] - 1000 * simulation.truth.depth[1]).max() <= 0.5
        np.testing.assert_array_equal(mask["mask_0000000001"], 1000 * simulation.truth.mask[1].astype(int))
    with np.load(folder / "dataset_info.npz", allow_pickle=True) as info:
        assert set(info.files) == {"K", "D", "index", "discretization", "meta"}
        index = info["index"]
        assert float(info["discretization"]) == 0.01
        for k, first in enumerate(index):
            assert (simulation.events.t[:first] < 10_000 * k).all()
            assert (simulation.events.t[first:] >= 10_000 * k).all()
        check_meta(info["meta"].item(), simulation)
    with np.load(folder / "dataset_classical.npz") as frames:
        assert frames["classical_0000000000"].shape == (48, 64)


def test_evimo_file(simulation: Simulation, tmp_path: Path) -> None:
    write_evimo(tmp_path / "seq.npz", simulation)
    with np.load(tmp_path / "seq.npz", allow_pickle=True) as arrays:
        events = arrays["events"]
        np.testing.assert_array_equal(np.rint(events[:, 0] * 1e6), simulation.events.t)
        np.testing.assert_array_equal(events[:, 1], simulation.events.x)
        np.testing.assert_array_equal(events[:, 3], simulation.events.p)
        assert arrays["depth"].shape == arrays["mask"].shape == (4, 48, 64)
        assert set(np.unique(arrays["mask"])) == {0, 1000}
        check_meta(arrays["meta"].item(), simulation)


def test_text_folder(simulation: Simulation, tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    write_text(tmp_path / "seq", simulation)
    rows = np.loadtxt(tmp_path / "seq" / "events.txt")
    np.testing.assert_array_equal(np.rint(rows[:, 0] * 1e6), simulation.events.t)
    np.testing.assert_array_equal(rows[:, 2], simulation.events.y)
    check_meta(ast.literal_eval((tmp_path / "seq" / "meta.txt").read_text()), simulation)
    image = cv2.imread(str(tmp_path / "seq" / "img" / "depth_mask_1.png"), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.uint16
    np.testing.assert_array_equal(image[..., 2], 1000 * simulation.truth.mask[1].astype(int))
    for channel in (0, 1):
        assert np.abs(image[..., channel] - 1000 * simulation.truth.depth[1]).max() <= 0.5
    grey = cv2.imread(str(tmp_path / "seq" / "img" / "img_1.png"), cv2.IMREAD_UNCHANGED)
    assert np.abs(grey - 255 * simulation.truth.frame[1]).max() <= 0.51


def test_layouts_need_the_truth(scene_file: Path, tmp_path: Path) -> None:
    bare = emseg.simulate(scene_file, truth="poses")
    with pytest.raises(ValueError, match="expected truth='all'"):
        write_evimo2(tmp_path / "seq", bare)
    assert not (tmp_path / "seq").exists()


# --- the suite ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_of_the_suite_simulates(name: str) -> None:
    """Small and short; objects' events lie on their masks or a step of motion beside them."""
    scene = suite_scene(name, 5, duration=0.03)
    small = scene.camera.model_copy(
        update={"width": 120, "height": 90, "fx": round(120 / scene.camera.width * (scene.camera.fx or 1), 3)}
    )
    simulation = emseg.simulate(scene.model_copy(update={"camera": small}))
    assert len(simulation.events) > 50
    masks = simulation.truth.mask
    assert set(np.unique(masks)) <= {0, *simulation.truth.labels}
    for label in simulation.truth.labels:
        seen = (masks == label).any(axis=0)
        for axis in (0, 1):
            seen = seen | np.roll(seen, 1, axis) | np.roll(seen, -1, axis)
            seen = seen | np.roll(seen, 1, axis) | np.roll(seen, -1, axis)
        mine = simulation.owners == label
        assert (
            seen[simulation.events.y[mine], simulation.events.x[mine]].mean() > 0.99 if mine.any() else True
        )


def test_the_suite_is_resumed_and_does_not_depend_on_the_processes(tmp_path: Path) -> None:
    names = ["strobe", "behind_net"]
    one = suite_jobs(tmp_path / "one", range(2), names=names, duration=0.02)
    two = suite_jobs(tmp_path / "two", range(2), names=names, duration=0.02)
    assert [outcome.status for outcome in generate(one)] == ["done"] * 4
    assert [outcome.status for outcome in generate(two, processes=2)] == ["done"] * 4
    for a, b in zip(one, two, strict=True):
        assert digest(a.target) == digest(b.target)
    assert write_manifest(one).read_bytes() == write_manifest(two).read_bytes()

    # A recording that is missing, cut off or of another length is made again, the others are not.
    before = digest(one[0].target)
    os.truncate(one[0].target, 1000)
    one[1].target.unlink()
    assert [outcome.status for outcome in generate(one)] == ["done", "done", "skipped", "skipped"]
    assert digest(one[0].target) == before
    longer = suite_jobs(tmp_path / "one", range(1), names=["strobe"], duration=0.03)
    assert [outcome.status for outcome in generate(longer)] == ["done"]
    assert not [path for path in (tmp_path / "one").rglob(".*")]

    listed = json.loads(write_manifest(longer).read_text())["recordings"]
    assert [entry["file"] for entry in listed] == sorted(
        f"train/{n}_0000{k}.npz" for n in names for k in (0, 1)
    )
    for entry in listed:
        assert entry["sha256"] == digest(tmp_path / "one" / entry["file"])
        assert entry["events"] == sum(entry["events_by_label"].values())
        assert entry["split"] == "train"


# --- the command line --------------------------------------------------------------------------------------


def run(*arguments: str):
    return CliRunner().invoke(app, ["simulate", *arguments])


@pytest.mark.parametrize(
    ("layout", "out"), [("npz", "a.npz"), ("evimo2", "a"), ("evimo", "a.npz"), ("evimo-txt", "a")]
)
def test_simulate_a_scene(layout: str, out: str, scene_file: Path, tmp_path: Path) -> None:
    done = run(str(scene_file), "--out", str(tmp_path / out), "--format", layout)
    assert done.exit_code == 0, done.output
    assert "events" in done.output
    assert (tmp_path / out).exists()


def test_simulate_a_scene_of_the_suite_by_name(tmp_path: Path) -> None:
    one, two = tmp_path / "one.npz", tmp_path / "two.npz"
    for out, seed in ((one, "3"), (two, "4")):
        done = run("hands", "--out", str(out), "--seed", seed, "--duration", "0.02")
        assert done.exit_code == 0, done.output
    assert one.read_bytes() != two.read_bytes()
    failed = run("fast_dron", "--out", str(tmp_path / "none.npz"))
    assert failed.exit_code == 1
    assert failed.output.startswith("failed: fast_dron: no such file, nor a scene of the suite (")
    assert "did you mean 'fast_drone'?" in failed.output
    assert len(failed.output.strip().splitlines()) == 1


def test_simulate_says_what_is_wrong(scene_file: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.yaml"
    bad.write_text("duration: -1\nbodies: [{person: {}}]\n")
    failed = run(str(bad), "--out", str(tmp_path / "a.npz"))
    assert failed.exit_code == 1
    assert "bad.yaml: duration: Input should be greater than 0, not -1" in failed.output
    assert len(failed.output.strip().splitlines()) == 1
    bent = tmp_path / "bent.yaml"
    bent.write_text(
        "bodies: [{shape: {kind: mesh, vertices: [[0,0,0],[1,0,0],[1,1,0],[0,1,1]], faces: [[0,1,2,3]]}}]\n"
    )
    failed = run(str(bent), "--out", str(tmp_path / "a.npz"))
    assert failed.exit_code == 1
    assert "bent.yaml: mesh: face 0 is not flat" in failed.output
    assert run(str(tmp_path / "none.yaml"), "--out", "a").exit_code == 1
    assert run(str(scene_file)).exit_code == 2
    assert run().exit_code == 2
    assert run(str(scene_file), "--suite", str(tmp_path)).exit_code == 2
    assert not (tmp_path / "a.npz").exists()


def test_simulate_the_suite(tmp_path: Path) -> None:
    done = run("--suite", str(tmp_path), "--seeds", "0:1", "--scenes", "strobe", "--duration", "0.02")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "train" / "strobe_00000.npz").exists()
    assert "manifest.json" in done.output
    again = run("--suite", str(tmp_path), "--seeds", "0:1", "--scenes", "strobe", "--duration", "0.02")
    assert "skipped" in again.output
    for wrong in (["--seeds", "1"], ["--seeds", "2:1"], ["--scenes", "hand"], ["--seeds", "11999:12001"]):
        failed = run("--suite", str(tmp_path), *wrong)
        assert failed.exit_code == 1
        assert "expected" in failed.output
