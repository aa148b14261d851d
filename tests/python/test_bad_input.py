"""Bad and odd input at the door: a clear error or a sound result, never a crash."""

from __future__ import annotations

import re

import numpy as np
import pytest
from engine_and_reference import event_array, scattered_events
from typer.testing import CliRunner

import emseg
from emseg.cli import app

GOOD = {"x": [1, 2, 3], "y": [4, 5, 6], "t": [10, 20, 30], "p": [0, 1, 0], "width": 16, "height": 12}

# What test_events.py leaves out.
BAD = {
    "nan in t": ({"t": [1.0, 2.0, np.nan]}, "event 2 has t = nan"),
    "infinite": ({"t": [1.0, 2.0, np.inf]}, "event 2 has t = inf"),
    "t beyond int64": ({"t": np.array([1, 2, 2**63], np.uint64)}, "event 2 has t = 9223372036854775808"),
    "complex": ({"x": np.array([1j, 2, 3])}, "x has dtype complex128"),
    "objects": ({"x": np.array([None, 2, 3], object)}, "x has dtype object"),
    "times of day": ({"t": np.array([1, 2, 3], "datetime64[us]")}, "t has dtype datetime64"),
    "huge sensor": ({"width": 10**9}, "width is 1000000000"),
}


@pytest.mark.parametrize("name", list(BAD))
def test_bad_columns_are_refused_by_name_and_place(name):
    change, message = BAD[name]
    with pytest.raises(ValueError, match=re.escape(message)):
        emseg.EventArray(**{**GOOD, **change})


def sound(found: emseg.Segmentation, events: emseg.EventArray) -> None:
    assert found.labels.shape == (len(events),)
    assert set(np.unique(found.labels)) <= {-1, *(model.label for model in found.models)}
    assert all(np.isfinite(model.params).all() for model in found.models)
    assert np.isfinite(found.energy)
    assert (np.diff(found.energy_trace) <= 0).all()
    assert np.isfinite(found.iwe()).all()
    assert found.label_image().shape == (events.height, events.width)
    assert len(found.boxes) <= max(0, len(found.models) - 1)
    if len(events):
        assert int(events.t[0]) <= found.t_ref <= int(events.t[-1])


def odd_windows() -> dict[str, emseg.EventArray]:
    rng = np.random.default_rng(0)
    x, y = rng.integers(0, 64, 500), rng.integers(0, 48, 500)
    t = np.sort(rng.integers(0, 40_000, 500))
    size = {"width": 64, "height": 48}
    far = 2**62
    return {
        "empty": event_array([], [], [], **size),
        "one event": event_array([3], [4], [5], **size),
        "two events": event_array([3, 9], [4, 4], [5, 6], **size),
        "two at once": event_array([3, 3], [4, 4], [5, 5], **size),
        "one pixel": event_array([7] * 500, [9] * 500, t, **size),
        "one corner": event_array([63] * 500, [47] * 500, t, **size),
        "one line": event_array(x, [9] * 500, t, **size),
        "one diagonal": event_array(np.arange(500) % 48, np.arange(500) % 48, t, **size),
        "one time": event_array(x, y, [77] * 500, **size),
        "one time and pixel": event_array([7] * 500, [9] * 500, [77] * 500, **size),
        "every pixel": event_array(
            np.tile(np.arange(64), 48), np.repeat(np.arange(48), 64), np.arange(64 * 48), **size
        ),
        "late": event_array(x, y, t + far, **size),
        "early": event_array(x, y, t - far, **size),
        "first and last of all times": event_array([3, 9, 12], [4, 4, 8], [-far, 0, far - 1], **size),
        "an hour": event_array(x, y, t * 90_000, **size),
        "one-pixel sensor": event_array([0] * 50, [0] * 50, np.arange(50), width=1, height=1),
        "one-row sensor": event_array(x, [0] * 500, t, width=64, height=1),
    }


ODD = odd_windows()
CONFIGS = {
    "default": emseg.Config(),
    "published": emseg.Config.preset("published"),
    "all": emseg.Config(hybrid_model_combination="all"),
    "homography": emseg.Config(hybrid_model_combination="homography"),
}


@pytest.mark.parametrize("config", list(CONFIGS))
@pytest.mark.parametrize("name", list(ODD))
def test_odd_windows_are_segmented_soundly(name, config):
    events = ODD[name]
    sound(emseg.segment(events, config=CONFIGS[config]), events)


@pytest.mark.parametrize("name", list(ODD))
def test_odd_windows_pass_every_other_verb(name):
    events = ODD[name]
    indptr, indices = emseg.event_graph(events)
    assert len(indptr) == len(events) + 1
    assert indptr[-1] == len(indices)
    for kind in ("translation", "rotation", "homography"):
        model, contrast = emseg.fit_motion(events, kind)
        assert np.isfinite([*model.params, contrast]).all()
        assert emseg.warp(events, model).shape == (len(events), 2)
        assert np.isfinite(emseg.iwe(events, model)).all()


@pytest.mark.parametrize("name", [name for name in ODD if name != "first and last of all times"])
def test_odd_recordings_run_to_their_end(name):
    events = ODD[name]
    windows = list(emseg.Segmenter(events.width, events.height).run(events))
    assert sum(len(window.labels) for window in windows) == len(events)


def test_a_million_events_in_one_window():
    """As many on a megapixel sensor: ten million take ten times as long and as much memory."""
    events = scattered_events(0, 1_000_000, width=1280, height=720, duration=100_000)
    found = emseg.segment(events)
    sound(found, events)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t": [10, 30, 20]}, "event 2 has time 20"),
        ({"x": [1, 16, 3]}, "x"),
        ({"x": [1, 2]}, "lengths"),
        ({"x": [1.0, np.nan, 3.0]}, "nan"),
    ],
    ids=["unsorted", "outside", "unequal", "nan"],
)
def test_the_command_names_the_file_and_what_is_wrong_in_it(tmp_path, columns, message):
    path = tmp_path / "broken.npz"
    np.savez(path, **{**GOOD, **columns})
    result = CliRunner().invoke(app, ["segment", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    output = " ".join(result.output.split())
    assert re.search(f"broken.npz.*{message}", output), output
    assert "Traceback" not in output


@pytest.mark.parametrize("name", ["empty", "one event", "one pixel", "one time"])
def test_the_command_segments_odd_recordings(tmp_path, name):
    events = ODD[name]
    path = tmp_path / "odd.npz"
    np.savez(path, x=events.x, y=events.y, t=events.t, p=events.p, width=events.width, height=events.height)
    result = CliRunner().invoke(app, ["segment", str(path), "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    with np.load(tmp_path / "out" / "odd" / "labels.npz") as labels:
        assert len(labels["labels"]) == len(events)
