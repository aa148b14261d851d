"""Cameras against OpenCV, and calibration files."""

import pickle
from dataclasses import FrozenInstanceError
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emseg.camera import Camera

ECD_CALIBRATION = Path(__file__).parents[3] / "shared/data/real/ecd_calib.txt"

# The published calibrations: EED, EV-IMO, DistSurf, HKUST.
EED = Camera(240, 180, fx=250, fy=250, cx=120, cy=90)
SENSORS = {
    "eed": EED,
    "ev-imo": Camera(
        346, 260, fx=257.68, fy=257.62, cx=188.33, cy=131.59, distortion=(-0.3633, 0.1249, -0.0001, 0)
    ),
    "distsurf": Camera(
        346, 260, fx=289.77, fy=288.81, cx=185.98, cy=132.58, distortion=(-0.3617, 0.1587, 0, 0)
    ),
    "hkust": Camera(
        346, 260, fx=263.28, fy=263.70, cx=176.16, cy=125.10, distortion=(-0.384, 0.1547, 0.0008, 0.0003)
    ),
    "ecd": Camera(
        240,
        180,
        fx=199.092366542,
        fy=198.82882047,
        cx=132.192071378,
        cy=110.712660011,
        distortion=(-0.368436311798, 0.150947243557, -0.000296130534385, -0.000759431726241, 0.0),
    ),
    "fisheye": Camera(
        640,
        480,
        fx=290,
        fy=291,
        cx=322,
        cy=241,
        distortion=(-0.02, 0.004, -0.003, 0.0005),
        model="equidistant",
    ),
}


def pixel_grid(camera: Camera) -> np.ndarray:
    """Every pixel's x and y, float64 (height * width, 2), row by row."""
    y, x = np.mgrid[: camera.height, : camera.width]
    return np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)


def opencv_undistort(camera: Camera, points: np.ndarray) -> np.ndarray:
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-14)
    if camera.model == "equidistant":
        distortion = np.array(camera.distortion)
        out = cv2.fisheye.undistortPoints(
            points[:, None], camera.K, distortion, P=camera.K, criteria=(criteria[0], 100, 1e-14)
        )
    else:
        out = cv2.undistortPoints(
            points[:, None],
            camera.K,
            np.array(camera.distortion or (0.0,) * 4),
            P=camera.K,
            criteria=criteria,
        )
    return out.reshape(-1, 2)


@pytest.mark.parametrize("name", SENSORS)
def test_table_equals_opencv(name: str) -> None:
    camera = SENSORS[name]
    x, y = camera.undistortion_table()
    assert x.dtype == y.dtype == np.float32
    assert x.shape == y.shape == (camera.height, camera.width)
    expected = opencv_undistort(camera, pixel_grid(camera))
    ours = np.stack([x, y], axis=-1).reshape(-1, 2)
    # 1e-4 px is what float32 holds of a coordinate near 1000.
    assert np.abs(ours - expected).max() < 1e-4


@given(
    k=st.tuples(st.floats(-0.4, 0.1), st.floats(0.1, 0.2), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
    x=st.integers(0, 345),
    y=st.integers(0, 259),
)
@settings(max_examples=50)
def test_a_lens_of_opencv_is_inverted(k: tuple[float, ...], x: int, y: int) -> None:
    camera = Camera(346, 260, fx=260, fy=261, cx=176, cy=125, distortion=k)
    undistorted = camera.to_native().undistort_pixel(x, y)
    ray = np.linalg.solve(camera.K, [*undistorted, 1.0])
    back, _ = cv2.projectPoints(ray[None], np.zeros(3), np.zeros(3), camera.K, np.array(k))
    assert np.allclose(back.ravel(), [x, y], rtol=0, atol=1e-8)
    assert np.allclose(camera.to_native().distort_pixel(*undistorted), [x, y], rtol=0, atol=1e-8)


def test_intrinsic_matrix() -> None:
    assert EED.K.tolist() == [[250, 0, 120], [0, 250, 90], [0, 0, 1]]


def test_model_follows_the_coefficients() -> None:
    assert EED.model is None
    assert SENSORS["hkust"].model == "radtan"
    assert SENSORS["fisheye"].model == "equidistant"


def test_cameras_are_values() -> None:
    camera = SENSORS["hkust"]
    assert pickle.loads(pickle.dumps(camera)) == camera
    assert len({camera, SENSORS["distsurf"], camera}) == 2
    with pytest.raises(FrozenInstanceError):
        camera.fx = 3  # type: ignore[misc]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"width": 0}, "size is 0x180"),
        ({"height": 180.5}, "height is 180.5, expected a whole number"),
        ({"fx": -250.0}, "fx is -250"),
        ({"fy": float("nan")}, "fy is nan"),
        ({"cx": float("inf")}, "cx is inf"),
        ({"cy": "90"}, "cy is '90', expected a number"),
        ({"distortion": (0.1, 0.2)}, "2 distortion coefficients, expected 0 or 4 or 5 for radtan"),
        ({"distortion": (0.1, float("nan"), 0, 0)}, "coefficient is nan"),
        ({"distortion": (0, 0, 0, 0, 0), "model": "equidistant"}, "5 distortion coefficients, expected 4"),
        ({"model": "equidistant"}, "0 distortion coefficients, expected 4"),
        ({"model": "fov"}, "distortion model is 'fov'"),
        ({"distortion": (-5.0, 0, 0, 0)}, "no inverse at pixel"),
    ],
)
def test_what_is_no_camera_is_refused(change: dict[str, object], complaint: str) -> None:
    values: dict[str, object] = {"width": 240, "height": 180, "fx": 250, "fy": 250, "cx": 120, "cy": 90}
    with pytest.raises(ValueError, match=complaint):
        Camera(**{**values, **change})  # type: ignore[arg-type]


def test_reads_text(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text("199.1 198.8 132.2 110.7 -0.36 0.15 -0.0003 -0.0007 0.0\n")
    assert Camera.from_file(file, width=240, height=180) == Camera(
        240, 180, fx=199.1, fy=198.8, cx=132.2, cy=110.7, distortion=(-0.36, 0.15, -0.0003, -0.0007, 0.0)
    )
    file.write_text("250 250 120 90")
    assert Camera.from_file(file, width=240, height=180) == EED


def test_reads_yaml(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(
        "width: 640\nheight: 480\nfx: 290\nfy: 291\ncx: 322\ncy: 241\n"
        "model: equidistant\ndistortion: [-0.02, 0.004, -0.003, 0.0005]\n"
    )
    assert Camera.from_file(file) == SENSORS["fisheye"]
    assert Camera.from_file(file, width=640, height=480) == SENSORS["fisheye"]
    with pytest.raises(ValueError, match=r"camera\.yaml: width is 640, but 346 was asked for"):
        Camera.from_file(file, width=346)


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("a.txt", "1 2 x", "a.txt: expected the numbers 'fx fy cx cy k1 k2 p1 p2 k3'.*'x'"),
        ("a.txt", "1 2 3", "a.txt: 3 numbers"),
        ("a.txt", "250 -250 120 90", "a.txt: camera: fy is -250"),
        ("a.yaml", "fx: [", "a.yaml: not YAML"),
        ("a.yaml", "3", "a.yaml: expected a mapping"),
        ("a.yaml", "fx: 250\nfz: 3", "a.yaml: unknown camera fields fz"),
        ("a.yaml", "fx: 250\ncx: 3", "a.yaml: fy, cy missing"),
        ("a.yaml", "{fx: 250, fy: 250, cx: 120, cy: 90, distortion: 3}", "a.yaml: distortion is 3"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, content: str, complaint: str) -> None:
    file = tmp_path / name
    file.write_text(content)
    with pytest.raises(ValueError, match=complaint):
        Camera.from_file(file, width=240, height=180)


ROS = """
image_width: 346
image_height: 260
camera_name: davis
camera_matrix:
  rows: 3
  cols: 3
  data: [263.28, 0.0, 176.16, 0.0, 263.7, 125.1, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 4
  data: [-0.384, 0.1547, 8e-4, 0.0003]
"""
KALIBR = """
cam0:
  camera_model: pinhole
  intrinsics: [290, 291, 322, 241]
  distortion_model: equidistant
  distortion_coeffs: [-0.02, 0.004, -0.003, 0.0005]
  resolution: [640, 480]
  rostopic: /events
cam1:
  camera_model: pinhole
  intrinsics: [250, 250, 120, 90]
  distortion_model: none
  distortion_coeffs: []
  resolution: [240, 180]
"""
DSEC = """
intrinsics:
  cam0:
    camera_matrix: [289.77, 288.81, 185.98, 132.58]
    distortion_model: radtan
    distortion_coeffs: [-0.3617, 0.1587, 0, 0]
    resolution: [346, 260]
extrinsics:
  T_10: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""


@pytest.mark.parametrize(
    ("content", "name", "camera"),
    [
        (ROS, None, SENSORS["hkust"]),
        (KALIBR, None, SENSORS["fisheye"]),
        (KALIBR, "cam1", EED),
        (DSEC, None, SENSORS["distsurf"]),
        (DSEC, "cam0", SENSORS["distsurf"]),
    ],
)
def test_reads_the_calibrations_of_others(
    tmp_path: Path, content: str, name: str | None, camera: Camera
) -> None:
    file = tmp_path / "calibration.yaml"
    file.write_text(content)
    assert Camera.from_file(file, name=name) == camera
    assert Camera.from_file(file, width=camera.width, height=camera.height, name=name) == camera


@pytest.mark.parametrize(
    ("content", "old", "new", "complaint"),
    [
        (ROS, "plumb_bob", "rational_polynomial", "distortion_model is 'rational_polynomial', expected"),
        (ROS, "[263.28, 0.0,", "[263.28, 0.1,", "camera_matrix.data has skew 0.1, expected 0"),
        (ROS, ", 0.0, 0.0, 1.0]", "]", "camera_matrix.data is .* expected a list of 9 numbers"),
        (ROS, "8e-4", "often", "distortion_coefficients.data is .*'often'.*, expected numbers"),
        (ROS, "image_width: 346", "", "width missing"),
        (
            KALIBR,
            "camera_model: pinhole",
            "camera_model: omni",
            "cam0: camera_model is 'omni', expected 'pinhole'",
        ),
        (KALIBR, "[290, 291, 322, 241]", "[290, 291]", "cam0.intrinsics is .* expected a list of 4 numbers"),
        (KALIBR, "[640, 480]", "640", "cam0.resolution is 640, expected a list of 2 numbers"),
        (DSEC, "289.77", "-289.77", "camera: fx is -289.77"),
    ],
)
def test_bad_calibrations_of_others_are_named(
    tmp_path: Path, content: str, old: str, new: str, complaint: str
) -> None:
    file = tmp_path / "calibration.yaml"
    assert old in content
    file.write_text(content.replace(old, new))
    with pytest.raises(ValueError, match=rf"calibration\.yaml: .*{complaint}"):
        Camera.from_file(file)


def test_one_camera_of_several_is_chosen_by_name(tmp_path: Path) -> None:
    file = tmp_path / "calibration.yaml"
    file.write_text(KALIBR)
    with pytest.raises(ValueError, match="no camera 'cam7', expected one of: cam0, cam1"):
        Camera.from_file(file, name="cam7")
    file.write_text(ROS)
    with pytest.raises(ValueError, match="the file holds one, without a name"):
        Camera.from_file(file, name="cam0")


def test_text_needs_a_size(tmp_path: Path) -> None:
    file = tmp_path / "calib.txt"
    file.write_text("250 250 120 90")
    with pytest.raises(ValueError, match=r"calib\.txt: width, height missing"):
        Camera.from_file(file)
    with pytest.raises(FileNotFoundError):
        Camera.from_file(tmp_path / "absent.txt", width=1, height=1)


@pytest.mark.skipif(not ECD_CALIBRATION.is_file(), reason="needs the shared recordings in ../shared/data")
def test_reads_the_event_camera_dataset() -> None:
    assert Camera.from_file(ECD_CALIBRATION, width=240, height=180) == SENSORS["ecd"]
