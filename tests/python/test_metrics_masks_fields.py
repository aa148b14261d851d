"""Masks, depth and flow, by hand and against scikit-learn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reference_windows import patient

from emseg.metrics import (
    clusters_per_motion,
    depth_figures,
    dice,
    evaluate,
    event_moving_iou,
    event_object_iou,
    filled_hulls,
    flow_figures,
    mask_iou,
    moving_pixels,
    one_to_one_accuracy,
    pixel_accuracy,
    point_iou,
)

TRUTH = np.array([[1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 0, 0]])
FOUND = np.array([[0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]])
EVENTS = np.array([[1, 1, 1, 0], [0, 0, 0, 0], [0, 0, 1, 0]])


def test_masks_by_hand():
    assert mask_iou(TRUTH, FOUND) == 2 / 7
    assert dice(TRUTH, FOUND) == 4 / 9
    assert pixel_accuracy(TRUTH, FOUND) == 7 / 12
    assert mask_iou(TRUTH, FOUND, where=EVENTS) == 1 / 3
    assert dice(TRUTH, FOUND, where=EVENTS) == 2 / 4
    assert pixel_accuracy(TRUTH, FOUND, where=EVENTS) == 2 / 4
    nowhere = np.zeros((3, 4))
    for figure in (mask_iou, dice, pixel_accuracy):
        assert np.isnan(figure(TRUTH, FOUND, where=nowhere))
    assert np.isnan(mask_iou(nowhere, nowhere))
    assert pixel_accuracy(nowhere, nowhere) == 1


def test_masks_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"shapes \(3, 4\) and \(3,\); expected"):
        mask_iou(TRUTH, FOUND[:, 0])
    with pytest.raises(ValueError, match=r"shape \(4,\); expected the masks' \(3, 4\)"):
        dice(TRUTH, FOUND, where=[1, 0, 1, 0])
    with pytest.raises(ValueError, match=r"expected one shape"):
        point_iou(TRUTH, FOUND[:2], [], [], [])
    with pytest.raises(ValueError, match=r"pixels of shape \(2,\); expected \(2, 2\)"):
        evaluate([0, 1], [0, 1], pixels=[3, 4])


def test_a_pixel_moves_if_most_of_its_events_do():
    x, y = [0, 0, 0, 1, 1, 2], [0, 0, 0, 0, 0, 1]
    moving = [True, True, False, True, False, True]
    assert moving_pixels(x, y, moving, shape=(2, 3)).tolist() == [[True, False, False], [False, False, True]]


def test_event_masked_figures_of_a_window():
    # pixel A: both move; B: truth only; C: label only; D: neither; a noise event at E does not count
    pixels = [[0, 0], [1, 0], [0, 2], [3, 1], [5, 5]]
    figures = evaluate([1, 1, 0, 0, -1], [2, 0, 2, 0, 2], pixels=pixels)
    assert figures["mask_iou_event_masked"] == 1 / 3
    assert figures["dice"] == 0.5
    assert figures["pixel_accuracy"] == 0.5


def test_hulls_are_filled_label_by_label():
    x, y = [0, 4, 0, 6, 8, 0, 1, 9], [0, 0, 4, 6, 6, 7, 7, 9]
    labels = [1, 1, 1, 2, 2, 0, -1, 3]
    mask = filled_hulls(x, y, labels, shape=(10, 10))
    rows, columns = np.indices((10, 10))
    expected = rows + columns <= 4  # a triangle; a line and a point fill themselves only
    expected[6, [6, 8]] = expected[9, 9] = True
    assert (mask == expected).all()


def test_point_iou_by_hand():
    start, end = np.zeros((20, 20)), np.zeros((20, 20))
    start[4:10, 4:10] = 1
    end[4:10, 6:12] = 3
    # the union, rows 4-9 and columns 4-11, grows by 2 px to rows 2-11 and columns 2-13
    x = np.array([2, 13, 5, 5, 1, 14, 13])
    y = np.array([2, 11, 5, 5, 5, 5, 12])
    moving = np.array([True, False, False, True, True, False, False])
    # truth: pixels (2,2), (13,11), (5,5); found: (2,2), (5,5), (1,5)
    assert point_iou(start, end, x, y, moving) == 2 / 4
    assert np.isnan(point_iou(start, np.where(np.indices((20, 20))[1] < 4, 0, 0), x, y, moving))
    small = start.copy()
    small[4:6] = 0
    assert np.isnan(point_iou(small, end, x, y, moving))  # 24 px
    on, off = np.full(3, 5), np.full(6, 19)
    column = np.concatenate([on, off])
    assert point_iou(start, end, column, column, np.arange(9) < 3) == 1  # twice as many off: still kept
    column = np.append(column, 19)
    assert np.isnan(point_iou(start, end, column, column, np.arange(10) < 3))
    assert np.isnan(point_iou(start, end, [], [], []))


def test_depth_by_hand():
    truth = np.array([[1.0, 2.0, 4.0, 0.0], [np.nan, np.inf, 10.0, 5.0]])
    found = np.array([[1.2, 2.0, 3.0, 7.0], [0.0, 1.0, 5.0, 8.0]])
    figures = depth_figures(truth, found)
    # ratios 1.2, 1, 1.333, 2, 1.6
    assert figures["pixels"] == 5
    assert figures["abs_rel"] == pytest.approx((0.2 + 0 + 0.25 + 0.5 + 0.6) / 5)
    assert figures["rmse"] == pytest.approx(((0.04 + 0 + 1 + 25 + 9) / 5) ** 0.5)
    assert [figures[f"delta_{k}"] for k in (1, 2, 3)] == pytest.approx([2 / 5, 3 / 5, 4 / 5])
    assert depth_figures(truth, found, where=truth == 2)["rmse"] == 0
    assert np.isnan(depth_figures(truth, found, where=truth == 99)["abs_rel"])
    with pytest.raises(ValueError, match="not above 0"):
        depth_figures([1.0, 2.0], [1.0, 0.0])


def test_flow_by_hand():
    truth = np.array([[3.0, 4.0], [0.0, 0.0], [np.nan, 0.0], [1.0, 1.0]])
    found = np.array([[0.0, 0.0], [3.0, 0.0], [9.0, 9.0], [1.0, 1.0]])
    assert flow_figures(truth, found) == {"epe": 8 / 3, "3pe": pytest.approx(100 / 3), "pixels": 3}
    assert flow_figures(truth, found, where=[False, True, True, True])["3pe"] == 0  # 3 px is not above 3 px
    with pytest.raises(ValueError, match="not finite"):
        flow_figures(truth, np.full((4, 2), np.inf))
    with pytest.raises(ValueError, match=r"expected \(..., 2\)"):
        flow_figures(truth[:, 0], found[:, 0])


booleans = arrays(bool, (5, 7))


@patient
@given(booleans, booleans, booleans)
def test_masks_as_scikit_learn_has_them(truth, found, where):
    metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is the second implementation")
    if (truth | found)[where].any():
        assert mask_iou(truth, found, where=where) == pytest.approx(
            metrics.jaccard_score(truth[where], found[where], zero_division=0)
        )
        assert dice(truth, found, where=where) == pytest.approx(
            metrics.f1_score(truth[where], found[where], zero_division=0)
        )
    if where.any():
        accuracy = metrics.accuracy_score(truth[where], found[where])
        assert pixel_accuracy(truth, found, where=where) == pytest.approx(accuracy)


@patient
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=80))
def test_event_figures_as_scikit_learn_and_scipy_have_them(pairs):
    metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is the second implementation")
    optimize = pytest.importorskip("scipy.optimize")
    truth, found = np.array(pairs).T
    if (truth + found).any():
        deployed = metrics.jaccard_score(truth > 0, found > 0, zero_division=0)
        assert event_moving_iou(truth, found) == pytest.approx(deployed)
    confusion = metrics.confusion_matrix(truth, found, labels=range(4)).astype(float)
    rows, columns = optimize.linear_sum_assignment(-confusion)
    assert one_to_one_accuracy(truth, found) == pytest.approx(confusion[rows, columns].sum() / len(truth))
    motions, labels = np.count_nonzero(confusion.sum(axis=1)), np.count_nonzero(confusion.sum(axis=0))
    assert clusters_per_motion(truth, found, min_events=1) == labels / motions
    union = confusion.sum(axis=1)[:, None] + confusion.sum(axis=0) - confusion
    iou = np.divide(confusion, union, out=np.zeros_like(confusion), where=union > 0)
    rows, columns = optimize.linear_sum_assignment(-iou)
    present = (confusion.sum(axis=1) > 0) & (np.arange(4) > 0)
    ties = iou.max() == 0 or len(np.unique(iou[iou > 0])) < np.count_nonzero(iou)
    if present.any() and not ties:  # equal IoUs could be matched either way
        assert event_object_iou(truth, found, min_events=1) == pytest.approx(
            iou[rows, columns][present[rows]].sum() / present.sum()
        )


@patient
@given(st.lists(st.floats(0.1, 50), min_size=1, max_size=30), st.randoms(use_true_random=False))
def test_depth_as_scikit_learn_has_it(depths, random):
    metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is the second implementation")
    truth = np.array(depths)
    found = truth * np.array([random.uniform(0.5, 2) for _ in depths])
    figures = depth_figures(truth, found)
    assert figures["rmse"] == pytest.approx(metrics.root_mean_squared_error(truth, found))
    assert figures["abs_rel"] == pytest.approx(metrics.mean_absolute_percentage_error(truth, found))
