"""Reading: formats are told by content, and whatever is wrong with a file is one clear error."""

from __future__ import annotations

import logging
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emseg.io
from emseg.events import EventArray
from emseg.io import ReadError, ReadOptions, Source, registry
from emseg.io.recording import Block

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
EVENTS = EventArray(
    [0, 3, 239, 1], [5, 4, 179, 0], [100, 200, 200, 3_000_000], [1, 0, 1, 1], width=240, height=180
)


def shared(name: str) -> Path:
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"needs the recording ../shared/data/{name}")
    return path


def columns(events: EventArray = EVENTS) -> dict[str, Any]:
    return {name: getattr(events, name) for name in "xytp"}


# NumPy files


@pytest.mark.parametrize(
    "arrays",
    [
        columns() | {"width": 240, "height": 180, "label": np.zeros(4), "K": np.eye(3)},
        columns()
        | {"t": EVENTS.t / 1e6, "p": 2 * EVENTS.p.astype(np.int8) - 1, "width": 240, "height": 180.0},
        {"ts": EVENTS.t, "X": EVENTS.x, "ys": EVENTS.y, "polarity": EVENTS.p > 0},
        {"events": np.stack([EVENTS.t / 1e6, EVENTS.x, EVENTS.y, EVENTS.p], 1)},
        {"events": np.stack([EVENTS.t, EVENTS.x, EVENTS.y, EVENTS.p], 1), "meta": np.array([1])},
        {"events": EVENTS.to_structured()},
    ],
)
def test_npz(tmp_path: Path, arrays: dict[str, Any]) -> None:
    for save, name in ((np.savez, "a.bin"), (np.savez_compressed, "b.aedat4")):  # the suffix does not matter
        with (tmp_path / name).open("wb") as file:
            save(file, **arrays)
        assert emseg.io.read(tmp_path / name) == EVENTS


def test_npy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", EVENTS.to_structured())
    assert emseg.io.read(tmp_path / "a.npy") == EVENTS
    assert emseg.io.read(tmp_path / "a.npy", width=500, height=300).width == 500


def test_sensor_size_is_guessed_with_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for corner, expected in (((239, 179), (240, 180)), ((240, 0), (304, 240)), ((1999, 5), (2000, 6))):
        np.savez(tmp_path / "a.npz", x=[0, corner[0]], y=[corner[1], 0], t=[1, 2], p=[0, 1])
        with caplog.at_level(logging.WARNING):
            events = emseg.io.read(tmp_path / "a.npz")
        assert (events.width, events.height) == expected
        assert f"taken to be {expected[0]}x{expected[1]}" in caplog.messages[-1]


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"x": [1], "y": [1]}, r"lacks t, p: expected x, y, t, p or events; its keys: x, y"),
        (columns() | {"t": [4, 3, 2, 1]}, r"key 't': event 1 has time 3 us, before"),
        (columns() | {"t": [0.1, np.nan, 0.2, 0.3]}, r"key 't': event 1 has time nan s"),
        (columns() | {"t": [0.1, 1e200, 0.2, 0.3]}, r"key 't': event 1 has time 1e\+200 s"),
        (
            columns() | {"width": 5, "height": 6},
            r"key 't': event 2 lies at \(239, 179\), outside.* of 5x6",
        ),
        (columns() | {"width": 5}, r"key 'height': the file gives width, expected height too"),
        (
            columns() | {"width": 5.5, "height": 1},
            r"key 'width': sensor width is 5.5",
        ),
        (columns() | {"width": [1, 2], "height": 1}, r"key 'width': expected one whole number"),
        (columns() | {"width": 0, "height": 1}, r"key 'width': sensor width is 0"),
        (columns() | {"x": [1, 2]}, r"event columns have different lengths"),
        (columns() | {"x": [-1, 2, 3, 4]}, r"key 't': event 0 lies at \(-1, 5\), outside the sensor"),
        (columns() | {"x": [np.inf, 2, 3, 4]}, r"no sensor holds coordinates up to \(inf"),
        (columns() | {"x": [np.nan, 2, 3, 4]}, r"key 't': event 0 lies at \(nan, 5\), outside"),
        (columns() | {"p": [0, 1, 7, 1]}, r"key 't': event 2 has polarity 7"),
        (columns() | {"x": ["a"] * 4}, r"key 'x': has shape \(4,\) and dtype <U1"),
        (columns() | {"x": np.zeros((4, 2))}, r"key 'x': has shape \(4, 2\)"),
        ({"events": np.zeros((3, 5))}, r"key 'events': has shape \(3, 5\)"),
        ({"events": np.zeros(3, [("x", int)])}, r"key 'events': has shape \(3,\)"),
        ({c: np.empty(0, int) for c in "xytp"}, r"holds no events and no sensor size"),
        (columns() | {"x": np.array([{}] * 4)}, r"key 'x': cannot be decoded.*Object arrays"),
    ],
)
def test_bad_npz(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ReadError, match=rf"a\.npz: {message}"):
        emseg.io.read(tmp_path / "a.npz")


# Text


@pytest.mark.parametrize(
    "content",
    [
        "100 0 5 1\n200 3 4 0\n200 239 179 1\n3000000 1 0 1\n",
        "240 180\n0.0001 0 5 1\n0.0002 3 4 0\n0.0002 239 179 1\n3.0 1 0 1\n",
        "# comment\n\n% other\n100,0,5,1\n200,3,4,-1\n200,239,179,1\n3000000,1,0,1",
        "x,y,timestamp,polarity\r\n0,5,100,1\r\n3,4,200,0\r\n239,179,200,1\r\n1,0,3000000,1\r\n",
        "t;x;y;p;extra\n100;0;5;1;7\n200;3;4;0;7\n200;239;179;1;7\n3000000;1;0;1;7\n",
        "\ufeff100\t0\t5\t1\n# between\n200\t3\t4\t0\n200\t239\t179\t1\n\n3000000\t1\t0\t1\n",
        "100 0.0 5 1\n200 3 4 0\n200 239 179 1\n3000000 1 0 1\n",
        "  1e-4   0 5  1  \n 2e-4 3 4 0\n2e-4 239.0 179 1\n  3. 1 0 1\n",
    ],
)
def test_text(tmp_path: Path, content: str) -> None:
    path = tmp_path / "events.dat"
    path.write_text(content, encoding="utf-8", newline="")
    assert emseg.io.read(path) == EVENTS


def test_text_with_signed_polarities_and_large_times(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("1589163147368868 1 2 -1\n1589163147368869 1 2 1\n")
    assert emseg.io.read(path).to_structured().tolist() == [
        (1, 2, 1589163147368868, 0),
        (1, 2, 1589163147368869, 1),
    ]


def test_text_may_hold_no_events(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("# t x y p\n346 260\n")
    assert emseg.io.read(tmp_path / "a.txt") == EventArray([], [], [], [], width=346, height=260)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 2 3 1\n2 2 3\n", "line 2: 3 columns, expected 4"),
        ("1 2 3 1\n2 2 3 1 9\n", "line 2: 5 columns, expected 4"),
        ("# c\n1 2 3 1\n\n2 x 3 1\n", "line 4: x is 'x', expected a finite number"),
        ("1 2 3 1\n2 nan 3 1\n", "line 2: x is 'nan', expected a finite number"),
        ("1 2 3 1\nnan 2 3 1\n", "line 2: t is 'nan'"),
        ("1 2 3 1\ninf 2 3 1\n", "time inf s"),
        ("1,2,3,1\n2,,3,1\n", "line 2: x is ''"),
        ("1 2 3 1\n2 2 3 True\n", "line 2: p is 'True'"),
        (
            "1 2 3 1\n99999999999999999999999 2 3 1\n",
            "(line 2: t is '9+'|column t: event 1 .*), expected a finite",
        ),
        ("# c\n5 2 3 1\n# d\n4 2 3 1\n", "line 4: event 1 has time 4 us, before"),
        ("4 4\n1 2 3 1\n2 2 4 1\n", r"line 3: event 1 lies at \(2, 4\), outside"),
        ("1 2 3 1\n2 -2 3 1\n", r"line 2: event 1 lies at \(-2, 3\)"),
        ("1 2 3 1\n2 2.5 3 1\n", r"line 2: event 1 lies at \(2\.5, 3\.0\)"),
        ("1 2 3 1\n2 2 3 5\n", "line 2: event 1 has polarity 5"),
        ("x,y,t,p\n", "holds no events and no sensor size"),
        ("# nothing\n\n", "holds no line of numbers"),
        ("Dear reader\n", "is in no known format"),
        ("1 2 3\n", "is in no known format"),
    ],
)
def test_bad_text(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(ReadError, match=message) as caught:
        emseg.io.read(tmp_path / "a.txt")
    assert str(caught.value).startswith(str(tmp_path / "a.txt"))
    assert "\n" not in str(caught.value)


# Files that are none


def test_missing_empty_and_folders(tmp_path: Path) -> None:
    (tmp_path / "empty.npz").touch()
    for name, message in (("none.npz", "no such file"), ("empty.npz", "is empty"), (".", "is a directory")):
        with pytest.raises(ReadError, match=message):
            emseg.io.read(tmp_path / name)
    with pytest.raises(ReadError, match="null"):
        emseg.io.read("a\0b")


@pytest.mark.parametrize(
    ("head", "name"),
    [
        (b"#!AER-DAT1.0\r\n", "AEDAT 1, which is not supported"),
        (b"\x1f\x8b\x08", "gzip-compressed data: unpack it first"),
        (b"7z\xbc\xaf\x27\x1c", "a 7z archive: unpack it first"),
    ],
)
def test_formats_not_supported_are_named(tmp_path: Path, head: bytes, name: str) -> None:
    (tmp_path / "a.npz").write_bytes(head)
    with pytest.raises(ReadError, match=f"recognised as {name}"):
        emseg.io.read(tmp_path / "a.npz")


def test_other_archives_and_bytes_are_not_recognised(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("x.txt", "1")
    (tmp_path / "b.npz").write_bytes(bytes(range(256)))
    for name in ("a.npz", "b.npz"):
        with pytest.raises(ReadError, match="is in no known format, expected one of: AEDAT 4"):
            emseg.io.read(tmp_path / name)


def test_size_needs_both_sides(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected both or neither"):
        emseg.io.read(tmp_path, width=3)


def test_readers_of_other_packages_are_asked_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Constant(Source):
        size = 240, 180

        def blocks(self) -> Iterator[Block]:
            yield Block(EVENTS.x, EVENTS.y, EVENTS.t, EVENTS.p)

    class Anything:
        name = "anything"

        def recognises(self, path: Path, head: bytes) -> bool:
            return head == b"1 2 3 1"

        def open(self, path: Path, options: ReadOptions) -> Source:
            return Constant()

    readers = (Anything(), *registry.readers())
    monkeypatch.setattr(registry, "readers", lambda: iter(readers))
    (tmp_path / "a").write_bytes(b"1 2 3 1")
    assert emseg.io.read(tmp_path / "a") == EVENTS


# Damage


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Cut, flipped or blanked somewhere."""
    data = bytearray(content)
    where = rng.randrange(len(data) if rng.random() < 0.7 else min(len(data), 4000))
    match rng.choice(["cut", "flip", "blank", "insert"]):
        case "cut":
            del data[where:]
        case "flip":
            for _ in range(rng.choice([1, 30])):
                data[rng.randrange(where, len(data))] ^= 1 << rng.randrange(8)
        case "blank":
            length = min(rng.choice([4, 1000]), len(data) - where)
            data[where : where + length] = bytes(length)
        case "insert":
            data[where:where] = rng.randbytes(rng.choice([1, 100]))
    return bytes(data)


def read_or_refuse(path: Path) -> str:
    """An EventArray or a ReadError, nothing else: its message, "" for events."""
    message = ""
    try:
        emseg.io.read(path)
    except ReadError as error:
        message = str(error)
    assert not message or message.startswith(str(path))
    assert "\n" not in message
    return message


@pytest.mark.parametrize("kind", ["npz", "compressed", "npy", "text"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, kind: str) -> None:
    rng = random.Random(kind)
    n = 300
    t = np.cumsum(np.arange(n) % 7)
    events = EventArray(np.arange(n) % 40, np.arange(n) % 30, t, np.arange(n) % 2, width=40, height=30)
    path = tmp_path / "events"
    with path.open("wb") as file:
        match kind:
            case "npz":
                np.savez(file, **columns(events))
            case "compressed":
                np.savez_compressed(file, **columns(events))
            case "npy":
                np.save(file, events.to_structured())
            case "text":
                np.savetxt(file, np.stack([events.t, events.x, events.y, events.p], 1), fmt="%d")
    content = path.read_bytes()
    refused = 0
    for _ in range(150):
        path.write_bytes(damaged(content, rng))
        refused += bool(read_or_refuse(path))
    assert refused > 20  # the damage is real


# Every other file of the house


@pytest.mark.parametrize("folder", ["reference", "sim"])
def test_windows_and_scenes(folder: str) -> None:
    path = sorted(shared(folder).glob("*.npz"))[0]
    events = emseg.io.read(path)
    with np.load(path) as arrays:
        expected = arrays["t"] if arrays["t"].dtype.kind == "i" else np.rint(arrays["t"] * 1e6)
        assert (events.t == expected).all()
        assert (events.p == (arrays["p"] > 0)).all()
        assert (events.width, events.height) == (arrays["width"], arrays["height"])
