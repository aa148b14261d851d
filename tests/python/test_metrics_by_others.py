"""Metrics against second implementations: torchmetrics, trying every assignment, counting pixels of boxes."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reference_windows import patient

from emseg.metrics import (
    detected_boxes,
    dice,
    event_moving_iou,
    event_object_iou,
    mask_iou,
    one_to_one_accuracy,
    pixel_accuracy,
)

GRID = 12  # px


def test_masks_as_torchmetrics_has_them():
    classification = pytest.importorskip(
        "torchmetrics.functional.classification", reason="torchmetrics is the second implementation"
    )
    import torch

    rng = np.random.default_rng(5)
    for share in (0.05, 0.3, 0.8):
        truth, found, where = (rng.random((20, 30)) < p for p in (share, 0.4, 0.7))
        pair = torch.from_numpy(found[where]).int(), torch.from_numpy(truth[where]).int()
        ours = [figure(truth, found, where=where) for figure in (mask_iou, dice, pixel_accuracy)]
        names = ("binary_jaccard_index", "binary_f1_score", "binary_accuracy")
        theirs = [float(getattr(classification, name)(*pair)) for name in names]
        assert ours == pytest.approx(theirs, rel=1e-6)  # theirs are float32


labels_of_events = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=60)


def overlaps(truth, found):
    """Events that motion i and label j share, and that either has, (4, 4) each."""
    members = [[(column == k) for k in range(4)] for column in (truth, found)]
    shared = np.array([[np.count_nonzero(i & j) for j in members[1]] for i in members[0]])
    either = np.array([[np.count_nonzero(i | j) for j in members[1]] for i in members[0]])
    return shared, either


@patient
@given(labels_of_events)
def test_assignments_are_the_best_of_all(pairs):
    truth, found = np.array(pairs).T
    shared, either = overlaps(truth, found)
    every = [(range(4), list(columns)) for columns in itertools.permutations(range(4))]
    most = max(shared[assignment].sum() for assignment in every)
    assert one_to_one_accuracy(truth, found) == pytest.approx(most / len(truth))

    iou = shared / np.maximum(either, 1)
    objects = [k for k in range(1, 4) if (truth == k).any()]
    if not objects:
        assert np.isnan(event_object_iou(truth, found, min_events=1))
        return
    total = max(iou[assignment].sum() for assignment in every)
    of_objects = [
        iou[objects, np.array(columns)[objects]].mean()
        for _, columns in every
        if iou[range(4), columns].sum() >= total - 1e-12
    ]
    # Where several assignments are the best, any of them may be taken.
    ours = event_object_iou(truth, found, min_events=1)
    assert any(ours == pytest.approx(theirs) for theirs in of_objects)


@patient
@given(labels_of_events)
def test_the_oracle_as_scikit_learn_has_it(pairs):
    metrics = pytest.importorskip("sklearn.metrics", reason="scikit-learn is the second implementation")
    truth, found = np.array(pairs).T
    moving = [k for k in np.unique(found) if np.median(truth[found == k] > 0) > 0.5]
    labelled = np.isin(found, moving)
    if (labelled | (truth > 0)).any():
        expected = metrics.jaccard_score(truth > 0, labelled, zero_division=0)
        assert event_moving_iou(truth, found, background="oracle") == pytest.approx(expected)


corners = arrays(np.int64, (4,), elements=st.integers(0, GRID // 2))


@patient
@given(st.lists(corners, max_size=3), st.lists(corners, max_size=3))
def test_boxes_as_pixels_are_counted(truth, detections):
    def drawn(box):
        x, y, w, h = box
        mask = np.zeros((GRID, GRID), bool)
        mask[y : y + h, x : x + w] = True
        return mask

    expected = []
    for box in truth:
        g = drawn(box)
        shared = [(np.count_nonzero(drawn(d) & g), np.count_nonzero(drawn(d) & ~g)) for d in detections]
        expected.append(any(2 * inside > g.sum() and inside > outside for inside, outside in shared))
    assert detected_boxes(truth, detections).tolist() == expected
