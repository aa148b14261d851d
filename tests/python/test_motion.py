"""Warps, images of warped events, contrast and its gradient: the engine against the reference."""

from __future__ import annotations

import numpy as np
import pytest
from engine_and_reference import (
    KINDS,
    event_array,
    lens,
    random_model,
    reference_model,
    reference_window,
    scattered_events,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import emseg
from emseg import _core, reference
from emseg.motion import points, warp_frame

SIZES = [(16, 12), (240, 180), (346, 260), (640, 480), (1280, 720)]
FLOAT32_STEP = 2.0**-23  # relative distance of neighbouring float32 numbers

seeds = st.integers(0, 2**32 - 1)
few = settings(max_examples=8, deadline=None)


@pytest.mark.parametrize("distorted", [False, True], ids=["pinhole", "lens"])
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("kind", KINDS)
@few
@given(seeds)
def test_warps_and_images_are_the_references(kind, size, distorted, seed):
    width, height = size
    rng = np.random.default_rng(seed)
    events = scattered_events(seed, 500, width=width, height=height)
    camera = lens(width, height) if distorted else None
    model = random_model(kind, rng, speed=2 * width)
    t_ref = int(rng.integers(events.t[0], events.t[-1]))
    window = reference_window(events, camera, t_ref=t_ref)

    warped = emseg.warp(events, model, t_ref, camera=camera)
    expected = reference.warp(reference_model(model), window)
    assert warped.dtype == np.float32
    # Places are float32, whose steps reach 1.2e-4 px from 1024 px on: two of them come on top of the 1e-4.
    np.testing.assert_allclose(warped, expected, atol=1e-4, rtol=2 * FLOAT32_STEP)

    image = emseg.iwe(events, model, t_ref, camera=camera)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image, reference.iwe(reference_model(model), window), atol=1e-4)


@pytest.mark.parametrize("sigma", [0.0, 0.5, 1.0, 2.3])
@pytest.mark.parametrize("kind", KINDS)
@few
@given(seeds)
def test_images_are_the_references_for_any_blur(kind, sigma, seed):
    events = scattered_events(seed, 1000, width=61, height=47)
    model = random_model(kind, np.random.default_rng(seed), speed=300.0)
    image = emseg.iwe(events, model, 1_020_000, sigma)
    window = reference_window(events, t_ref=1_020_000)
    np.testing.assert_allclose(image, reference.iwe(reference_model(model), window, sigma=sigma), atol=1e-4)


def test_rotations_past_the_horizon_cast_no_vote():
    events = scattered_events(0, 200)
    turn = emseg.MotionModel("rotation", [0.0, 100.0, 0.0])  # 5 rad over the window
    expected = reference.warp(reference_model(turn), reference_window(events))
    behind = np.isnan(expected).any(axis=1)
    assert behind.any()
    near = np.abs(np.nan_to_num(expected, nan=np.inf)).max(axis=1) < 1000
    assert near.any()
    warped = emseg.warp(events, turn)
    np.testing.assert_allclose(warped[near], expected[near], atol=0.01)
    inside = ((warped > -1) & (warped < (events.width, events.height))).all(axis=1)
    assert not inside[behind].any()
    assert np.isfinite(emseg.iwe(events, turn)).all()


def test_t_ref_is_the_middle_by_default():
    events = scattered_events(3, 50)
    model = emseg.MotionModel("translation", [300.0, -200.0])
    middle = (int(events.t[0]) + int(events.t[-1])) // 2
    np.testing.assert_array_equal(emseg.warp(events, model), emseg.warp(events, model, middle))
    np.testing.assert_array_equal(emseg.iwe(events, model), emseg.iwe(events, model, middle))


@pytest.mark.parametrize("kind", KINDS)
def test_no_motion_moves_nothing(kind):
    events = scattered_events(1, 100)
    still = emseg.warp(events, emseg.MotionModel(kind))
    np.testing.assert_allclose(still, np.column_stack([events.x, events.y]), atol=1e-4)


@pytest.mark.parametrize("measure", list(reference.CONTRASTS))
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=15, deadline=None)
@given(seeds)
def test_contrast_and_its_gradient_are_the_references(kind, measure, seed):
    """The gradient is exact: central differences of the reference, in double precision, agree with it.

    A bilinear vote has kinks at whole pixels, so events that come to lie within 1e-3 px of one are left out,
    and the differences' steps move no event by as much.
    """
    width, height = 61, 47
    rng = np.random.default_rng(seed)
    events = scattered_events(seed, 1500, width=width, height=height)
    model = random_model(kind, rng, speed=300.0)
    window = reference_window(events, t_ref=1_025_000)
    place = reference.warp(reference_model(model), window)
    smooth = (np.abs(place - np.rint(place)) > 1e-3).all(axis=1)
    events, window = events[smooth], window.select(smooth)
    assume(len(events) > 1000)  # along an axis that hardly moves, events stay on their pixels' kinks

    x, y, dt = points(events, 1_025_000, None)
    value, gradient = _core.contrast(
        x, y, dt, *model.native(), warp_frame(events, None), width, height, 1.0, measure
    )

    def contrast(params):
        image = reference.iwe(reference.MotionModel(kind, tuple(params)), window)
        return reference.CONTRASTS[measure](image)

    assert value == pytest.approx(contrast(model.params), rel=1e-5)

    before = np.floor(place[smooth])
    slopes, sensitivities = [], []
    for axis in np.eye(len(model.params)):
        step = 1e-6 * axis
        ends = [model.params - step, model.params + step]
        places = [reference.warp(reference.MotionModel(kind, tuple(end)), window) for end in ends]
        travel = np.abs(places[1] - places[0]).max()
        # As far as an event may go: half the distance to the kinks.
        step *= 5e-4 / travel
        ends = [model.params - step, model.params + step]
        for end in ends:
            assert (np.floor(reference.warp(reference.MotionModel(kind, tuple(end)), window)) == before).all()
        slopes.append((contrast(ends[1]) - contrast(ends[0])) / (2 * step.sum()))
        sensitivities.append(travel / 2e-6)  # px the farthest event moves by a unit of the parameter
    # In units of contrast by pixel of motion, parameters compare with each other.
    by_pixel, expected = gradient / sensitivities, np.array(slopes) / sensitivities
    np.testing.assert_allclose(by_pixel, expected, atol=1e-4 * np.abs(expected).max())


def test_contrast_of_one_event_by_hand():
    """An unblurred vote of 1 at (2.25, 3.5), on 8 x 6 pixels: shares .75 and .25 across, .5 and .5 down."""
    frame = _core.WarpFrame(8, 6)
    at = (np.array([2.25], np.float32), np.array([3.5], np.float32), np.array([-1.0], np.float32))
    value, gradient = _core.contrast(*at, "translation", [0.0, 0.0], frame, 8, 6, 0.0, "mean_square")
    assert value == pytest.approx((0.75**2 + 0.25**2) * 0.5 / 48)
    # x' = x + v: d/dx of ((1 - a)^2 + a^2) / 2 at a = .25 is (2a - 1); down it is flat at .5.
    np.testing.assert_allclose(gradient, [-0.5 / 48, 0.0], atol=1e-9)


def test_unknown_names_and_wrong_parameters_are_refused():
    with pytest.raises(ValueError, match="'zoom', expected one of translation, rotation"):
        emseg.MotionModel("zoom")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"a similarity has 4 parameters, got an array of shape \(2,\)"):
        emseg.MotionModel("similarity", [1.0, 2.0])
    with pytest.raises(ValueError, match="must be finite"):
        emseg.MotionModel("translation", [np.nan, 0.0])
    events = event_array([1], [1], [1], width=8, height=8)
    with pytest.raises(ValueError, match="camera is 16x12, the events' sensor 8x8"):
        emseg.warp(events, emseg.MotionModel("translation"), camera=lens(16, 12))
    for sigma in (-1.0, np.nan, 1e6):
        with pytest.raises(ValueError, match="sigma"):
            emseg.iwe(events, emseg.MotionModel("translation"), sigma=sigma)


def test_models_are_values():
    model = emseg.MotionModel("translation", [1.0, 2.0], label=3)
    assert model == emseg.MotionModel("translation", (1, 2), 3)
    assert hash(model) == hash(emseg.MotionModel("translation", (1, 2), 3))
    assert model != emseg.MotionModel("translation", [1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        model.params[0] = 5.0
