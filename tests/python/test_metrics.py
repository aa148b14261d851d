import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference_windows import patient, recorded

from emseg.metrics import (
    clusters_per_motion,
    evaluate,
    event_moving_iou,
    event_object_iou,
    matched_labels,
    one_to_one_accuracy,
)

# Accuracy of the published labels as it was measured when they were made, to three digits (cut or rounded).
PUBLISHED_ACCURACY = {
    "240x180_15k": 0.989,
    "240x180_30k": 0.941,
    "240x180_60k": 0.919,
    "346x260_15k": 0.990,
    "346x260_30k": 0.906,
    "346x260_60k": 0.981,
    "640x480_30k": 0.634,
    "640x480_60k": 0.289,
}


def spread(**counts: int) -> tuple[np.ndarray, np.ndarray]:
    """Truth and prediction from counts: t0_p1=30 is 30 events of truth 0 and prediction 1, n is -1."""
    pairs = [[int(part[1:].replace("n", "-1")) for part in name.split("_")] for name in counts]
    truth, prediction = np.repeat(pairs, list(counts.values()), axis=0).T
    return truth, prediction


def test_a_perfect_prediction():
    truth, _ = spread(t0_p0=100, t1_p0=80, t2_p0=60, tn_p0=10)
    assert evaluate(truth, truth) == {
        "moving_iou_oracle": 1.0,
        "moving_iou_deployed": 1.0,
        "object_iou": 1.0,
        "clusters_per_motion": 1.0,
        "one_to_one_accuracy": 1.0,
        "events": 240.0,
        "object_events": 140.0,
        "objects": 2.0,
        "labels": 3.0,
    }


def test_moving_iou_by_hand():
    # label 1: 60 of 90 move, so it is moving either way; label 0: 40 of 140 move
    truth, prediction = spread(t0_p0=100, t0_p1=30, t1_p1=60, t1_p0=40, tn_p1=500)
    assert event_moving_iou(truth, prediction) == 60 / (60 + 30 + 40)
    assert event_moving_iou(truth, prediction, background="oracle") == 60 / 130


def test_oracle_forgives_a_wrong_background_label():
    truth, prediction = spread(t0_p1=100, t1_p0=50)
    assert event_moving_iou(truth, prediction, background="deployed") == 0.0
    assert event_moving_iou(truth, prediction, background="oracle") == 1.0


def test_oracle_takes_a_split_background_and_an_even_label_as_background():
    truth, prediction = spread(t0_p0=60, t0_p1=60, t0_p2=20, t1_p2=20, t1_p3=40)
    assert event_moving_iou(truth, prediction, background="oracle") == 40 / 60
    assert event_moving_iou(truth, prediction, background="deployed") == 60 / 140


def test_predicted_noise_is_not_moving():
    truth, prediction = spread(t0_p0=50, t1_p1=60, t1_pn=40)
    for background in ("deployed", "oracle"):
        assert event_moving_iou(truth, prediction, background=background) == 0.6


def test_nothing_moves():
    truth, still = spread(t0_p0=100)
    assert np.isnan(event_moving_iou(truth, still))
    assert event_moving_iou(truth, still + 1, background="deployed") == 0.0
    assert np.isnan(event_moving_iou(truth, still + 1, background="oracle"))
    assert np.isnan(event_object_iou(truth, still))


def test_object_iou_by_hand():
    # object 1: 80 of 100 in label 1, with 20 others; object 2: 50 in label 2, 10 lost; object 3: too small
    truth, prediction = spread(t0_p0=180, t0_p1=20, t1_p1=80, t1_p0=20, t2_p2=50, t2_p0=10, t3_p3=49)
    assert event_object_iou(truth, prediction) == pytest.approx((80 / 120 + 50 / 60) / 2)
    assert event_object_iou(truth, prediction, min_events=1) == pytest.approx((80 / 120 + 50 / 60 + 1) / 3)


def test_matched_labels_by_hand():
    truth, prediction = spread(t0_p0=180, t0_p1=20, t1_p1=80, t1_p0=20, t2_pn=60, t3_p3=49)
    assert matched_labels(truth, prediction) == {1: (1, 80 / 120, 80), 2: (-1, 0.0, 0)}
    assert matched_labels(truth[:10], prediction[:10]) == {}


def test_one_label_cannot_serve_two_objects():
    truth, prediction = spread(t0_p0=100, t1_p1=100, t2_p1=60)
    assert event_object_iou(truth, prediction) == pytest.approx((100 / 160 + 0) / 2)


def test_a_missed_object_does_not_take_the_backgrounds_label():
    truth, prediction = spread(t0_p0=100, t1_p0=90)
    assert event_object_iou(truth, prediction) == 0.0


def test_a_split_object_has_its_better_half():
    truth, prediction = spread(t0_p0=100, t1_p1=60, t1_p2=40)
    assert event_object_iou(truth, prediction) == 0.6


def test_clusters_per_motion_by_hand():
    truth, prediction = spread(
        t0_p0=100, t0_p1=50, t0_p2=49, t1_p3=60, t1_p4=55, t2_p5=20, tn_p6=90, t1_pn=70
    )
    assert clusters_per_motion(truth, prediction) == 4 / 2  # labels 0 1 3 4; motions 0 1
    assert np.isnan(clusters_per_motion(truth[:10], prediction[:10]))


def test_one_to_one_accuracy_by_hand():
    # 0 -> 5 (70), 1 -> 6 (30): matching 1 -> 5 as well as 0 -> 7 would give 40 + 20
    truth, prediction = spread(t0_p5=70, t0_p7=20, t1_p5=40, t1_p6=30, tn_p5=99)
    assert one_to_one_accuracy(truth, prediction) == 100 / 160
    assert np.isnan(one_to_one_accuracy(truth[:0], prediction[:0]))


def test_all_predicted_noise():
    truth, prediction = spread(t0_pn=60, t1_pn=60)
    assert one_to_one_accuracy(truth, prediction) == 0.0
    assert event_object_iou(truth, prediction) == 0.0
    assert clusters_per_motion(truth, prediction) == 0.0


labels = st.lists(st.tuples(st.integers(-1, 3), st.integers(-1, 3)), min_size=1, max_size=60)


@patient
@given(labels, st.permutations(range(1, 4)), st.randoms(use_true_random=False))
def test_names_of_moving_labels_and_order_of_events_do_not_matter(pairs, names, random):
    truth, prediction = np.array(pairs).T
    shuffled = list(range(len(truth)))
    random.shuffle(shuffled)
    renamed = np.array([0, *names, -1])[prediction]
    expected = evaluate(truth, prediction)
    assert evaluate(truth[shuffled], renamed[shuffled]) == pytest.approx(expected, nan_ok=True)


@patient
@given(labels)
def test_scores_are_shares_and_the_truth_is_best(pairs):
    truth, prediction = np.array(pairs).T
    accuracy = one_to_one_accuracy(truth, prediction)
    assert np.isnan(accuracy) or 0 <= accuracy <= 1
    if (truth >= 0).any():
        assert one_to_one_accuracy(truth, truth) == 1
        assert accuracy >= max(
            np.mean((truth == label)[truth >= 0] & (prediction == label)[truth >= 0]) for label in range(4)
        )


def test_labels_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="3 true and 2 predicted labels"):
        evaluate([0, 1, 1], [0, 1])
    with pytest.raises(ValueError, match=r"truth of shape .* expected integers"):
        evaluate([0.5, 1.0], [0, 1])
    with pytest.raises(ValueError, match="'best'; expected 'deployed' or 'oracle'"):
        event_moving_iou([0], [0], background="best")


@pytest.mark.parametrize("name", PUBLISHED_ACCURACY)
def test_published_labels_score_what_they_scored_when_they_were_made(name):
    arrays = recorded(name)
    accuracy = one_to_one_accuracy(arrays["label"], arrays["labels_translation_pool"].astype(np.int64))
    assert abs(accuracy - PUBLISHED_ACCURACY[name]) < 1e-3
