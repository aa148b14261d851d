from dataclasses import replace

import numpy as np
import pytest
from reference_windows import PATCH_VELOCITIES, recorded, recorded_window, true_pool, two_patches

from emseg.metrics import one_to_one_accuracy
from emseg.reference import (
    Camera,
    FitOptions,
    ImageFrame,
    MotionModel,
    Region,
    SearchOptions,
    SegmentOptions,
    build_event_graph,
    iwe,
    labeling_energy,
    make_window,
    refine,
    segment,
    unary_costs,
    undistortion_table,
    variance,
)
from emseg.reference.energy import logarithmic_data_term, published_data_term, reference_sharpness

SMALL = SegmentOptions(
    fit=FitOptions(search=SearchOptions(translation_max=1000.0)), bracket_row=3, lambda_label=2000
)


def test_published_data_term_by_hand():
    np.testing.assert_allclose(
        published_data_term(np.array([[0.0, 5.0, 2.0, 6.0]]), 5.0), [[255.0, 0.0, 153.0, 0.0]]
    )
    np.testing.assert_allclose(published_data_term(np.zeros((1, 2)), 0.0), [[0.0, 0.0]])


def test_logarithmic_data_term_by_hand():
    cost = logarithmic_data_term(np.array([[0.0, 1.0, 2.0, 5.0, 9.0]]), 5.0)
    np.testing.assert_allclose(
        cost,
        [[255.0, 255 * np.log(4.2) / np.log(21), 255 * np.log(7 / 3) / np.log(21), 0.0, 0.0]],
        atol=1e-12,
    )
    np.testing.assert_allclose(logarithmic_data_term(np.zeros((1, 2)), 0.0), [[0.0, 0.0]])


def test_reference_sharpness_by_hand():
    best = np.arange(101) / 10  # 95 % quantile: 9.5
    values = np.column_stack([np.zeros(101), best])
    assert reference_sharpness(values, [3.0, 20.0], data_term="logarithmic") == pytest.approx(9.5)
    assert reference_sharpness(values, [3.0, 20.0], data_term="published") == 20.0


def test_canvas_is_half_the_image_plane_larger_on_every_side():
    assert ImageFrame(7, 4).canvas == Region(-3, -2, 13, 8)
    assert ImageFrame(7, 4, Camera(5.0, 5.0, 3.0, 2.0)).canvas == Region(-3, -2, 13, 8)
    camera = Camera(200.0, 200.0, 119.5, 89.5, distortion=(-0.3, 0.1))
    plane = ImageFrame(240, 180, camera).image_plane
    places = undistortion_table(camera, 240, 180)
    for axis, (first, length) in enumerate([(plane.x0, plane.width), (plane.y0, plane.height)]):
        low, high = places[..., axis].min(), places[..., axis].max()
        assert first <= low < first + 1
        assert first + length - 2 < high <= first + length - 1
    assert plane.x0 < 0
    assert plane.width > 240


@pytest.mark.parametrize("data_term", ["published", "logarithmic"])
def test_events_that_leave_the_sensor_keep_their_votes_up_to_the_edge_of_the_canvas(data_term):
    window = make_window([1] * 10 + [4] * 10, [4] * 20, range(20), width=8, height=8, t_ref=0)
    window = replace(window, dt=np.ones(20))
    outside = MotionModel("translation", (4.0, 0.0))  # to columns -3 and 0; the canvas begins at -4
    away = MotionModel("translation", (9.0, 0.0))  # to columns -8 and -5
    costs = unary_costs([outside, away], window, data_term=data_term)
    assert costs.tolist() == [[0, 255]] * 20


@pytest.mark.parametrize("data_term", ["published", "logarithmic"])
def test_two_patches_come_apart(data_term):
    window, label = two_patches()
    result = segment(window, replace(SMALL, data_term=data_term))
    assert len(np.unique(result.labels)) == 2
    assert one_to_one_accuracy(label, result.labels) > 0.95
    assert all(
        after <= before for before, after in zip(result.energy_trace, result.energy_trace[1:], strict=False)
    )


def test_energy_is_that_of_the_returned_labels_and_models():
    window, _ = two_patches()
    result = segment(window, SMALL)
    unary = unary_costs(result.models, window, data_term=SMALL.data_term)
    assert result.energy == result.energy_trace[-1]
    assert result.energy == labeling_energy(
        result.labels,
        unary,
        build_event_graph(window.pixel),
        lambda_smooth=SMALL.lambda_smooth,
        label_cost=np.full(len(result.models), SMALL.lambda_label),
    )


def test_refined_models_are_fed_back():
    """Started a pixel off, the models move towards the truth and the energy falls by it."""
    window, _ = two_patches()
    off = [MotionModel("translation", tuple(v + 25.0)) for v in PATCH_VELOCITIES]
    result = segment(window, replace(SMALL, num_iter_segmentation=5), pool=off)
    for model, start, truth in zip(result.models, off, PATCH_VELOCITIES, strict=True):
        assert np.linalg.norm(model.params - truth) < np.linalg.norm(start.params - truth)
    assert result.energy < segment(window, replace(SMALL, num_iter_segmentation=1), pool=off).energy_trace[0]


@pytest.mark.parametrize("data_term", ["published", "logarithmic"])
def test_a_sharper_model_that_costs_more_is_not_kept(data_term):
    """In this window the left patch's similarity can be sharpened, but only at the energy's expense."""
    window, _ = two_patches(5, points=30, events_per_point=12)
    pool = [MotionModel("similarity", (vx, vy, 0.0, 0.0)) for vx, vy in PATCH_VELOCITIES.tolist()]
    result = segment(window, replace(SMALL, data_term=data_term, num_iter_segmentation=1), pool=pool)
    assert len(np.unique(result.labels)) == 2
    sharper, contrast = refine(pool[0], window.select(result.labels == 0))
    assert contrast > variance(iwe(pool[0], window.select(result.labels == 0)))
    assert sharper != pool[0]
    assert result.models[0] == pool[0]


def test_the_published_search_segments_too():
    window, label = two_patches(points=25, events_per_point=12)
    search = SearchOptions(method="published", translation_max=1000.0)
    options = replace(SMALL, fit=FitOptions(kind="translation", search=search), bracket_row=2)
    assert one_to_one_accuracy(label, segment(window, options).labels) > 0.95
    assert SegmentOptions.published().fit.search.method == "published"


@pytest.mark.parametrize(
    ("x", "t"),
    [([3], [0]), ([3, 3, 3], [0, 5, 9]), ([1, 2, 6], [4, 4, 4])],
    ids=["one", "one pixel", "one time"],
)
def test_degenerate_windows_have_one_label(x, t):
    window = make_window(x, [2] * len(x), t, width=8, height=8)
    result = segment(window, SMALL)
    assert len(np.unique(result.labels)) == 1


def test_nothing_to_segment_is_refused():
    with pytest.raises(ValueError, match="without events"):
        segment(make_window([], [], [], width=8, height=8))
    with pytest.raises(ValueError, match="empty model pool"):
        segment(two_patches()[0], pool=[])
    with pytest.raises(ValueError, match="'robust'; expected 'published' or 'logarithmic'"):
        segment(
            two_patches()[0], replace(SMALL, data_term="robust"), pool=[MotionModel.identity("translation")]
        )


def test_with_the_true_models_at_least_as_accurate_as_the_published_code_and_no_dearer():
    arrays = recorded("240x180_15k")
    window, pool = recorded_window(arrays), true_pool(arrays)
    options = SegmentOptions(data_term="published", num_iter_segmentation=1)
    result = segment(window, options, pool=pool)
    published = arrays["labels_true_pool"].astype(np.int64)
    assert one_to_one_accuracy(arrays["label"], result.labels) >= one_to_one_accuracy(
        arrays["label"], published
    )

    labelled = np.maximum(published, 0)  # one event has no published label; it takes the first
    theirs = labeling_energy(
        labelled,
        unary_costs(pool, window, data_term="published"),
        build_event_graph(window.pixel),
        lambda_smooth=options.lambda_smooth,
        label_cost=np.full(len(pool), options.lambda_label),
    )
    assert result.energy <= theirs
