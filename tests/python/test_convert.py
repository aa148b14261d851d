"""`emseg info` and `emseg convert`: round trips through every format, parts, filters and refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_recordings import HEIGHT, MADE, WIDTH, made_events
from typer.testing import CliRunner, Result

import emseg.io
from emseg import filters
from emseg.cli import app
from emseg.events import EventArray
from emseg.io import writing

EVENTS = made_events()
MODULES = {".aedat4": ("dv_processing", "lz4"), ".h5": ("h5py",)}


def emseg_(*arguments: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert "Traceback" not in result.output
    return result


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "made.npz"
    MADE["npz"][1](path, EVENTS)
    return path


@pytest.mark.parametrize("suffix", list(writing.SUFFIXES))
def test_round_trip(tmp_path: Path, recording: Path, suffix: str) -> None:
    for module in MODULES.get(suffix, ()):
        pytest.importorskip(module)
    target = tmp_path / f"converted{suffix}"
    result = emseg_("convert", recording, target)
    assert result.exit_code == 0, result.output
    assert f"{len(EVENTS)} events, {WIDTH}x{HEIGHT}" in result.output
    assert emseg.io.read(target) == EVENTS
    back = tmp_path / "back.npz"
    assert emseg_("convert", target, back).exit_code == 0
    assert emseg.io.read(back) == EVENTS
    assert {path.name for path in tmp_path.iterdir()} == {"made.npz", target.name, "back.npz"}


@pytest.mark.parametrize("form", list(writing.FORMATS))
def test_many_chunks_none_and_late_times(tmp_path: Path, form: str) -> None:
    suffix = next(suffix for suffix, name in writing.SUFFIXES.items() if name == form)
    for module in MODULES.get(suffix, ()):
        pytest.importorskip(module)
    path = tmp_path / f"a{suffix}"
    size = {"width": WIDTH, "height": HEIGHT}
    late = EventArray(EVENTS.x, EVENTS.y, EVENTS.t + 1_700_000_000_000_000, EVENTS.p, **size)
    pieces = [late[k : k + 37] for k in range(0, len(late), 37)]
    assert writing.write_events(path, iter(pieces), size=(WIDTH, HEIGHT), form=form) == len(late)
    assert emseg.io.read(path) == late
    assert writing.write_events(path, iter(()), size=(WIDTH, HEIGHT), form=form) == 0
    assert emseg.io.read(path) == EventArray([], [], [], [], **size)


def test_part_of_a_recording(tmp_path: Path, recording: Path) -> None:
    target = tmp_path / "part.npz"
    result = emseg_("convert", recording, target, "--span", "0.01:0.05", "--crop", "100,50,120,80")
    assert result.exit_code == 0, result.output
    span = EVENTS.between(int(EVENTS.t[0]) + 10_000, int(EVENTS.t[0]) + 50_000)
    inside = (span.x >= 100) & (span.x < 220) & (span.y >= 50) & (span.y < 130)
    part = emseg.io.read(target)
    assert 0 < inside.sum() == len(part)
    assert (part.width, part.height) == (120, 80)
    assert part.x.tolist() == (span.x[inside] - 100).tolist()
    assert part.y.tolist() == (span.y[inside] - 50).tolist()
    assert part.t.tolist() == span.t[inside].tolist()


def noisy() -> tuple[EventArray, np.ndarray]:
    """A line that moves, one pixel that fires by itself all the time, lone events; what each event is."""
    rng = np.random.default_rng(1)
    rows = []
    for step in range(60):
        rows += [(step, y, 1000 * step + y, 0) for y in range(40)]
    rows += [(70, 20, 300 * k, 1) for k in range(200)]
    rows += [(90 + 6 * (k % 5), 3 + 6 * (k // 5 % 5), int(rng.integers(0, 60_000)), 2) for k in range(25)]
    table = np.array(sorted(rows, key=lambda row: row[2]))
    x, y, t, kind = table.T
    return EventArray(x, y, t, np.ones(len(t), np.uint8), width=128, height=48), kind


def test_filters(tmp_path: Path) -> None:
    events, kind = noisy()
    source, target = tmp_path / "noisy.npz", tmp_path / "clean.npz"
    writing.write_events(source, [events], size=(128, 48), form="npz")
    for options, dropped in ((["hot"], {1}), (["noise"], {1, 2}), (["hot", "noise"], {1, 2})):
        arguments = [word for name in options for word in ("--filter", name)]
        assert emseg_("convert", source, target, "--overwrite", *arguments).exit_code == 0
        kept = emseg.io.read(target)
        expected = events[~np.isin(kind, list(dropped))]
        if "noise" in options:  # the line's very first events have no company yet
            assert 0 <= len(expected) - len(kept) <= 2
            assert set(zip(kept.x, kept.y, strict=True)) <= set(zip(expected.x, expected.y, strict=True))
        else:
            assert kept == expected


def test_hot_pixels_are_few_and_lone() -> None:
    counts = np.full((20, 30), 50)
    counts[5, 7], counts[0, 0], counts[19, 29] = 2000, 600, 500
    counts[10:12, 10:20] = 5000  # busy neighbours
    hot = filters.hot_pixels(counts)
    assert sorted(map(tuple, np.argwhere(hot).tolist())) == [(0, 0), (5, 7)]
    assert not filters.hot_pixels(np.zeros((0, 0), np.int64)).any()
    assert filters.hot_pixels(np.array([[1000]])).all()


def test_filters_do_not_mind_where_chunks_are_cut() -> None:
    events, _ = noisy()
    pieces = [events[k : k + 101] for k in range(0, len(events), 101)]
    whole = EventArray.concatenate(filters.drop_noise([events]))
    assert EventArray.concatenate(filters.drop_noise(pieces)) == whole
    np.testing.assert_array_equal(filters.count_events(pieces), filters.count_events([events]))
    crop = filters.Crop(3, 4, 60, 30)
    assert EventArray.concatenate(filters.crop_events(pieces, crop)) == next(
        filters.crop_events([events], crop)
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{in}", "out.xyz"], "no known suffix, expected one of: .aedat4, .npz"),
        (["{in}", "{in}"], "exists; --overwrite replaces it"),
        (["{in}", "{in}", "--overwrite"], "cannot be replaced"),
        (["{in}", "nowhere/out.npz"], "nowhere is no folder"),
        (["{in}", "out.npz", "--span", "2"], "span is '2', expected seconds"),
        (["{in}", "out.npz", "--span", "2:1"], "span is '2:1', expected seconds"),
        (["{in}", "out.npz", "--crop", "1,2,3"], "crop is '1,2,3', expected X,Y,WIDTH,HEIGHT"),
        (["{in}", "out.npz", "--crop", "1,2,0,4"], "expected a size of at least 1x1"),
        (["{in}", "out.npz", "--size", "3"], "size is '3', expected such as 346x260"),
        (["{in}", "out.npz", "--columns", "xyz"], "columns are 'xyz'"),
        (["{in}", "out.npz", "--filter", "all"], "'all' is not one of"),
    ],
)
def test_wrong_usage_exits_with_2(
    tmp_path: Path, recording: Path, arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = emseg_("convert", *(argument.format(**{"in": recording.name}) for argument in arguments))
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())
    assert emseg.io.read(recording) == EVENTS


def test_failures_exit_with_1_and_leave_nothing(tmp_path: Path, recording: Path) -> None:
    target = tmp_path / "out.npz"
    content = recording.read_bytes()
    recording.write_bytes(content[: len(content) // 2])
    for arguments in ([], ["--crop", "0,0,9,9"]):
        result = emseg_("convert", recording, target, *arguments)
        assert result.exit_code == 1
        assert "made.npz" in result.output
    recording.write_bytes(content)
    result = emseg_("convert", recording, target, "--crop", "300,0,60,9")
    assert result.exit_code == 1
    assert "reaches beyond the sensor of 346x260" in result.output
    assert list(tmp_path.iterdir()) == [recording]


def test_damage_is_kept_out_on_request(tmp_path: Path) -> None:
    source, target = tmp_path / "cut.dat", tmp_path / "kept.npz"
    MADE["dat"][1](source, EVENTS)
    source.write_bytes(source.read_bytes()[:-1003])  # 125 events and part of one
    assert emseg_("convert", source, target).exit_code == 1
    assert emseg_("convert", source, target, "--keep-going").exit_code == 0
    assert emseg.io.read(target) == EVENTS[:-126]
    result = emseg_("info", source, "--keep-going")
    assert result.exit_code == 0
    assert f"events    {len(EVENTS) - 126}" in result.output


def test_info_of_good_and_bad(tmp_path: Path, recording: Path) -> None:
    bad = tmp_path / "bad.npz"
    bad.write_bytes(b"")
    result = emseg_("info", recording, bad)
    assert result.exit_code == 1
    for line in ("format    NumPy archive", "sensor    346x260", "events    400", "is empty"):
        assert line in result.output
    pytest.importorskip("rosbags")
    bag = tmp_path / "a.bag"
    MADE["ros1 dvs"][1](bag, EVENTS)
    result = emseg_("info", bag)
    assert result.exit_code == 0
    for line in ("frames    4 of 3x2", "imu       4 samples"):
        assert line in result.output
