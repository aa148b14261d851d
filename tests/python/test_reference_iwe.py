import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_windows import patient, two_patches
from scipy import ndimage

from emseg.reference import (
    MotionModel,
    Window,
    bilinear_lookup,
    bilinear_votes,
    blur,
    gradient_magnitude,
    iwe,
    mean_square,
    variance,
    warp,
)

seeds = st.integers(0, 2**32 - 1)


def scattered(seed: int, count: int = 50) -> np.ndarray:
    """Points in and around an image of 12 x 9."""
    return np.random.default_rng(seed).uniform((-3, -3), (15, 12), (count, 2))


def tent_image(points: np.ndarray, width: int, height: int) -> np.ndarray:
    """The votes from their other definition: a tent max(0, 1 - |d|) in x times one in y, for every pixel."""
    across = np.maximum(0, 1 - np.abs(np.arange(width) - points[:, :1]))
    down = np.maximum(0, 1 - np.abs(np.arange(height) - points[:, 1:]))
    return down.T @ across


@patient
@given(seeds)
def test_votes_are_tents(seed):
    points = scattered(seed)
    np.testing.assert_allclose(bilinear_votes(points, 12, 9), tent_image(points, 12, 9), atol=1e-12)


def test_votes_on_pixels_borders_and_nowhere():
    points = np.array([[0.0, 0.0], [11.0, 8.0], [11.5, 8.0], [-1.0, 3.0], [np.nan, 2.0], [1e300, 1.0]])
    image = bilinear_votes(points, 12, 9)
    assert image[0, 0] == 1.0
    assert image[8, 11] == 1.5
    assert image.sum() == 2.5


@patient
@given(seeds)
def test_lookup_is_the_adjoint_of_the_votes(seed):
    points = scattered(seed)
    image = np.random.default_rng(seed).random((9, 12))
    np.testing.assert_allclose(
        bilinear_lookup(image, points).sum(), (bilinear_votes(points, 12, 9) * image).sum()
    )


@pytest.mark.parametrize("sigma", [0.0, 0.7, 1.0, 2.5])
def test_blur_is_scipys_gaussian_filter(sigma):
    image = np.random.default_rng(0).random((20, 30))
    expected = ndimage.gaussian_filter(image, sigma, mode="constant", truncate=4) if sigma else image
    np.testing.assert_allclose(blur(image, sigma), expected, atol=1e-14)


@patient
@given(seeds)
def test_order_of_events_does_not_matter(seed):
    window, _ = two_patches()
    order = np.random.default_rng(seed).permutation(len(window))
    shuffled = Window(window.position[order], window.pixel[order], window.dt[order], window.frame)
    model = MotionModel("similarity", (120.0, -60.0, 0.2, 0.4))
    np.testing.assert_allclose(iwe(model, shuffled), iwe(model, window), atol=1e-9)


@patient
@given(st.integers(-4, 4), st.integers(-4, 4))
def test_shifted_events_make_a_shifted_image(across, down):
    window, _ = two_patches()
    shifted = Window(window.position + np.array([across, down]), window.pixel, window.dt, window.frame)
    model = MotionModel("translation", (40.0, -30.0))
    inner = iwe(model, window)[10:-10, 10:-10]
    moved = iwe(model, shifted)[10 + down : 38 + down, 10 + across : 54 + across]
    np.testing.assert_allclose(moved, inner, atol=1e-9)


@patient
@given(seeds)
def test_mass_is_kept_while_events_stay_inside(seed):
    points = np.random.default_rng(seed).uniform((5, 5), (15, 15), (30, 2))
    image = blur(bilinear_votes(points, 21, 21), 1.0)
    np.testing.assert_allclose(image.sum(), 30.0)


def test_contrasts_by_hand():
    image = np.array([[0.0, 2.0], [0.0, 2.0]])
    assert variance(image) == 1.0
    assert mean_square(image) == 2.0
    # I_x = (2 - 0) / 2 left, (0 - 0) / 2 right; I_y = (0, 1) above, (0, -1) below
    assert gradient_magnitude(image) == pytest.approx((1.0 + (0.0 + 1.0) + 1.0 + (0.0 + 1.0)) / 4)


def test_the_true_motion_of_a_patch_is_sharper_than_none():
    window, label = two_patches()
    patch = window.select(label == 0)
    true = MotionModel("translation", (-150.0, 100.0))
    for contrast in (variance, mean_square, gradient_magnitude):
        sharpest = contrast(iwe(true, patch))
        assert sharpest > contrast(iwe(MotionModel.identity("translation"), patch))
        assert sharpest > contrast(iwe(MotionModel("translation", (150.0, -100.0)), patch))
    assert warp(true, patch).shape == (len(patch), 2)
