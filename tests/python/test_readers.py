"""Every format gives the events that went into it, in one piece or many, and what lies beside them."""

from __future__ import annotations

import importlib
import logging
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bench import walk
from made_recordings import HEIGHT, MADE, WIDTH, made_events

import emseg.io
from emseg.events import EventArray
from emseg.io import ReadError, prophesee, recording

EVENTS = made_events()


def make(name: str, folder: Path, events: EventArray = EVENTS) -> Path:
    suffix, write, modules = MADE[name]
    for module in modules:
        pytest.importorskip(module)
    path = folder / f"made{suffix}"
    write(path, events)
    return path


def expected_times(name: str, events: EventArray = EVENTS) -> np.ndarray:
    """In EVT 3 Prophesee's tools count from the high part before the first; the others are made from 0."""
    return events.t - (int(events.t[0]) >> 12 << 12) + 4096 if name == "evt3" else events.t


@pytest.mark.parametrize("name", list(MADE))
def test_what_went_in_comes_out(tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture) -> None:
    path = make(name, tmp_path)
    with caplog.at_level(logging.WARNING):
        events = emseg.io.read(path)
    for column, expected in (("x", EVENTS.x), ("y", EVENTS.y), ("t", expected_times(name)), ("p", EVENTS.p)):
        np.testing.assert_array_equal(getattr(events, column), expected, err_msg=column)
    assert (events.width, events.height) == (WIDTH, HEIGHT)
    renamed = path.rename(tmp_path / "made.xyz")  # content decides, not the suffix
    assert emseg.io.read(renamed) == events
    assert emseg.io.read(renamed, damage="keep") == events


@pytest.mark.parametrize("name", list(MADE))
def test_pieces_make_the_whole(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make(name, tmp_path)
    whole = emseg.io.read(path)
    monkeypatch.setattr(recording, "_WORTHWHILE_EVENTS", 1)
    for module in [module for name, module in sys.modules.items() if name.startswith("emseg.io.")]:
        monkeypatch.setattr(module, "BLOCK_EVENTS", 37, raising=False)
    monkeypatch.setattr(importlib.import_module("emseg.io.text"), "_BLOCK_BYTES", 100)
    with emseg.io.open_recording(path) as opened:
        chunks = list(opened.chunks())
        assert len(chunks) > 1
        assert EventArray.concatenate(chunks) == whole
        assert opened.read() == whole  # a second time
        t0 = int(whole.t[0])
        span = opened.read(span=(0.02, 0.05))
    assert span == whole.between(t0 + 20_000, t0 + 50_000)
    assert 0 < len(span) < len(whole)


def test_the_folder_of_a_ros2_bag_is_the_bag(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    path = make("mcap mono", folder)
    with pytest.raises(ReadError, match="is a directory, expected a recording"):
        emseg.io.read(folder)
    (folder / "metadata.yaml").touch()
    assert emseg.io.read(folder) == EVENTS
    path.with_name("second.mcap").write_bytes(path.read_bytes())
    with pytest.raises(
        ReadError, match=r"is a ROS 2 bag of 2 files, expected one of them: made\.mcap, second\.mcap"
    ):
        emseg.io.read(folder)


def test_spans_that_no_recording_has(tmp_path: Path) -> None:
    path = make("npz", tmp_path)
    assert len(emseg.io.read(path, span=(100, 200))) == 0
    assert emseg.io.read(path, span=(0, float("inf"))) == EVENTS
    for span in ((-1, 2), (2, 2), (float("nan"), 2)):
        with pytest.raises(ValueError, match="expected 0 <= start < stop"):
            emseg.io.read(path, span=span)


@pytest.mark.parametrize(
    ("name", "samples", "frames"),
    [
        ("aedat2", 4, 0),
        ("aedat3", 3, 3),
        ("ros1 dvs", 4, 4),
        ("db3 evt3", 4, 4),
        ("mcap mono", 4, 4),
        ("hdf5 mvsec", 5, 2),
        ("mat aedat", 3, 2),
    ],
)
def test_frames_and_imu_lie_alongside(tmp_path: Path, name: str, samples: int, frames: int) -> None:
    path = make(name, tmp_path)
    with emseg.io.open_recording(path) as opened:
        imu, pictures = opened.imu(), list(opened.frames())
    assert len(imu) == samples
    assert len(pictures) == frames
    if name == "aedat2":
        np.testing.assert_allclose(imu.acceleration[0], [9.80665, 0, -9.80665])
        np.testing.assert_allclose(imu.angular_velocity[0], np.deg2rad([500, -500, 0]))
        assert imu.t.tolist() == EVENTS.t[::100].tolist()
    elif name in ("aedat3", "mat aedat"):
        assert np.allclose(np.abs(imu.angular_velocity[0, 0]), np.pi)
        assert np.allclose(np.abs(imu.acceleration[0, 0]), 9.80665)
    else:
        np.testing.assert_allclose(imu.angular_velocity[0], [0.1, 0.2, 0.3])
        np.testing.assert_allclose(imu.acceleration[0], [1, 2, 3])
    if name == "aedat3" or name.startswith(("ros", "db3", "mcap")):
        assert pictures[0].image.tolist() == [[0, 1, 2], [3, 4, 5]]
        assert pictures[0].t == int(EVENTS.t[0]) + (4 if name == "aedat3" else 0)


def test_one_stream_of_several_is_chosen_by_name(tmp_path: Path) -> None:
    path = make("hdf5 mvsec", tmp_path)
    with emseg.io.open_recording(path, stream="/davis/right/events") as opened:
        assert opened.streams == ("davis/left/events", "davis/right/events")
        assert opened.read() == EVENTS
    for name, wrong in (("hdf5 mvsec", path), ("ros1 dvs", None), ("aedat4", None)):
        other = wrong or make(name, tmp_path)
        with pytest.raises(ReadError, match="'middle'"):
            emseg.io.read(other, stream="middle")


def test_times_go_on_where_a_counter_starts_again(tmp_path: Path) -> None:
    late = later(EVENTS, (1 << 32) - 1_030_000)
    for name in ("dat", "aedat2"):
        np.testing.assert_array_equal(emseg.io.read(make(name, tmp_path, late)).t, late.t)
    wrapping = later(EVENTS, 15_750_000)  # 2**24 us lie within
    events = emseg.io.read(make("evt3", tmp_path, wrapping))
    np.testing.assert_array_equal(np.diff(events.t), np.diff(wrapping.t))


def later(events: EventArray, by: int) -> EventArray:
    return EventArray(events.x, events.y, events.t + by, events.p, width=WIDTH, height=HEIGHT)


def test_text_in_any_order_and_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    rows = np.stack([EVENTS.x, EVENTS.y, EVENTS.p, EVENTS.t], axis=1)
    np.savetxt(path, rows, fmt="%d")
    assert emseg.io.read(path, columns="xypt", width=WIDTH, height=HEIGHT) == EVENTS
    path.write_text("1 1 1 1\n3 1 1 1\n")
    assert emseg.io.read(path, time_unit="s").t.tolist() == [1_000_000, 3_000_000]
    path.write_text("1.0 1 1 1\n3.0 1 1 1\n")
    assert emseg.io.read(path, time_unit="us").t.tolist() == [1, 3]
    for options in ({"columns": "xyt"}, {"time_unit": "ms"}):
        with pytest.raises(ValueError, match="expected"):
            emseg.io.read(path, **options)


def test_text_that_turns_to_fractions_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.import_module("emseg.io.text"), "_BLOCK_BYTES", 16)
    (tmp_path / "a.txt").write_text("1 1 1 1\n2 1 1 1\n3 1 1 1\n4.5 1 1 1\n")
    with pytest.raises(ReadError, match=r"line 4: t is 4\.5, expected whole microseconds"):
        emseg.io.read(tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("name", "package"),
    [("hdf5 dsec", "h5py"), ("aedat4", "lz4"), ("ros1 dvs", "rosbags")],
)
def test_a_missing_package_is_named_with_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str
) -> None:
    path = make(name, tmp_path)
    for module in list(sys.modules):
        if module.split(".")[0] == package:
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ReadError, match=rf"{package}, which is not installed: pip install 'emseg\[io\]'"):
        emseg.io.read(path)


@pytest.mark.parametrize("kind", ["dvs", "atis"])
def test_event_streams_agree_with_their_makers(tmp_path: Path, kind: str) -> None:
    event_stream = pytest.importorskip("event_stream")
    records = np.zeros(len(EVENTS), getattr(event_stream, f"{kind}_dtype"))
    rise = "on" if kind == "dvs" else "polarity"
    for name, column in (("t", "t"), ("x", "x"), ("y", "y"), (rise, "p")):
        records[name] = getattr(EVENTS, column)
    stay = np.ones(len(EVENTS), bool)
    if kind == "atis":
        records["exposure"][::3] = True
        stay = ~records["exposure"]
    path = tmp_path / "made.es"
    with event_stream.Encoder(str(path), kind, WIDTH, HEIGHT) as encoder:
        encoder.write(records)
    assert emseg.io.read(path) == EVENTS[stay]


def test_prophesee_headers() -> None:
    header = prophesee._parse_header(b"% Date 2020\n% Version 2\n% Width 3\n% Height 4\n\x0c\x08%rest\n")
    assert header is not None
    assert (header.size, header.length) == ((3, 4), 45)
    assert prophesee._parse_header(b"% a comment\n\1\2\3\4") is None


def test_text_may_begin_like_a_prophesee_header(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("% width 346\n% height 260\n% version 2\n346 260\n1 2 3 1\n")
    assert emseg.io.read(tmp_path / "a.txt").to_structured().tolist() == [(2, 3, 1, 1)]


@pytest.mark.parametrize("form", ["evt2", "npz", "hdf5"])
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, form: str) -> None:
    if form == "hdf5":
        pytest.importorskip("h5py")
    peaks = []
    for count in (1_000_000, 3_000_000):
        path = tmp_path / f"long{walk.SUFFIXES[form]}"
        walk.write(path, form, count)
        command = [sys.executable, "-c", walk.WALK, str(path)]
        output = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        assert int(output[0]) == count
        peaks.append(float(output[2]))
    assert peaks[1] - peaks[0] < 10, f"MB: {peaks}"  # the events themselves would take 26 MB more
