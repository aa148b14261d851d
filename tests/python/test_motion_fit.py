"""fit_motion: one motion by contrast maximisation, on made events and on real rotations."""

from __future__ import annotations

import numpy as np
import pytest
from engine_and_reference import (
    KINDS,
    event_array,
    lens,
    real,
    reference_model,
    reference_window,
    scattered_events,
)
from scipy import optimize

import emseg
from emseg import reference

MOTIONS = {
    "translation": [180.0, -110.0],
    "rotation": [0.5, -0.9, 0.6],
    "similarity": [150.0, 80.0, 0.5, 0.8],
    "affine": [-120.0, 140.0, 0.6, -0.5, 0.4, -0.3],
    "homography": [140.0, -100.0, 0.4, -0.4, 0.3, 0.5, 0.4, -0.3],
}
DURATION = 50_000  # µs


def events_of(kind: str, *, seed: int = 0, camera: emseg.Camera | None = None) -> emseg.EventArray:
    """Events of 500 points that move by MOTIONS[kind] for 50 ms about t_ref = 1.025 s, rounded to pixels."""
    width, height = 240, 180
    rng = np.random.default_rng(seed)
    t = 1_000_000 + np.sort(rng.integers(0, DURATION, 10_000))
    place = rng.uniform((25, 25), (215, 155), (500, 2))[rng.integers(0, 500, len(t))]
    # The pixel that the warp brings to its place, as the fixed point of an iteration.
    window = reference_window(
        event_array(*[np.zeros(len(t))] * 2, t, width=width, height=height), t_ref=1_025_000
    )
    pinhole = reference.Camera(camera.fx, camera.fy, camera.cx, camera.cy) if camera else None
    frame = reference.ImageFrame(width, height, pinhole)
    model = reference.MotionModel(kind, tuple(MOTIONS[kind]))
    position = place.copy()
    for _ in range(20):
        position += place - reference.warp_points(model, position, window.dt, frame)
    if camera:
        position = reference.Camera(
            camera.fx, camera.fy, camera.cx, camera.cy, distortion=camera.distortion
        ).distort(position)
    pixel = np.rint(position).astype(int)
    return event_array(pixel[:, 0], pixel[:, 1], t, width=width, height=height)


def root_mean_square(places: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(places**2, axis=1))))


@pytest.mark.parametrize("distorted", [False, True], ids=["pinhole", "lens"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_recovered_to_a_third_of_a_pixel(kind, distorted):
    """Rounding to pixels alone scatters an event by 0.41 px; over 10,000 of them the fit averages it out."""
    camera = lens(240, 180) if distorted else None
    events = events_of(kind, camera=camera)
    model, contrast = emseg.fit_motion(events, kind, t_ref=1_025_000, camera=camera)
    assert model.kind == kind
    truth = emseg.MotionModel(kind, MOTIONS[kind])
    window = reference_window(events, camera, t_ref=1_025_000)
    apart = reference.warp(reference_model(model), window) - reference.warp(reference_model(truth), window)
    assert root_mean_square(apart - apart.mean(axis=0)) < 1 / 3
    # A fit may shift all events alike between kinds only by what t_ref's choice fixes: nothing.
    assert np.abs(apart.mean(axis=0)).max() < 1 / 3

    image = reference.iwe(reference_model(model), window)
    assert contrast == pytest.approx(reference.variance(image), rel=1e-4)
    assert contrast >= reference.variance(reference.iwe(reference_model(truth), window)) * (1 - 1e-6)


@pytest.mark.parametrize("measure", list(reference.CONTRASTS))
def test_contrast_is_the_references_for_every_measure_and_blur(measure):
    events = events_of("translation")
    model, contrast = emseg.fit_motion(events, "translation", measure=measure, sigma=1.5)
    image = reference.iwe(reference_model(model), reference_window(events), sigma=1.5)
    assert contrast == pytest.approx(reference.CONTRASTS[measure](image), rel=1e-4)
    np.testing.assert_allclose(
        model.params, MOTIONS["translation"], atol=0.3 / 0.025
    )  # px in half the window


@pytest.mark.parametrize("threads", [2, 7])
def test_the_fit_does_not_depend_on_threads(threads):
    events = events_of("similarity")
    one, contrast = emseg.fit_motion(events, "similarity", threads=1)
    assert emseg.fit_motion(events, "similarity", threads=threads) == (one, contrast)


def test_a_limit_on_speed_is_kept():
    model, _ = emseg.fit_motion(events_of("translation"), "translation", max_speed=60.0)
    assert np.abs(model.params).max() <= 60.0


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_hardly_any_events_give_a_finite_model(kind, count):
    model, contrast = emseg.fit_motion(scattered_events(0, count), kind)
    assert np.isfinite(model.params).all()
    assert np.isfinite(contrast)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "zoom"}, "unknown motion model 'zoom'"),
        ({"measure": "entropy"}, "entropy"),
        ({"sigma": -1.0}, "sigma"),
        ({"max_speed": 0.0}, "max_speed is 0"),
        ({"max_speed": np.nan}, "max_speed is nan"),
        ({"max_scale_rate": -1.0}, "max_scale_rate is -1"),
        ({"max_angle_rate": np.inf}, "max_angle_rate is inf"),
        ({"threads": -1}, "-1"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        emseg.fit_motion(scattered_events(0, 10), **settings)


@pytest.mark.parametrize("name", ["boxes", "poster", "shapes"])
def test_real_rotations_are_recovered(name):
    """The angular velocity that a gyroscope measured while the camera turned before a still scene.

    The model is the scene's motion about the camera, so its sign is the other.  The sharpest image lies
    0.15 .. 0.18 of the gyroscope's norm away from it, for the reference as for the engine (below): 0.5 px,
    0.5 px and 1.8 px over the windows of 13, 24 and 99 ms.  A fifth of the norm leaves no room for a wrong
    axis or sign.
    """
    with np.load(real(f"{name}_rotation.npz")) as arrays:
        events = event_array(*(arrays[column] for column in "xyt"), width=240, height=180, p=arrays["p"])
    gyroscope = np.loadtxt(real(f"{name}_rotation_motion.txt"))
    camera = emseg.Camera.from_file(real("ecd_calib.txt"), width=240, height=180)
    model, contrast = emseg.fit_motion(events, "rotation", camera=camera)
    assert np.linalg.norm(model.params + gyroscope) < 0.2 * np.linalg.norm(gyroscope)

    window = reference_window(events, camera)

    def loss(omega: np.ndarray) -> float:
        image = reference.iwe(reference.MotionModel("rotation", tuple(omega)), window)
        return -reference.variance(image)

    assert contrast == pytest.approx(-loss(model.params), rel=1e-4)
    sharpest = optimize.minimize(loss, -gyroscope, method="Nelder-Mead", options={"maxfev": 120})
    assert contrast >= -sharpest.fun * (1 - 1e-3)
    duration = events.duration * 1e-6
    assert np.linalg.norm(model.params - sharpest.x) * duration * camera.fx < 0.2  # px over the window
