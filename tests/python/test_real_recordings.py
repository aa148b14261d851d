"""Real recordings: count and span as known, and the same events as other people's decoders give."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emseg.io
from emseg.events import EventArray

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "real"

# File, sensor, events, seconds from the first to the last.
KNOWN = [
    ("cars_davis346.aedat4", (346, 260), 78_830, 2.36),
    ("cradle_davis346.aedat4", (346, 260), 319_512, 0.51),
    ("legs_vga.bag", (640, 480), 343_474, 2.08),
    ("legs_vga.db3", (640, 480), 343_474, 2.08),
    ("legs_vga_2/test_events_2_0.mcap", (346, 260), 571_266, 1.00),
    ("slider_depth/slider_depth.npz", (240, 180), 1_078_541, 3.40),
    ("boxes_rotation.npz", (240, 180), 30_000, 0.01),
    ("poster_rotation.npz", (240, 180), 30_000, 0.02),
    ("shapes_rotation.npz", (240, 180), 20_000, 0.10),
    ("evbench/seq_0001_e.mat", (240, 180), 132_784, 1.07),
    ("evbench/seq_0002_e.mat", (240, 180), 273_143, 2.14),
    ("boxes_translation_aedat2.aedat", (240, 180), 162_771, 2.07),
    ("sparklers_evt2.raw", (640, 480), 521_252, 0.10),
    ("flicker_evt3.raw", (1280, 720), 1_218_618, 10.77),
    ("flicker_dat.dat", (1280, 720), 1_218_618, 10.77),
    ("mvsec_slice.hdf5", (346, 260), 164, 0.03),
]


def real(name: str) -> Path:
    path = REAL / name
    if not path.exists():
        pytest.skip(f"needs the recording ../shared/data/real/{name}")
    return path


@pytest.mark.parametrize(("name", "size", "count", "seconds"), KNOWN)
def test_count_and_span(name: str, size: tuple[int, int], count: int, seconds: float) -> None:
    events = emseg.io.read(real(name))
    assert (events.width, events.height) == size
    assert len(events) == count
    assert round(events.duration / 1e6, 2) == seconds


def test_raw_and_dat_hold_the_same_events() -> None:
    assert emseg.io.read(real("flicker_evt3.raw")) == emseg.io.read(real("flicker_dat.dat"))


def test_both_bags_hold_the_same_events() -> None:
    assert emseg.io.read(real("legs_vga.bag")) == emseg.io.read(real("legs_vga.db3"))


def same(events: EventArray, x: Any, y: Any, t: Any, p: Any) -> None:
    """Equal but for where time begins."""
    for name, column in (("x", x), ("y", y), ("p", p)):
        np.testing.assert_array_equal(
            getattr(events, name), np.asarray(column).astype(np.int64), err_msg=name
        )
    shift = int(events.t[0]) - int(t[0])
    np.testing.assert_array_equal(events.t, np.asarray(t).astype(np.int64) + shift)


@pytest.mark.parametrize(
    "name",
    [
        "sparklers_evt2.raw",
        "flicker_evt3.raw",
        "flicker_dat.dat",
        "boxes_translation_aedat2.aedat",
        "cars_davis346.aedat4",
    ],
)
def test_eventcv_agrees(name: str) -> None:
    eventcv = pytest.importorskip("eventcv")
    path = real(name)
    x, y, t, p = eventcv.load(str(path)).numpy().T
    same(emseg.io.read(path), x, y, t, p)


def test_evt3_agrees() -> None:
    evt3 = pytest.importorskip("evt3")
    path = real("flicker_evt3.raw")
    events = evt3.decode_file(str(path))
    same(emseg.io.read(path), events.x, events.y, events.timestamp, events.polarity)


@pytest.mark.parametrize("name", ["sparklers_evt2.raw", "flicker_evt3.raw", "flicker_dat.dat"])
def test_faery_agrees(name: str) -> None:
    faery = pytest.importorskip("faery")
    path = real(name)
    events = emseg.io.read(path)
    stream = faery.events_stream_from_file(path, dimensions_fallback=(events.width, events.height))
    packets = np.concatenate(list(stream))
    same(events, packets["x"], packets["y"], packets["t"], packets["on"])


def test_evt3_agrees_on_bags() -> None:
    """The packets of a bag, end to end, are one EVT 3 stream."""
    evt3, rosbags = pytest.importorskip("evt3"), pytest.importorskip("rosbags.highlevel")
    path = real("legs_vga.bag")
    with rosbags.AnyReader([path]) as reader:
        messages = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    payload = b"".join(bytes(message.events) for message in messages)
    expected = evt3.decode_bytes(payload, sensor_width=640, sensor_height=480)
    events = emseg.io.read(path)
    same(events, expected.x, expected.y, expected.timestamp, expected.polarity)
    stamp = messages[0].header.stamp
    assert int(events.t[0]) == stamp.sec * 1_000_000 + stamp.nanosec // 1000


def batches(reader: Any, method: str) -> Iterator[Any]:
    while (batch := getattr(reader, method)()) is not None:
        yield batch


@pytest.mark.parametrize("name", ["cars_davis346.aedat4", "cradle_davis346.aedat4"])
def test_dv_processing_agrees(name: str) -> None:
    dv = pytest.importorskip("dv_processing")
    path = real(name)
    reader = dv.io.MonoCameraRecording(str(path))
    expected = np.concatenate([batch.numpy() for batch in batches(reader, "getNextEventBatch")])
    events = emseg.io.read(path)
    assert events == EventArray.from_structured(expected, width=346, height=260)
    with emseg.io.open_recording(path) as opened:
        frames, imu = list(opened.frames()), opened.imu()
    pictures = list(batches(reader, "getNextFrame"))
    assert len(frames) == len(pictures) > 0
    for frame, picture in zip(frames, pictures, strict=True):
        np.testing.assert_array_equal(frame.image, picture.image)
        assert frame.t == picture.timestamp
    samples = [sample for batch in batches(reader, "getNextImuBatch") for sample in batch]
    assert imu.t.tolist() == [sample.timestamp for sample in samples]
    velocities = [sample.getAngularVelocities() for sample in samples]
    np.testing.assert_allclose(imu.angular_velocity, velocities, rtol=1e-5, atol=1e-7)
    # They take g for 9.81 m/s².
    accelerations = np.array([sample.getAccelerations() for sample in samples]) * (9.80665 / 9.81)
    np.testing.assert_allclose(imu.acceleration, accelerations, rtol=1e-4)


def test_libcaer_packets_agree_with_the_slow_way() -> None:
    """Words of libcaer_cmp one by one."""
    rosbags = pytest.importorskip("rosbags.rosbag2")
    path = real("legs_vga_2/test_events_2_0.mcap")
    events = emseg.io.read(path)
    rows: list[tuple[int, int, int, int]] = []
    with rosbags.Reader(path) as reader:
        for number, (_, _, raw) in enumerate(reader.messages()):
            if number == 3:
                break
            base = int.from_bytes(raw[44:52], "little") // 1000
            high = low = x = y = p = 0
            for word in np.frombuffer(raw, "<u2", offset=76 + len(raw) % 2).tolist():
                kind, rest = word >> 12, word & 0xFFF
                if kind == 0:
                    high = rest
                elif kind == 1:
                    low = rest
                elif kind == 2:
                    x = rest & 0x7FF
                elif kind == 3:
                    rows.append((x, rest & 0x7FF, base + (high << 12 | low), rest >> 11))
                elif kind == 4:
                    y, p = rest & 0x7FF, rest >> 11
                elif kind == 5:
                    rows += [(x, y + k, base + (high << 12 | low), p) for k in range(8) if rest >> k & 1]
                    y += 8
    expected = np.array(rows)
    assert len(expected) > 10_000
    part = events[: len(expected)]
    np.testing.assert_array_equal(np.stack([part.x, part.y, part.t, part.p], axis=1), expected)


def test_the_imu_of_aedat2_feels_gravity() -> None:
    with emseg.io.open_recording(real("boxes_translation_aedat2.aedat")) as opened:
        imu = opened.imu()
    assert len(imu) > 1000
    assert np.median(np.linalg.norm(imu.acceleration, axis=1)) == pytest.approx(9.81, abs=0.3)
