"""Segmenter.run: windows over whole recordings, tracks through them, and the bundled recordings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from engine_and_reference import event_array, real, scattered_events

import emseg
from emseg.datasets import bundled
from emseg.metrics import detected_boxes, evaluate

WINDOW_RULES = {
    "by count": emseg.Config(num_events_per_image=15_000),
    "by duration": emseg.Config(window_duration=0.05),
    "adaptive": emseg.Config(),
}


@cache
def recording(name: str, rule: str = "adaptive") -> emseg.EventArray:
    """A bundled recording; of it a part is enough for windows that do not depend on what is found in them."""
    events = emseg.read(bundled()[name])
    return events if rule == "adaptive" else events[:32_000]


@cache
def run(name: str, rule: str) -> list[emseg.Segmentation]:
    events = recording(name, rule)
    return list(emseg.Segmenter(events.width, events.height, config=WINDOW_RULES[rule]).run(events))


@pytest.mark.parametrize("name", ["cars", "made_scene"])
@pytest.mark.parametrize("rule", list(WINDOW_RULES))
def test_windows_tile_the_recording(name, rule):
    events, windows = recording(name, rule), run(name, rule)
    assert [window.start for window in windows] == [0, *(window.stop for window in windows[:-1])]
    assert windows[-1].stop == len(events)
    for window in windows:
        assert len(window.events) == len(window.labels) == window.stop - window.start > 0
        np.testing.assert_array_equal(window.events.t, events.t[window.start : window.stop])
        assert window.events.t[0] <= window.t_ref <= window.events.t[-1]


def test_windows_are_as_long_as_asked():
    by_count = run("cars", "by count")
    assert [len(window.events) for window in by_count[:-1]] == [15_000] * (len(by_count) - 1)
    assert all(window.events.duration < 50_000 for window in run("cars", "by duration"))


@pytest.mark.parametrize("name", ["cars", "made_scene"])
@pytest.mark.parametrize("rule", list(WINDOW_RULES))
def test_labels_are_tracks_with_a_model_and_a_box(name, rule):
    for window in run(name, rule):
        tracks = [model.label for model in window.models]
        assert tracks[0] == 0
        assert len(set(tracks)) == len(tracks)
        assert set(np.unique(window.labels)) - {-1, 0} == set(tracks) - {0}
        assert window.boxes["track"].tolist() == sorted(tracks[1:])
        assert (window.boxes["w"] > 0).all()
        assert (window.boxes["h"] > 0).all()


def test_energy_never_rises_in_any_window():
    for window in run("cars", "adaptive"):
        assert (np.diff(window.energy_trace) <= 0).all()


def test_the_made_scene_is_segmented_and_its_objects_keep_their_tracks():
    """Moving camera, two objects.  The bounds are what is measured: moving IoU .909, identities .99."""
    with np.load(bundled()["made_scene"]) as arrays:
        truth = arrays["label"].astype(np.int64)
    windows = run("made_scene", "adaptive")
    labels = np.concatenate([window.labels for window in windows])
    assert evaluate(truth, labels)["moving_iou_deployed"] >= 0.9
    tracks = []
    for thing in (1, 2):
        found = labels[(truth == thing) & (labels > 0)]
        values, counts = np.unique(found, return_counts=True)
        assert counts.max() >= 0.99 * len(found)
        tracks.append(values[counts.argmax()])
    assert tracks[0] != tracks[1]


def test_every_car_is_found_in_most_of_its_frames():
    """A box is found by the criterion of the EED data set.

    171 of 176 were found when this was written; 95 % are asked for.

    The boxes were made automatically, every 25 ms, and are good to 1.8 s; then the cars merge.
    """
    events = recording("cars")
    boxes = np.loadtxt(real("cars_davis346_boxes.csv"), delimiter=",")
    windows = run("cars", "adaptive")
    found: dict[int, list[bool]] = {}
    for time_ms in np.unique(boxes[boxes[:, 0] <= 1800, 0]):
        time = events.t[0] + time_ms * 1e3
        window = [w for w in windows if w.events.t[0] <= time][-1]  # windows tile the recording
        now = boxes[boxes[:, 0] == time_ms]
        low, high = now[:, 2:4], now[:, 4:6]
        detections = np.column_stack([window.boxes[side] for side in "xywh"])
        for car, hit in zip(now[:, 1], detected_boxes(np.hstack([low, high - low]), detections), strict=True):
            found.setdefault(int(car), []).append(bool(hit))
    hits = [hit for car in found.values() for hit in car]
    assert np.mean(hits) >= 0.95
    # Tracks 3 and 5 of the boxes are there for a moment only, when two cars pass or one comes in.
    lasting = {car: hits for car, hits in found.items() if len(hits) >= 20}
    assert len(lasting) == 3
    for hits in lasting.values():
        assert np.mean(hits) >= 0.8


def test_a_segmenter_keeps_nothing_between_recordings():
    events = recording("made_scene")[:40_000]
    segmenter = emseg.Segmenter(events.width, events.height)
    first, second = list(segmenter.run(events)), list(segmenter.run(events))
    assert [(w.start, w.stop) for w in first] == [(w.start, w.stop) for w in second]
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.labels, b.labels)


@pytest.mark.parametrize("rule", list(WINDOW_RULES))
def test_threads_change_nothing(rule):
    events = recording("made_scene")[:30_000]
    results = []
    for threads in (1, 2, 7):
        config = replace(WINDOW_RULES[rule], threads=threads)
        windows = list(emseg.Segmenter(events.width, events.height, config=config).run(events))
        results.append(([w.stop for w in windows], np.concatenate([w.labels for w in windows]).tolist()))
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("rule", list(WINDOW_RULES))
@pytest.mark.parametrize("count", [0, 1, 2, 10])
def test_short_recordings(rule, count):
    events = scattered_events(0, count)
    windows = list(emseg.Segmenter(240, 180, config=WINDOW_RULES[rule]).run(events))
    assert sum(len(window.labels) for window in windows) == count
    assert len(windows) <= count


@pytest.mark.parametrize("rule", list(WINDOW_RULES))
def test_a_long_silence_between_events_is_no_window(rule):
    first, second = scattered_events(0, 300), scattered_events(1, 300)
    t = np.concatenate([first.t, second.t + 3_600_000_000])  # an hour
    events = event_array(
        np.concatenate([first.x, second.x]), np.concatenate([first.y, second.y]), t, width=240, height=180
    )
    windows = list(emseg.Segmenter(240, 180, config=WINDOW_RULES[rule]).run(events))
    assert sum(len(window.labels) for window in windows) == 600
    if rule != "by count":
        assert all(window.events.duration < 1_000_000 for window in windows)


def test_another_sensors_events_are_refused():
    with pytest.raises(ValueError, match="the events' sensor is 240x180, the segmenter's 346x260"):
        emseg.Segmenter(346, 260).segment(scattered_events(0, 10))
    with pytest.raises(ValueError, match="240x180"):
        list(emseg.Segmenter(346, 260).run(scattered_events(0, 10)))
