"""Data sets but EV-IMO's, on small files made in the layouts that their makers describe."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import made_recordings
import numpy as np
import pytest

import emseg
from emseg.datasets import Dataset, DatasetError, known_datasets, open_dataset
from emseg.datasets.dsec import decode_rle

NAMES = ("evimo", "evimo2", "eed", "dvsmotion20", "distsurf", "hkust-ems", "ecd", "dsec", "mvsec", "sim")


def made(width: int, height: int, *, seed: int = 0) -> emseg.EventArray:
    rng = np.random.default_rng(seed)
    t = 1_000_000 + np.cumsum(rng.integers(0, 400, 300))
    x, y, p = rng.integers(0, width, 300), rng.integers(0, height, 300), rng.integers(0, 2, 300)
    return emseg.EventArray(x, y, t, p, width=width, height=height)


def write_text(path: Path, events: emseg.EventArray) -> None:
    """Lines "t x y p", t in s."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = zip(*(getattr(events, name).tolist() for name in "txyp"), strict=True)
    path.write_text("".join(f"{t / 1e6:.6f} {x} {y} {p}\n" for t, x, y, p in rows))


def test_the_registry_knows_them_all() -> None:
    assert tuple(known_datasets()) == NAMES
    assert all(entry.title and entry.source for entry in known_datasets().values())


@pytest.mark.parametrize("name", NAMES)
def test_what_is_not_there_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=f"{tmp_path}: holds no recording of {name}, expected"):
        open_dataset(name, tmp_path)
    with pytest.raises(DatasetError, match="missing: no such folder, expected the data set"):
        open_dataset(name, tmp_path / "missing")


def test_unknown_data_sets_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no data set 'imagenet', expected one of: evimo, evimo2, eed"):
        open_dataset("imagenet", tmp_path)


def test_other_packages_add_theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint("mine", "emseg.datasets.plain:ecd", "emseg.datasets")
    monkeypatch.setattr("emseg.datasets.registry.entry_points", lambda group: [point])
    write_text(tmp_path / "boxes_rotation" / "events.txt", made(240, 180))
    assert len(open_dataset("mine", tmp_path)) == 1


def test_eed(tmp_path: Path) -> None:
    events = made(190, 180)
    write_text(tmp_path / "fast_drone" / "events.txt", events)
    write_text(tmp_path / "light_variations" / "strobe" / "events_filtered.txt", events)
    (tmp_path / "fast_drone" / "images.txt").write_text("1.01 images/frame_00000000.png\n")
    (tmp_path / "fast_drone" / "boundingbox.txt").write_text("1.02,20,30,4,5\n1.01 10 20 30 40\n")
    dataset = open_dataset("eed", tmp_path)
    assert isinstance(dataset, Dataset)
    assert dataset.names == ("fast_drone", "light_variations/strobe")
    drone, strobe = dataset[0], dataset[1]
    assert (drone.events.width, drone.events.height) == (240, 180)
    for column in "xytp":
        np.testing.assert_array_equal(getattr(drone.events, column), getattr(events, column))
    assert drone.truth.boxes is not None
    assert drone.truth.boxes.t.tolist() == [1_010_000, 1_020_000]
    assert drone.truth.boxes.boxes.tolist() == [[10, 20, 30, 40], [20, 30, 4, 5]]
    assert strobe.truth.boxes is None
    assert strobe.group == "light_variations"


def test_eed_boxes_by_corners_and_damaged_ones(tmp_path: Path) -> None:
    write_text(tmp_path / "a" / "events.txt", made(190, 180))
    path = tmp_path / "a" / "boundingbox.txt"
    path.write_text("# t x1 y1 x2 y2 id\n1.5 10 20 14 28 3\n")
    boxes = open_dataset("eed", tmp_path)[0].truth.boxes
    assert boxes is not None
    assert boxes.boxes.tolist() == [[10, 20, 4, 8]]
    for line, problem in (("1 2 3", "expected t x y w h"), ("1 2 three 4 5", "expected numbers")):
        path.write_text(f"1 2 3 4 5\n{line}\n")
        with pytest.raises(DatasetError, match=rf"boundingbox.txt, line 2: '{line}', {problem}"):
            open_dataset("eed", tmp_path)[0]


def test_eed_bags(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="bags need the extra 'io'")
    for name in ("one", "two"):
        (tmp_path / "occlusions" / f"{name}.bag").parent.mkdir(exist_ok=True)
        (tmp_path / "occlusions" / f"{name}.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(DatasetError, match="occlusions: 2 bags, expected one"):
        open_dataset("eed", tmp_path)[0]


@pytest.mark.parametrize(
    ("name", "file", "focal"),
    [
        ("distsurf", "EMSGC_DATASET/DistSurf/hand/events.txt", 289.774042631025),
        ("hkust-ems", "hkust_EMS/cast/events_filtered.txt", 263.28364),
        ("hkust-ems", "hkust_EMS/corridor/events_filtered.txt", 262.76480588211632),
    ],
)
def test_recordings_of_emsgc(name: str, file: str, focal: float, tmp_path: Path) -> None:
    events = made(346, 260)
    write_text(tmp_path / file, events)
    recording = open_dataset(name, tmp_path)[0]
    assert recording.name == Path(file).parent.name
    assert recording.events == events
    assert recording.camera is not None
    assert recording.camera.fx == focal
    assert recording.truth.masks is recording.truth.labels is recording.truth.boxes is None


def test_dvsmotion20(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    events = made(346, 260)
    polarity = {"x": events.x, "y": events.y, "timeStamp": events.t, "polarity": events.p}
    path = tmp_path / "object-motion-data" / "hands_sequence" / "hands.mat"
    path.parent.mkdir(parents=True)
    scipy_io.savemat(path, {"aedat": {"data": {"polarity": polarity}}})
    dataset = open_dataset("dvsmotion20", tmp_path)
    assert dataset.names == ("object-motion-data/hands_sequence/hands",)
    assert dataset[0].events == events
    assert dataset[0].truth.scene == "moving"


def test_ecd(tmp_path: Path) -> None:
    events = made(240, 180)
    for name in ("boxes_rotation", "dynamic_6dof"):
        write_text(tmp_path / name / "events.txt", events)
    (tmp_path / "boxes_rotation" / "calib.txt").write_text("199 198 132 110 -0.36 0.15 -0.0002 -0.001 0\n")
    dataset = open_dataset("ecd", tmp_path)
    boxes, dynamic = dataset[0], dataset[1]
    assert boxes.events == dynamic.events == events
    assert boxes.truth.scene == "still"
    assert dynamic.truth.scene == "unknown"
    assert boxes.camera is not None
    assert boxes.camera.fx == 199
    assert dynamic.camera is None


def test_mvsec(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="HDF5 needs the extra 'io'")
    data = made_recordings.made_events(300)
    flow = np.zeros((3, 2, 260, 346))
    flow[1, :, 5, 6] = [3, -4]
    with h5py.File(tmp_path / "indoor_flying1_data.hdf5", "w") as file:
        table = np.stack([data.x, data.y, data.t / 1e6, 2.0 * data.p - 1], axis=1)
        file["davis/left/events"] = table
        file["davis/right/events"] = table[:7]
    with h5py.File(tmp_path / "indoor_flying1_gt.hdf5", "w") as file:
        file["davis/left/flow_dist"] = flow
        file["davis/left/flow_dist_ts"] = [1.0, 1.05, 1.1]
        file["davis/left/depth_image_raw"] = np.full((2, 260, 346), 2.5, np.float32)
        file["davis/left/depth_image_raw_ts"] = [1.0, 1.05]
    (tmp_path / "outdoor_day2_data.hdf5").write_bytes((tmp_path / "indoor_flying1_data.hdf5").read_bytes())
    np.savez(
        tmp_path / "outdoor_day2_gt_flow_dist.npz",
        timestamps=[1.0, 1.05, 1.1],
        x_flow_dist=flow[:, 0],
        y_flow_dist=flow[:, 1],
    )
    dataset = open_dataset("mvsec", tmp_path)
    assert dataset.names == ("indoor_flying1", "outdoor_day2")
    indoors, outdoors = dataset[0], dataset[1]
    assert indoors.name == "indoor_flying1"
    assert indoors.events == outdoors.events == data
    assert (indoors.truth.scene, outdoors.truth.scene) == ("still", "unknown")
    for recording in (indoors, outdoors):
        found = recording.truth.flow
        assert found is not None
        assert found.t_from.tolist() == [1_000_000, 1_050_000]
        assert found.t_to.tolist() == [1_050_000, 1_100_000]
        assert found.load(1)[5, 6].tolist() == [3, -4]
        assert np.isnan(found.load(1)).sum() == 2 * (260 * 346 - 1)
    assert indoors.truth.depth is not None
    assert indoors.truth.depth[1][0, 0] == 2.5


def write_dsec(root: Path, events: emseg.EventArray) -> None:
    h5py = pytest.importorskip("h5py", reason="HDF5 needs the extra 'io'")
    folder = root / "train" / "zurich_city_00_a"
    (folder / "events" / "left").mkdir(parents=True)
    with h5py.File(folder / "events" / "left" / "events.h5", "w") as file:
        for name, column in (("t", events.t - 1_000_000), ("x", events.x), ("y", events.y), ("p", events.p)):
            file[f"events/{name}"] = column
        file["t_offset"] = 1_000_000
    (folder / "images").mkdir()
    (folder / "images" / "timestamps.txt").write_text("1000000\n1050000\n1100000\n")
    (folder / "calibration").mkdir()
    (folder / "calibration" / "cam_to_cam.yaml").write_text(
        "intrinsics:\n"
        "  cam0: {camera_model: pinhole, camera_matrix: [553, 553, 346, 216],\n"
        "         distortion_model: radtan, distortion_coeffs: [-0.09, 0.15, 0.0, 0.0],\n"
        "         resolution: [640, 480]}\n"
    )


def test_dsec_with_pictures_of_labels(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2", reason="PNG needs the extra 'viz'")
    events = made(640, 480)
    write_dsec(tmp_path, events)
    labels = np.zeros((480, 640), np.uint16)
    labels[10:20, 30:40], labels[50, 60] = 2005, 10_000
    folder = tmp_path / "mots" / "instances" / "zurich_city_00_a"
    folder.mkdir(parents=True)
    for number in (0, 2):
        cv2.imwrite(str(folder / f"{number:06d}.png"), labels)
    dataset = open_dataset("dsec", tmp_path)
    assert dataset.names == ("zurich_city_00_a",)
    recording = dataset[0]
    assert recording.events == events
    assert recording.camera is not None
    assert recording.camera.fx == 553
    masks = recording.truth.masks
    assert masks is not None
    assert masks.t.tolist() == [1_000_000, 1_100_000]
    assert (masks[1] == np.where(labels == 10_000, -1, labels)).all()


@pytest.mark.parametrize("folder", ["DSEC_MOS/training/zurich_city_00_a/gt_mask", "gt_mask/zurich_city_00_a"])
def test_dsec_with_masks_of_dsec_mos(tmp_path: Path, folder: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="PNG needs the extra 'viz'")
    write_dsec(tmp_path, made(640, 480))
    moving = np.zeros((480, 640), np.uint8)
    moving[10:20, 30:40], moving[50, 60] = 255, 1
    (tmp_path / folder).mkdir(parents=True)
    files = [tmp_path / folder / f"{number:06d}.png" for number in (1, 2, 3)]
    cv2.imwrite(str(files[0]), moving)
    cv2.imwrite(str(files[1]), np.stack([moving, 0 * moving, 0 * moving], axis=2))
    masks = open_dataset("dsec", tmp_path)[0].truth.masks
    assert masks is not None
    assert masks.t.tolist() == [1_050_000, 1_100_000]  # frames 1 and 2 of 0, 1, 2
    for k in range(2):
        assert (masks[k] == (moving > 0)).all()
    # Three frames, and a third picture: they count from 1.
    cv2.imwrite(str(files[2]), moving[:400])
    masks = open_dataset("dsec", tmp_path)[0].truth.masks
    assert masks is not None
    assert masks.t.tolist() == [1_000_000, 1_050_000, 1_100_000]
    with pytest.raises(DatasetError, match=r"000003\.png: shape \(400, 640\), expected the event camera's"):
        masks[2]


def encode_rle(mask: np.ndarray) -> str:
    """COCO's code of a mask, the other way round: run lengths, differences, letters."""
    flat = mask.T.ravel().astype(int)
    edges = np.flatnonzero(np.diff(flat)) + 1
    runs = np.diff([0, *edges, flat.size]).tolist()
    runs = [0, *runs] if flat[0] else runs
    code = ""
    for k, run in enumerate(runs):
        value = run - runs[k - 2] if k > 2 else run
        while True:
            group = value & 31
            value >>= 5
            more = value != (-1 if group & 16 else 0)
            code += chr(group + 32 * more + 48)
            if not more:
                break
    return code


def test_rle_by_hand_and_back() -> None:
    assert decode_rle("121", 2, 2).tolist() == [[False, True], [True, False]]  # by columns: off, 2 on, off
    rng = np.random.default_rng(1)
    for share in (0.02, 0.3, 0.9):
        mask = rng.random((48, 37)) < share
        assert (decode_rle(encode_rle(mask), 48, 37) == mask).all()
    block = np.zeros((48, 37), bool)
    block[:, 3:30] = True
    assert (decode_rle(encode_rle(block), 48, 37) == block).all()
    with pytest.raises(ValueError, match="run lengths of 3 pixels, expected 4"):
        decode_rle("12", 2, 2)
    with pytest.raises(ValueError, match="end in the midst of a number"):
        decode_rle("12P", 2, 2)


def test_dsec_with_text_of_labels(tmp_path: Path) -> None:
    write_dsec(tmp_path, made(640, 480))
    mask = np.zeros((480, 640), bool)
    mask[100:110, 200:230] = True
    path = tmp_path / "instances_txt" / "zurich_city_00_a.txt"
    path.parent.mkdir()
    path.write_text(f"1 2005 2 480 640 {encode_rle(mask)}\n1 10000 10 480 640 {encode_rle(~mask)}\n")
    masks = open_dataset("dsec", tmp_path)[0].truth.masks
    assert masks is not None
    assert masks.t.tolist() == [1_050_000]
    assert (masks[0] == np.where(mask, 2005, -1)).all()
    path.write_text("9 2005 2 480 640 abc\n")
    with pytest.raises(DatasetError, match=r"timestamps\.txt: 3 times, expected one for frame 9"):
        open_dataset("dsec", tmp_path)[0]
    path.write_text("1 2005 2 480\n")
    with pytest.raises(DatasetError, match="line 1: '1 2005 2 480', expected: frame track class"):
        open_dataset("dsec", tmp_path)[0]


def test_simulated(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(
        "duration: 0.05\nseed: 3\ncamera: {width: 48, height: 36, fx: 40}\n"
        "bodies:\n- shape: {kind: ball, radius: 0.4}\n  motion: {position: [0, 0, 2], velocity: [1, 0, 0]}\n"
        "- shape: {kind: rectangle, size: [9, 9]}\n  motion: {position: [0, 0, 4]}\n"
    )
    simulation = emseg.simulate(tmp_path / "small.yaml")
    simulation.save(tmp_path / "test" / "balls_11000.npz")
    recording = open_dataset("sim", tmp_path)[0]
    assert (recording.name, recording.group) == ("test/balls_11000", "balls")
    assert recording.events == simulation.events
    assert recording.truth.scene == "moving"
    np.testing.assert_array_equal(recording.truth.labels, simulation.owners)
    masks, flow = recording.truth.masks, recording.truth.flow
    assert masks is not None
    assert flow is not None
    np.testing.assert_array_equal(masks[2], simulation.truth.mask[2])
    np.testing.assert_allclose(flow.load(1), np.moveaxis(simulation.truth.flow[1], 0, -1), atol=0.01)
    start = int(simulation.events.t[0])
    part = open_dataset("sim", tmp_path).load(0, span=(0, 0.01))
    assert part.events == simulation.events.between(start, start + 10_000)
    assert part.truth.labels is not None
    assert len(part.truth.labels) == len(part.events)
