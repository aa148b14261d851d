"""Files that are wrong in one way or another: one line that names file and place; kept what can be read."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

import fuzz_readers
import numpy as np
import pytest
from made_recordings import HEIGHT, MADE, WIDTH, made_events, write_bag

import emseg.io
from emseg.events import EventArray
from emseg.io import ReadError

EVENTS = made_events()

# What is cut at the end of a line or of an event cannot be told from a whole file.
CUT_IS_SEEN = [name for name in MADE if name not in ("es", "text", "csv")]

# Compressed in one piece, or with what tells the rest at the end.
LOST_WHOLE = [
    name for name in MADE if name.startswith(("hdf5", "mat", "np", "mcap", "ros1", "db3", "aedat4 z"))
]


def make(name: str, folder: Path, events: EventArray = EVENTS) -> Path:
    suffix, write, modules = MADE[name]
    for module in modules:
        pytest.importorskip(module)
    path = folder / f"made{suffix}"
    write(path, events)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(ReadError) as caught:
        emseg.io.read(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    return message


@pytest.mark.parametrize("name", CUT_IS_SEEN)
def test_a_cut_file_is_refused_and_its_front_kept(tmp_path: Path, name: str) -> None:
    path = make(name, tmp_path)
    content = path.read_bytes()
    whole = emseg.io.read(path)
    at = len(content) * 7 // 10
    refused = 0
    for length in (at, at + 1):  # of which one does not end with a word of any format
        path.write_bytes(content[:length])
        try:
            emseg.io.read(path)
        except ReadError:
            refused += 1
            assert any(word in refusal(path) for word in ("truncated", "damaged", "ends after", "no sound"))
    assert refused > 0
    if name not in LOST_WHOLE:
        kept = emseg.io.read(path, damage="keep", width=WIDTH, height=HEIGHT)
        assert len(kept) > 0
        assert kept == whole[: len(kept)]


@pytest.mark.parametrize("name", list(MADE))
def test_cut_anywhere_it_is_refused_or_read(tmp_path: Path, name: str) -> None:
    path = make(name, tmp_path, EVENTS[:40])
    content = path.read_bytes()
    for length in np.linspace(0, len(content) - 1, 25).astype(int).tolist():
        path.write_bytes(content[:length])
        for keep in (False, True):
            fuzz_readers.check(path, keep=keep)


def faulty(**changes: tuple[int, int]) -> dict[str, np.ndarray]:
    columns = {name: getattr(EVENTS, name).astype(np.int64) for name in "xytp"}
    for name, (event, value) in changes.items():
        columns[name][event] = value
    return columns


@pytest.mark.parametrize(
    ("changes", "message", "lost"),
    [
        ({"x": (7, WIDTH)}, r"event 7 lies at \(346, \d+\), outside the sensor of 346x260", [7]),
        ({"y": (7, -3)}, r"event 7 lies at \(\d+, -3\), outside", [7]),
        ({"p": (9, 2)}, r"event 9 has polarity 2, expected 0 or 1", [9]),
        ({"t": (11, 5)}, r"event 11 has time 5 us, before its predecessor's \d+ us", [11]),
        ({"x": (7, 999), "t": (11, 5), "p": (300, 7)}, "event 7 lies at", [7, 11, 300]),
    ],
)
def test_faulty_events_are_named_or_left_out(
    tmp_path: Path,
    changes: dict[str, tuple[int, int]],
    message: str,
    lost: list[int],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("emseg.io.numpy_files.BLOCK_EVENTS", 100)
    monkeypatch.setattr("emseg.io.recording._WORTHWHILE_EVENTS", 1)
    path = tmp_path / "a.npz"
    np.savez(path, allow_pickle=False, **faulty(**changes), width=WIDTH, height=HEIGHT)
    with pytest.raises(ReadError, match=message):
        emseg.io.read(path)
    with caplog.at_level(logging.WARNING):
        kept = emseg.io.read(path, damage="keep")
    stay = np.ones(len(EVENTS), bool)
    stay[lost] = False
    assert kept == EVENTS[stay]
    assert f"{len(lost)} such events left out" in caplog.text


def test_a_fault_at_the_seam_of_chunks_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("emseg.io.numpy_files.BLOCK_EVENTS", 10)
    monkeypatch.setattr("emseg.io.recording._WORTHWHILE_EVENTS", 1)
    path = tmp_path / "a.npz"
    np.savez(path, allow_pickle=False, **faulty(t=(20, 3)), width=WIDTH, height=HEIGHT)
    assert "event 20 has time 3 us" in refusal(path)


def test_places_in_the_file_are_right(tmp_path: Path) -> None:
    path = make("dat", tmp_path)
    content = bytearray(path.read_bytes())
    start = len(content) - 8 * len(EVENTS)
    content[start + 8 * 33 + 4 : start + 8 * 33 + 8] = (5000).to_bytes(4, "little")
    path.write_bytes(content)
    assert f"byte {start + 8 * 33}: event 33 lies at (5000, 0)" in refusal(path)
    path = make("aedat3", tmp_path)
    content = bytearray(path.read_bytes())
    start = content.index(b"#!END-HEADER\r\n") + 14 + 28
    content[start + 8 * 12 + 4 : start + 8 * 12 + 8] = bytes(4)
    path.write_bytes(content)
    assert f"byte {start + 8 * 12}: event 12 has time 0 us" in refusal(path)


def test_a_bag_without_events_is_named(tmp_path: Path) -> None:
    rosbags = pytest.importorskip("rosbags.rosbag1")
    from made_recordings import _store, imu_message

    path = tmp_path / "imu.bag"
    with rosbags.Writer(path) as writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=_store(is_ros1=True))
        writer.write(connection, 1, imu_message(5, cdr=False))
    assert "holds no topic of events; its topics: /imu (sensor_msgs/msg/Imu)" in refusal(path)
    empty = tmp_path / "empty.bag"
    write_bag(empty, EVENTS[:1], "event_camera_msgs/msg/EventPacket", parts=1)
    assert len(emseg.io.read(empty)) == 1


@pytest.mark.parametrize("suffix", [".bag", ".db3", ".mcap"])
def test_an_unknown_encoding_in_a_bag_is_named(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("rosbags")
    path = tmp_path / f"a{suffix}"
    write_bag(path, EVENTS, "event_camera_msgs/msg/EventPacket", "mono")
    content = path.read_bytes()
    assert b"\0\0\0mono" in content
    path.write_bytes(content.replace(b"\0\0\0mono", b"\0\0\0moon"))
    message = refusal(path)
    assert "/events message 0" in message
    assert "events are encoded as 'moon', expected one of: evt3, libcaer_cmp" in message


def test_prophesees_codec_in_hdf5_is_named_with_a_way_out(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "ecf.h5"
    with h5py.File(path, "w") as file:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((64,))
        properties.set_filter(0x8ECF, h5py.h5z.FLAG_OPTIONAL, (0,))
        kind = h5py.h5t.py_create(EVENTS.to_structured().dtype)
        space = h5py.h5s.create_simple((len(EVENTS),))
        group = file.create_group("CD")
        h5py.h5d.create(group.id, b"events", kind, space, properties)
    message = refusal(path)
    assert "dataset 'CD/events': is compressed with Prophesee's codec ECF" in message
    assert "metavision_file_to_dat -i FILE" in message


def test_other_contents_are_named(tmp_path: Path) -> None:
    for header, message in (
        (b"% evt 4.0\n% geometry 3x3\n\1\2\3\4", "is encoded as EVT 4.0, expected EVT2, EVT2.1 or EVT3"),
        (
            b"% Version 2\n% Width 3\n% Height 3\n\x0e\x08",
            "events of type 14 and 8 bytes, expected type 0 or 12",
        ),
        (b"#!AER-DAT3.0\r\n#!END-HEADER\r\n", "is of version '3.0', expected 3.1"),
        (b"#!AER-DAT3.1\r\n#Format: COMPRESSED\r\n#!END-HEADER\r\n", "is encoded as COMPRESSED"),
        (b"Event Stream\2\0\0\4" + bytes(8), "holds events of type color, expected dvs or atis"),
        (b"Event Stream\1\0\0\1" + bytes(8), "is of version 1, expected 2"),
        (b"SQLite format 3\0" + bytes(200), "no ROS 2 bag"),
        (b"MATLAB 5.0 MAT-file" + bytes(20), "truncated or damaged"),
        (b"\x89HDF\r\n\x1a\n", "truncated or damaged"),
    ):
        path = tmp_path / "wrong"
        path.write_bytes(header)
        assert message in refusal(path), header


def test_a_damaged_aedat4_is_refused_at_once(tmp_path: Path) -> None:
    path = make("aedat4", tmp_path)
    content = path.read_bytes()
    with path.open("r+b") as file:
        file.seek(len(content) // 2)
        file.write(bytes(64))
    message = refusal(path)
    assert "damaged" in message
    assert "byte" in message
    assert 0 < len(emseg.io.read(path, damage="keep")) < len(EVENTS)


def test_fuzz() -> None:
    """A small part of what `python tests/python/fuzz_readers.py` does."""
    with tempfile.TemporaryDirectory() as name:
        files = fuzz_readers.sound_files(Path(name))
        results, failures = fuzz_readers.fuzz(files, range(8 * len(files)), seed=7)
    assert failures == []
    assert results["read"] > len(files)
    assert results["refused"] > len(files)


def test_texts_in_hdf5s_heap_are_not_looked_up(tmp_path: Path) -> None:
    """Damage there makes HDF5 spin; the size is then guessed."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["CD/events"] = EVENTS.to_structured()
        file["CD"].attrs["geometry"] = "640x480"
    events = emseg.io.read(path)
    assert (events.width, events.height) == (WIDTH, HEIGHT)


def test_a_damaged_length_in_hdf5_is_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for name in "xytp":
            file.create_dataset(f"events/{name}", (1 << 50,), "u1", chunks=(1 << 16,))
    assert f"dataset 'events': damaged: has {1 << 50} events in a file of" in refusal(path)


def test_a_filter_that_dies_or_hangs_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make("hdf5 dsec", tmp_path)
    for code, message in (
        ("import os; os.abort()", "its compression filter dies of it"),
        ("import time; time.sleep(60)", "its compression filter does not come to an end"),
    ):
        monkeypatch.setattr("emseg.io.hdf5._PROBE", code)
        monkeypatch.setattr("emseg.io.hdf5._PROBE_START_S", 1.0)
        assert message in refusal(path)
