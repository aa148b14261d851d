"""Boxes and tracks, by hand."""

import numpy as np
import pytest

from emseg.metrics import (
    Identities,
    detected_boxes,
    detection_rate,
    evaluate,
    identity_switches,
    object_boxes,
)


@pytest.mark.parametrize(
    ("detection", "found"),
    [
        ([10, 10, 20, 10], True),
        ([10, 10, 10, 10], False),  # covers exactly half of the box
        ([10, 10, 11, 10], True),
        ([10, 10, 20, 20], False),  # as much outside as inside
        ([10, 10, 20, 19], True),
        ([30, 10, 20, 10], False),  # side by side
    ],
)
def test_eed_criterion(detection, found):
    assert detected_boxes([[10, 10, 20, 10]], [detection]).tolist() == [found]


def test_boxes_of_a_frame():
    truth = [[0, 0, 10, 10], [50, 50, 10, 10], [80, 0, 4, 4]]
    detections = [[49, 49, 11, 11], [81, 0, 4, 4]]
    assert detected_boxes(truth, detections).tolist() == [False, True, True]
    assert detected_boxes(truth, []).tolist() == [False] * 3
    assert detected_boxes([], detections).tolist() == []


@pytest.mark.parametrize("boxes", [[[0, 0, -1, 2]], [[0, np.nan, 1, 1]]])
def test_impossible_boxes_are_refused(boxes):
    with pytest.raises(ValueError, match="expected finite rows"):
        detected_boxes(boxes, [])


def test_detection_rate_counts_boxes_not_frames():
    box = [0, 0, 10, 10]
    frames = [([box, [50, 50, 10, 10]], [box]), ([box], []), ([], [box])]
    assert detection_rate(frames) == 1 / 3
    assert np.isnan(detection_rate([([], [box])]))
    figures = evaluate([0, 1], [0, 1], boxes=([box], [box]))
    assert figures["detection_rate"] == 1.0


def test_the_box_of_a_moving_object_is_where_it_is_at_the_reference_time():
    """A square of 10 px that moves by 1 px every 100 events; noise and the background do not count."""
    step = np.repeat(np.arange(40), 100)
    corner = np.tile(np.arange(100), 40)
    x, y = step + corner % 10, 30 + corner // 10
    truth = np.full(len(x), 2)
    truth[::50], truth[1::50] = -1, 0
    x[truth < 1] = 200
    boxes = object_boxes(x, y, np.arange(len(x)), truth, t_ref=2000.0)
    assert set(boxes) == {2}
    left, top, width, height = boxes[2]
    # at step 20 it stands at 20 to 30; the quarter of its events sweeps 15 to 35, all of them 0 to 50
    assert 15 <= left <= 17
    assert 32 <= left + width <= 35
    assert (top, height) == (30, 10)
    assert object_boxes(x[:40], y[:40], np.arange(40), truth[:40], t_ref=20.0) == {}
    assert set(object_boxes(x[:40], y[:40], np.arange(40), truth[:40], t_ref=20.0, min_events=10)) == {2}


def window(*labels: int) -> tuple[np.ndarray, np.ndarray]:
    """A background of 200 events under label 0, and object k + 1, of 60 events, under the k-th label."""
    truth = np.repeat(np.arange(len(labels) + 1), [200, *[60] * len(labels)])
    return truth, np.repeat([0, *labels], [200, *[60] * len(labels)])


def test_identities_by_hand():
    # object 1 goes 4, 4, lost, 4, 5, 4; object 2 stays 7 but swaps with 1 in the last window
    windows = [window(4, 7), window(4, 7), window(-1, 7), window(4, 7), window(5, 7), window(7, 4)]
    assert identity_switches(windows) == {1: 2, 2: 1}
    identities = Identities()
    for truth, prediction in windows:
        identities.add(truth, prediction)
    assert identities.tracked == {1: 5 / 6, 2: 1.0}


def test_the_backgrounds_label_and_small_shares_are_no_identity():
    missed = window(0)
    truth, prediction = window(3)
    prediction[-60:-49] = 0  # 49 of the object's 60 are left under its label
    assert identity_switches([window(3), missed, (truth, np.where(prediction == 3, 9, 0)), window(3)]) == {
        1: 0
    }
    assert identity_switches([window(3), (truth, np.where(truth == 1, 9, 0))]) == {1: 1}
    assert identity_switches([]) == {}
