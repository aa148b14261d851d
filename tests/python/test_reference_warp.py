import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_windows import DISTSURF, WINDOWS, patient, recorded, recorded_window, true_pool
from scipy.spatial.transform import Rotation

from emseg.reference import (
    DEGREES_OF_FREEDOM,
    Camera,
    ImageFrame,
    MotionModel,
    iwe,
    make_window,
    undistortion_table,
    variance,
    warp,
    warp_points,
)

FRAME = ImageFrame(240, 180)
POINTS = np.random.default_rng(1).uniform((0, 0), (239, 179), (40, 2))
DT = np.random.default_rng(2).uniform(-0.02, 0.02, 40)
KINDS = list(DEGREES_OF_FREEDOM)


@pytest.mark.parametrize("kind", KINDS)
def test_zero_parameters_leave_every_event_in_place(kind):
    moved = warp_points(MotionModel.identity(kind), POINTS, DT, FRAME)
    np.testing.assert_allclose(moved, POINTS, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_events_at_t_ref_stay(kind):
    params = tuple(np.linspace(1, 3, DEGREES_OF_FREEDOM[kind]))
    np.testing.assert_allclose(
        warp_points(MotionModel(kind, params), POINTS, 0 * DT, FRAME), POINTS, atol=1e-9
    )


def test_translation_moves_against_the_velocity():
    moved = warp_points(
        MotionModel("translation", (100.0, -50.0)), np.array([[10.0, 20.0]]), np.array([0.01]), FRAME
    )
    np.testing.assert_allclose(moved, [[9.0, 20.5]])


def test_similarity_is_the_matrix_of_the_published_code():
    vx, vy, s, theta = 30.0, -20.0, 0.4, 0.9
    cos, sin = np.cos(theta), np.sin(theta)
    matrix = (1 + s) * np.array([(cos, -sin), (sin, cos)]) - np.eye(2)
    frame = ImageFrame(240, 180, centre=(7.0, 5.0))
    moved = warp_points(MotionModel("similarity", (vx, vy, s, theta)), POINTS, DT, frame)
    for x, dt, got in zip(POINTS, DT, moved, strict=True):
        np.testing.assert_allclose(got, x - dt * (np.array([vx, vy]) + matrix @ (x - [7.0, 5.0])))


def test_affine_turns_about_the_image_centre():
    model = MotionModel("affine", (0.0, 0.0, 1.0, 2.0, 3.0, 4.0))
    moved = warp_points(model, np.array([[119.5, 89.5], [129.5, 89.5]]), np.array([0.1, 0.1]), FRAME)
    np.testing.assert_allclose(moved, [[119.5, 89.5], [129.5 - 1.0, 89.5 - 3.0]])


def test_a_similarity_is_an_affinity_and_an_affinity_a_homography():
    s, theta = 0.3, -0.5
    a, b = (1 + s) * np.cos(theta) - 1, (1 + s) * np.sin(theta)
    similarity = warp_points(MotionModel("similarity", (5.0, 6.0, s, theta)), POINTS, DT, FRAME)
    affine = warp_points(MotionModel("affine", (5.0, 6.0, a, -b, b, a)), POINTS, DT, FRAME)
    homography = warp_points(MotionModel("homography", (5.0, 6.0, a, -b, b, a, 0.0, 0.0)), POINTS, DT, FRAME)
    np.testing.assert_allclose(similarity, affine)
    np.testing.assert_allclose(affine, homography)


def test_projective_rates_by_hand():
    model = MotionModel("homography", (0.0,) * 6 + (2.0, 1.0))
    point = np.array([[119.5 + 24.0, 89.5 - 12.0]])  # r = (0.1, -0.05) with f0 = 240
    moved = warp_points(model, point, np.array([0.5]), FRAME)
    np.testing.assert_allclose(moved, point - 0.5 * np.array([24.0, -12.0]) * (2.0 * 0.1 - 1.0 * 0.05))


def test_rotation_is_the_matrix_exponential():
    camera = Camera(200.0, 210.0, 118.0, 92.0)
    omega = np.array([3.0, -4.0, 9.0])
    moved = warp_points(MotionModel("rotation", tuple(omega)), POINTS, DT, ImageFrame(240, 180, camera))
    intrinsics = np.array([[200.0, 0, 118.0], [0, 210.0, 92.0], [0, 0, 1]])
    for x, dt, got in zip(POINTS, DT, moved, strict=True):
        f = Rotation.from_rotvec(-dt * omega).as_matrix() @ np.linalg.solve(intrinsics, [*x, 1.0])
        projected = intrinsics @ f
        np.testing.assert_allclose(got, projected[:2] / projected[2])


def test_rotation_behind_the_camera_is_nan():
    moved = warp_points(
        MotionModel("rotation", (0.0, np.pi, 0.0)), np.array([[100.0, 90.0]]), np.ones(1), FRAME
    )
    assert np.isnan(moved).all()


@patient
@given(st.tuples(*[st.floats(-300, 300)] * 2), st.floats(-0.05, 0.05))
def test_translations_add_up(velocity, dt):
    x, times = np.array([[50.0, 60.0]]), np.array([dt])
    once = warp_points(MotionModel("translation", velocity), x, times, FRAME)
    twice = warp_points(MotionModel("translation", velocity), once, times, FRAME)
    double = warp_points(MotionModel("translation", (2 * velocity[0], 2 * velocity[1])), x, times, FRAME)
    np.testing.assert_allclose(twice, double, atol=1e-9)


def test_wrong_kind_and_wrong_number_of_parameters_are_refused():
    with pytest.raises(ValueError, match="'shear'; expected one of translation"):
        MotionModel("shear", (0.0,))
    with pytest.raises(ValueError, match="expected 4"):
        MotionModel("similarity", (0.0, 0.0))


def test_time_shift_changes_nothing():
    t = np.array([5, 10, 30])
    windows = [make_window([1, 2, 3], [4, 5, 6], t + shift, width=8, height=8) for shift in (0, 10**12)]
    np.testing.assert_array_equal(windows[0].dt, windows[1].dt)


def test_disorder_and_strays_are_refused():
    with pytest.raises(ValueError, match="t falls after event 1; expected time order"):
        make_window([0, 0, 0], [0, 0, 0], [1, 2, 1], width=2, height=2)
    with pytest.raises(ValueError, match="outside the 2 x 2 sensor"):
        make_window([2], [0], [0], width=2, height=2)


@pytest.mark.parametrize(
    "camera",
    [
        DISTSURF,
        Camera(257.68, 257.62, 188.33, 131.59, distortion=(-0.3633, 0.1249, -0.0001, 0.0)),
        Camera(263.28, 263.70, 176.16, 125.10, distortion=(-0.384, 0.1547, 0.0008, 0.0003)),
        Camera(280.0, 281.0, 172.0, 131.0, distortion=(0.02, -0.004, 0.001, -0.0003), model="equidistant"),
    ],
)
def test_undistortion_is_opencvs(camera):
    cv2 = pytest.importorskip("cv2")
    table = undistortion_table(camera, 346, 260)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    assert table.shape == (260, 346, 2)
    # OpenCV's inverse is an iteration of a few steps; its forward model is a formula: ours goes through that.
    normalised = camera.bearing(table.reshape(-1, 2).astype(np.float64))
    if camera.model == "radtan":
        rays = np.column_stack([normalised, np.ones(len(normalised))])
        coefficients = np.array([*camera.distortion, 0.0, 0.0])[:4]
        distorted, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, coefficients)
    else:
        distorted = cv2.fisheye.distortPoints(normalised[:, None], matrix, np.array(camera.distortion))
    columns, rows = np.meshgrid(np.arange(346), np.arange(260))
    np.testing.assert_allclose(distorted[:, 0], np.column_stack([columns.ravel(), rows.ravel()]), atol=2e-4)


def test_a_lens_that_folds_back_is_refused():
    with pytest.raises(ValueError, match="cannot be inverted"):
        undistortion_table(Camera(100.0, 100.0, 50.0, 50.0, distortion=(-3.0,)), 100, 100)


@pytest.mark.parametrize("name", [name for name in WINDOWS if name.endswith("15k")])
def test_true_models_sharpen_the_recorded_windows(name):
    arrays = recorded(name)
    window = recorded_window(arrays)
    for label, model in enumerate(true_pool(arrays)):
        own = window.select(arrays["label"] == label)
        backwards = MotionModel(model.kind, tuple(-np.array(model.params)))
        still = variance(iwe(MotionModel.identity("similarity"), own))
        assert variance(iwe(model, own)) > 1.1 * still
        assert variance(iwe(backwards, own)) < still
        assert np.isfinite(warp(model, own)).all()
