import numpy as np
import pytest
from reference_windows import PATCH_VELOCITIES, WINDOWS, recorded, recorded_window, two_patches

from emseg.reference import (
    DEGREES_OF_FREEDOM,
    FitOptions,
    MotionModel,
    SearchOptions,
    fit_motion,
    iwe,
    make_window,
    refine,
    search,
    sub_volumes,
    variance,
    warp,
)
from emseg.reference.fit import central_difference
from emseg.reference.search import grid_search, half_range, meeting_pairs

PUBLISHED_POOL_SIZES = dict(zip(WINDOWS, (42, 42, 42, 55, 51, 42, 68, 54, 69), strict=True))


def test_grid_search_closes_in_on_the_peak_within_its_last_step():
    peak = np.array([1.3, -37.0])
    trials = []

    def score(x):
        trials.append(x)
        return -np.abs(x - peak).sum()

    best = grid_search(score, np.array([4.0, 100.0]), levels=7)
    assert len(trials) == 1 + 7 * 25
    assert (np.abs(best - peak) <= np.array([4.0, 100.0]) / 2**7).all()


def test_published_search_finds_the_published_model():
    """Whole image, translations: the published code's first model is this grid point, moved by .0003."""
    arrays = recorded("240x180_30k")
    found = search(recorded_window(arrays), "translation", options=SearchOptions(method="published"))
    np.testing.assert_allclose(found.params, arrays["pool_translation_pool"][0, :2], atol=1e-2)


@pytest.mark.parametrize("name", WINDOWS)
def test_as_many_sub_volumes_as_the_published_code_keeps(name):
    window = recorded_window(recorded(name))
    assert len(sub_volumes(window, bracket_row=6)) == PUBLISHED_POOL_SIZES[name]


def test_sub_volumes_cover_the_image_and_keep_the_dense_ones():
    window = make_window([0] * 8 + [4, 4], [0] * 8 + [2, 2], range(10), width=5, height=3)
    whole, *quarters = sub_volumes(window, bracket_row=2)
    assert whole.all()
    # 2 x 1, 3 x 1, 2 x 2 and 3 x 2 pixels: 8, 0, 0 and 2 events; the least is 0.75 * 10 / 15 = 0.5 a pixel
    assert [mask.sum() for mask in quarters] == [8]


@pytest.mark.parametrize("patch", [0, 1])
def test_coarse_to_fine_search_finds_a_patchs_velocity(patch):
    window, label = two_patches()
    found = search(
        window.select(label == patch), "translation", options=SearchOptions(translation_max=1000.0)
    )
    assert np.abs(np.array(found.params) - PATCH_VELOCITIES[patch]).max() * 0.04 < 1.0  # px over the window


@pytest.mark.parametrize("kind", list(DEGREES_OF_FREEDOM))
def test_every_kind_fits_a_patch_within_a_pixel(kind):
    window, label = two_patches()
    patch = window.select(label == 1)
    options = FitOptions(kind=kind, search=SearchOptions(translation_max=1000.0))
    model, contrast = fit_motion(patch, options)
    assert model.kind == kind
    assert contrast == variance(iwe(model, patch))
    truth = warp(MotionModel("translation", tuple(PATCH_VELOCITIES[1])), patch)
    assert np.sqrt(np.mean(np.sum((warp(model, patch) - truth) ** 2, axis=1))) < 1.0


def test_published_search_fits_a_patch():
    window, label = two_patches()
    options = FitOptions(kind="translation", search=SearchOptions(method="published", translation_max=1000.0))
    model, _ = fit_motion(window.select(label == 0), options)
    assert np.abs(np.array(model.params) - PATCH_VELOCITIES[0]).max() * 0.04 < 0.5


def test_refinement_never_loses_contrast_and_stays_within_reach():
    window, _ = two_patches()
    reach = 2 * half_range("similarity", window.frame, SearchOptions())
    rng = np.random.default_rng(3)
    for _ in range(5):
        start = MotionModel("similarity", tuple(rng.uniform(-1, 1, 4) * [300, 300, 0.9, 2.5]))
        subset = window.select(rng.random(len(window)) < 0.2)
        model, contrast = refine(start, subset)
        assert contrast >= variance(iwe(start, subset))
        assert (np.abs(model.params) <= reach).all()


def test_events_of_a_collapsing_window_do_not_collapse():
    """A strongly expanding scene would be sharpest drawn into one point; the model stays a plausible one."""
    window, _ = two_patches()
    model, _ = refine(MotionModel("similarity", (0.0, 0.0, 0.9, 0.0)), window)
    assert abs(model.params[2]) <= 1.0


def test_meeting_pairs_by_hand():
    position = np.array([[0.0, 0.0], [1.0, 1.0], [10.0, 0.0], [0.5, 1.5], [11.0, 1.0]])
    dt = np.array([0.0, 0.0, 0.1, 0.0, 0.1])
    assert meeting_pairs(position, dt, np.zeros(2)) == 3 * 2 + 2 * 1
    assert meeting_pairs(position, dt, np.array([100.0, 0.0])) == 5 * 4
    assert meeting_pairs(np.empty((0, 2)), np.empty(0), np.zeros(2)) == 0


def test_central_difference_of_a_parabola_is_exact():
    gradient = central_difference(lambda x: float(x[0] ** 2 + 3 * x[0] * x[1]), np.array([2.0, -1.0]), 0.1)
    np.testing.assert_allclose(gradient, [2 * 2 - 3, 6])


@pytest.mark.parametrize("times", [[7], [7, 7, 7]])
def test_a_window_without_duration_has_no_motion(times):
    pixels = list(range(len(times)))
    window = make_window(pixels, pixels, times, width=8, height=8)
    model, _ = fit_motion(window, FitOptions(kind="translation"))
    assert model.params == (0.0, 0.0)
