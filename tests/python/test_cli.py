"""The command line: what it writes, resumes, refuses and survives; the segmenter itself is a fake."""

from __future__ import annotations

import csv
import dataclasses
import errno
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import emseg
from emseg import batch, cli, writers
from emseg.cli import app
from emseg.config import Config
from emseg.events import EventArray

HERE = Path(__file__).parent
PYTHON = HERE.parents[1] / "python"


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))
    use(monkeypatch, "FakeSegmenter")


def use(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(batch, "SEGMENTER", f"fake_segmenter:{name}")


def recording(path: Path, n: int = 1200, seed: int = 0) -> Path:
    rng = np.random.default_rng(seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    t = np.sort(rng.integers(0, 100_000, n))
    columns = {"x": rng.integers(0, 64, n), "y": rng.integers(0, 48, n), "t": t, "p": rng.integers(0, 2, n)}
    np.savez(path, **columns, width=64, height=48)
    return path


def emseg_(*arguments: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert "Traceback" not in result.output
    return result


def contents(folder: Path) -> dict[str, bytes]:
    """Every result file that must not depend on how it was made."""
    names = ("labels.npz", "models.json", "tracks.csv", "preview.png", "motion.png")
    return {name: (folder / name).read_bytes() for name in names}


def test_segment_writes_everything(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.npz")
    result = emseg_("segment", source, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "done: " in result.output
    assert "1,200 events (25% thinned), 3 windows, 2 tracks" in result.output
    folder = tmp_path / "out" / "a"
    with np.load(folder / "labels.npz") as arrays:
        assert {name: arrays[name].dtype for name in arrays} == {
            "start": np.int64,
            "stop": np.int64,
            "t_ref": np.int64,
            "labels": np.int32,
        }
        assert arrays["start"].tolist() == [0, 500, 1000]
        assert arrays["stop"].tolist() == [500, 1000, 1200]
        labels = arrays["labels"]
    events = emseg.read(source)
    assert (labels == 1).tolist() == ((events.x < 32) & (events.y < 24)).tolist()
    models = json.loads((folder / "models.json").read_text())
    assert [window["stop"] for window in models] == [500, 1000, 1200]
    assert models[0]["models"][1] == {"label": 1, "kind": "translation", "params": [1.0, 2.0]}
    with (folder / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["window", "t_us", "track", "x", "y", "w", "h", "events"]
    assert sum(int(row["events"]) for row in rows if row["track"] == "2") == (labels == 2).sum()
    run = json.loads((folder / "run.json").read_text())
    assert run["config"] == dataclasses.asdict(Config())
    assert (run["version"], run["seed"], run["input"]["events"]) == (emseg.__version__, 0, 1200)
    assert (run["windows"], run["thinned"]) == (3, 300)
    assert run["timings_s"]["stages"] == {"graph": 0.75, "labels": 1.5}
    assert len(run["input_sha256"]) == 64
    assert sorted(path.name for path in folder.iterdir()) == [
        "labels.npz",
        "models.json",
        "motion.png",
        "preview.png",
        "run.json",
        "tracks.csv",
    ]
    loaded, _ = writers.load_result(folder)
    assert loaded.labels.tolist() == labels.tolist()
    assert loaded.tracks["x"].tolist() == [0, 32] * 3


def test_finished_results_are_skipped(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.npz")
    arguments = ("segment", source, "--out", tmp_path / "out")
    emseg_(*arguments)
    run = tmp_path / "out" / "a" / "run.json"
    before = run.stat().st_mtime_ns
    again = emseg_(*arguments)
    assert (again.exit_code, run.stat().st_mtime_ns) == (0, before)
    assert "skipped: " in again.output

    other = emseg_(*arguments, "--preset", "eed/occlusions")
    assert other.exit_code == 1
    assert "holds a result of other settings; --overwrite replaces it" in other.output
    assert run.stat().st_mtime_ns == before
    assert emseg_(*arguments, "--preset", "eed/occlusions", "--overwrite").exit_code == 0
    assert json.loads(run.read_text())["config"]["lambda_label"] == 4000

    recording(source, seed=1)
    changed = emseg_(*arguments, "--preset", "eed/occlusions")
    assert changed.exit_code == 1
    assert "holds another recording's result" in changed.output

    run.write_text("{")
    assert "holds no complete result" in emseg_(*arguments).output


def test_some_failed(tmp_path: Path) -> None:
    good = recording(tmp_path / "good.npz")
    bad = tmp_path / "bad.npz"
    bad.write_bytes(good.read_bytes()[:300])
    result = emseg_("segment", bad, tmp_path / "none.npz", good, "--out", tmp_path / "out")
    assert result.exit_code == 1
    lines = result.stderr.splitlines()
    assert lines[0].startswith(f"failed: {bad}: is no sound NumPy file")
    none = tmp_path / "none.npz"
    assert lines[1:] == [f"failed: {none}: no such file", "2 of 3 failed:", f"  {bad}", f"  {none}"]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["good"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("segment", "a.npz"),
        ("segment", "--out", "out"),
        ("segment", "a.npz", "--out", "out", "--jobs", "0"),
        ("segment", "a.npz", "--out", "out", "--preset", "none"),
        ("segment", "a.npz", "--out", "out", "--config", "none.yaml"),
        ("segment", "a.npz", "--out", "out", "--config", "bad.yaml"),
        ("segment", "a.npz", "--out", "out", "--config", "good.yaml", "--preset", "eed/occlusions"),
        ("segment", "a.npz", "--out", "out", "--camera", "none.yaml"),
        ("segment", "a.npz", "--out", "out", "--camera", "bad.yaml"),
        ("segment", "a.npz", "--out", "a.npz"),
        ("segment", "empty", "--out", "out"),
        ("config", "--preset", "none"),
        ("nothing",),
    ],
)
def test_bad_usage(arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording(Path("a.npz"))
    Path("empty").mkdir()
    Path("good.yaml").write_text("sigma: 1.0\n")
    Path("bad.yaml").write_text("sigmo: 1.0\n")
    assert emseg_(*arguments).exit_code == 2
    assert not Path("out").exists()


def test_bad_config_names_file_and_key(tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text("LAMBDA_smoth: 3\n")
    source = recording(tmp_path / "a.npz")
    result = emseg_("segment", source, "--out", tmp_path / "out", "--config", tmp_path / "my.yaml")
    assert result.exit_code == 2
    words = " ".join(result.stderr.replace("│", " ").split())
    assert "LAMBDA_smoth: unknown key, did you mean 'lambda_smooth'?" in words


def test_folders_are_walked(tmp_path: Path) -> None:
    recording(tmp_path / "in" / "a.npz")
    recording(tmp_path / "in" / "deep" / "a.npz", seed=1)
    recording(tmp_path / "in" / "deep" / "b.npz", seed=2)
    (tmp_path / "in" / "README.md").write_text("Events\n")
    (tmp_path / "in" / ".hidden.npz").write_bytes(b"PK")
    np.savez(tmp_path / "in" / "poses.npz", poses=np.eye(4))
    out = tmp_path / "in" / "out"
    assert emseg_("segment", tmp_path / "in", "--out", out).exit_code == 0
    names = {path.name for path in out.iterdir()}
    assert names == {"in-a_npz", "deep-a_npz", "b"}
    again = emseg_("segment", tmp_path / "in", "--out", out)  # its own results are no inputs
    assert again.output.count("skipped: ") == 3
    assert again.exit_code == 0


def test_names_never_clash(tmp_path: Path) -> None:
    files = ("a.npz", "a.txt", "x/b.npz", "y/b.npz", "u/z/c.txt", "v/z/c.txt", "d.npz")
    paths = [Path(name) for name in files]
    names = batch.name_inputs(paths)
    assert len(set(names)) == len(names)
    assert names[:4] == ["a_npz", "a_txt", "x-b_npz", "y-b_npz"]
    assert names[6] == "d"
    assert names == batch.name_inputs(paths)
    assert batch.name_inputs([Path("a.npz"), Path("a_npz"), Path("a.txt")]) != ["a_npz"] * 3


def test_jobs_do_not_change_results(tmp_path: Path) -> None:
    sources = [recording(tmp_path / f"{k}.npz", n=600 + k, seed=k) for k in range(4)]
    assert emseg_("segment", *sources, "--out", tmp_path / "one").exit_code == 0
    two = emseg_("segment", *sources, "--out", tmp_path / "two", "--jobs", "2")
    assert two.exit_code == 0, two.output
    for source in sources:
        assert contents(tmp_path / "one" / source.stem) == contents(tmp_path / "two" / source.stem)


def test_a_process_that_dies_takes_no_other_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, "DyingSegmenter")
    sources = [recording(tmp_path / f"{k}.npz", n=600 + k) for k in range(3)]
    result = emseg_("segment", *sources, "--out", tmp_path / "out", "--jobs", "2")
    assert result.exit_code == 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir() if path.name[0] != ".") == ["0", "2"]
    assert f"failed: {sources[1]}: its process died" in result.output


def test_defects_of_ours_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, "RaisingSegmenter")
    result = emseg_("segment", recording(tmp_path / "a.npz"), "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert "a.npz: RuntimeError: two lines" in result.output
    assert list((tmp_path / "out").glob("*")) == []


def test_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: Any, **options: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writers.ResultWriter, "finish", full)
    source = recording(tmp_path / "a.npz")
    result = emseg_("segment", source, "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert f"failed: {source}: no space left to write {tmp_path / 'out' / 'a'}" in result.output
    assert list((tmp_path / "out").iterdir()) == []


# A command line that stops in the midst of writing; patched at the top, for the processes it starts too.
HALF_WRITTEN = """
import time
from emseg import batch, cli

def stop_halfway(writer, seg):
    (writer._folder / "half").write_text("x")
    time.sleep(60)

batch.ResultWriter.add = stop_halfway
batch.SEGMENTER = "fake_segmenter:FakeSegmenter"
if __name__ == "__main__":
    cli.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_interruption_leaves_nothing_half(tmp_path: Path, number: signal.Signals, jobs: str) -> None:
    sources = [recording(tmp_path / f"{k}.npz", seed=k) for k in range(2)]
    script = tmp_path / "run.py"
    script.write_text(HALF_WRITTEN)
    environment = os.environ | {"PYTHONPATH": f"{PYTHON}{os.pathsep}{HERE}"}
    command = [sys.executable, str(script), "segment", *map(str, sources), "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [*command, "--jobs", jobs],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        text=True,
        # A shell's background jobs, and so what a test runner starts there, are born deaf to SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    out = tmp_path / "out"
    deadline = time.monotonic() + 20
    while not list(out.glob(".*.tmp-*/half")) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert list(out.glob(".*.tmp-*/half"))
    assert process.poll() is None
    process.send_signal(number)
    output, _ = process.communicate(timeout=20)
    assert "Traceback" not in output
    assert process.returncode == 128 + number
    assert list(out.iterdir()) == []


def test_version_and_help() -> None:
    assert emseg_("--version").output == f"{emseg.__version__}\n"
    assert "segment" in emseg_("--help").output


def test_file_size_limit_is_a_full_disk(tmp_path: Path) -> None:
    """The system's own error, from a limit that is met in the midst of a file."""
    source = recording(tmp_path / "a.npz")
    code = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000)); "
        "from emseg import batch, cli; batch.SEGMENTER = 'fake_segmenter:FakeSegmenter'; cli.main()"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, "segment", str(source), "--out", str(tmp_path / "out")],
        env=os.environ | {"PYTHONPATH": f"{PYTHON}{os.pathsep}{HERE}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 1
    assert "no space left to write" in told.stderr
    assert "Traceback" not in told.stderr
    assert list((tmp_path / "out").iterdir()) == []


def test_progress_on_a_terminal(tmp_path: Path) -> None:
    """A bar that counts events, and only there."""
    source = recording(tmp_path / "a.npz")
    code = "from emseg import batch, cli; batch.SEGMENTER = 'fake_segmenter:FakeSegmenter'; cli.main()"
    command = [sys.executable, "-c", code, "segment", str(source), "--out", str(tmp_path / "out")]
    environment = os.environ | {"PYTHONPATH": f"{PYTHON}{os.pathsep}{HERE}", "TERM": "xterm"}
    terminal, other_end = pty.openpty()
    termios.tcsetwinsize(other_end, (24, 100))
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=other_end)
    output, _ = process.communicate(timeout=30)
    os.set_blocking(terminal, False)
    shown = os.read(terminal, 65536).decode()
    os.close(terminal)
    os.close(other_end)
    assert process.returncode == 0
    assert "a.npz" in shown
    assert "events/s" in shown
    assert output.decode().startswith("done: ")
    plain = subprocess.run(
        [*command, "--overwrite"], env=environment, capture_output=True, text=True, check=True
    )
    assert plain.stderr == ""


def test_info(tmp_path: Path) -> None:
    result = emseg_("info", recording(tmp_path / "a.npz"), tmp_path / "none")
    assert result.exit_code == 1
    assert "sensor    64x48" in result.output
    assert "events    1,200" in result.output
    assert "no such file" in result.stderr
    np.savez(tmp_path / "e.npz", **{c: np.empty(0, int) for c in "xytp"}, width=3, height=2)
    assert "events    0" in emseg_("info", tmp_path / "e.npz").output


def test_config_prints_yaml_that_reads_back(tmp_path: Path) -> None:
    assert emseg_("config", "--list").output.splitlines() == Config.presets()
    for preset in (None, "hkust/cast"):
        printed = emseg_("config", *(("--preset", preset) if preset else ())).output
        (tmp_path / "c.yaml").write_text(printed)
        assert Config.from_yaml(tmp_path / "c.yaml") == (Config.preset(preset) if preset else Config())


def test_a_part_of_a_recording(tmp_path: Path) -> None:
    source, out = recording(tmp_path / "a.npz"), tmp_path / "out"
    part = ("--span", "0.02:0.06", "--crop", "8,4,40,30")
    assert emseg_("segment", source, "--out", out, *part).exit_code == 0
    assert emseg_("convert", source, tmp_path / "b.npz", *part).exit_code == 0
    expected = emseg.read(tmp_path / "b.npz")
    run = json.loads((out / "a" / "run.json").read_text())
    assert (run["input"]["events"], run["input"]["width"], run["input"]["height"]) == (len(expected), 40, 30)
    assert run["reading"]["span"] == [0.02, 0.06]
    events, result = batch.read_result(out / "a")
    assert events == expected
    assert (result.labels == 1).tolist() == ((events.x < 20) & (events.y < 15)).tolist()
    assert "skipped" in emseg_("segment", source, "--out", out, *part).output
    other = emseg_("segment", source, "--out", out, *part[:2])  # another part is another result
    assert "holds a result of other settings" in other.output
    outside = emseg_("segment", source, "--out", tmp_path / "c", "--crop", "8,4,60,30")
    assert (outside.exit_code, list((tmp_path).glob("c/*"))) == (1, [])
    assert "reaches beyond the sensor of 64x48" in outside.stderr
    assert emseg_("segment", source, "--out", tmp_path / "c", "--crop", "8").exit_code == 2


def test_a_crop_moves_the_camera_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = recording(tmp_path / "a.npz")
    (tmp_path / "c.yaml").write_text("{width: 64, height: 48, fx: 60, fy: 60, cx: 32, cy: 24}\n")
    seen = []
    make = batch._camera
    monkeypatch.setattr(batch, "_camera", lambda *a: seen.append(make(*a)) or seen[-1])
    options = ("--crop", "8,4,40,30", "--camera", tmp_path / "c.yaml")
    assert emseg_("segment", source, "--out", tmp_path / "out", *options).exit_code == 0
    camera = seen[0]
    assert (camera.width, camera.height, camera.cx, camera.cy, camera.fx) == (40, 30, 24, 20, 60)


def test_damage_is_kept_when_asked(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.npz")
    arrays = dict(np.load(source))
    arrays["x"][7] = 200
    np.savez(source, **arrays)
    refused = emseg_("segment", source, "--out", tmp_path / "out")
    assert refused.exit_code == 1
    assert "event 7 lies at (200," in refused.stderr
    kept = emseg_("segment", source, "--out", tmp_path / "out", "--keep-going")
    assert kept.exit_code == 0
    assert "1,199 events" in kept.output


def test_camera_files(tmp_path: Path) -> None:
    source = recording(tmp_path / "a.npz")
    (tmp_path / "c.txt").write_text("60 60 32 24 0 0 0 0 0\n")
    (tmp_path / "c.yaml").write_text("{width: 64, height: 48, fx: 60, fy: 60, cx: 32, cy: 24}\n")
    (tmp_path / "other.yaml").write_text("{width: 65, height: 48, fx: 60, fy: 60, cx: 32, cy: 24}\n")
    arguments = ("segment", source, "--out")
    for name in ("c.txt", "c.yaml"):
        result = emseg_(*arguments, tmp_path / f"out-{name}", "--camera", tmp_path / name)
        assert result.exit_code == 0, result.output
    other = emseg_(*arguments, tmp_path / "out", "--camera", tmp_path / "other.yaml")
    assert other.exit_code == 1
    assert "width is 65, but 64 was asked for" in other.output


@pytest.mark.parametrize("with_video_at_once", [True, False])
def test_video_and_render(tmp_path: Path, with_video_at_once: bool) -> None:
    pytest.importorskip("imageio_ffmpeg")
    source = recording(tmp_path / "a.npz")
    arguments = ("segment", source, "--out", tmp_path / "out")
    video = tmp_path / "out" / "a" / "segmentation.mp4"
    assert emseg_(*arguments, *(["--video"] if with_video_at_once else [])).exit_code == 0
    assert video.exists() == with_video_at_once
    assert emseg_(*arguments, "--video").exit_code == 0  # is added to a finished result
    first = video.read_bytes()
    video.unlink()
    assert emseg_("render", tmp_path / "out" / "a").exit_code == 0
    assert video.read_bytes() == first
    recording(source, seed=3)
    other = emseg_("render", tmp_path / "out" / "a")
    assert other.exit_code == 1
    assert "is not the recording that" in other.output
    assert "no such file" in emseg_("render", tmp_path / "none").output
    assert {path.name for path in (tmp_path / "out" / "a").iterdir() if path.name[0] == "."} == set()


def test_view_without_a_display_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    source = recording(tmp_path / "a.npz")
    emseg_("segment", source, "--out", tmp_path / "out")
    result = emseg_("view", tmp_path / "out" / "a")
    assert result.exit_code == 1
    assert "failed: no window can be opened here" in result.stderr
    assert f"`emseg render {tmp_path / 'out' / 'a'}` makes a video instead" in result.stderr
    assert "no such file" in emseg_("view", tmp_path / "none").stderr


def test_video_without_encoder_is_refused_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli.importlib.util, "find_spec", lambda name: None)
    result = emseg_("segment", recording(tmp_path / "a.npz"), "--out", tmp_path / "out", "--video")
    assert result.exit_code == 2
    assert "pip install 'emseg[viz]'" in result.output
    assert not (tmp_path / "out").exists()


def test_demo_segments_what_is_bundled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("imageio_ffmpeg")
    sources = {"one": recording(tmp_path / "one.npz"), "two": recording(tmp_path / "two.npz", seed=1)}
    monkeypatch.setattr("emseg.datasets.bundled", lambda: sources)
    result = emseg_("demo", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    for name in sources:
        assert f"  {tmp_path / 'out' / name / 'segmentation.mp4'}" in result.output
        assert f"  {tmp_path / 'out' / name / 'preview.png'}" in result.output


def test_atomic_folder_keeps_the_old_one_on_failure(tmp_path: Path) -> None:
    target = tmp_path / "a [1]"
    with writers.atomic_folder(target) as folder:
        (folder / "x").write_text("old")
    host = socket.gethostname()
    stale = tmp_path / f".{target.name}.tmp-999999999@{host}"
    stale.mkdir()
    elsewhere = tmp_path / f".{target.name}.tmp-999999999@not-{host}"  # where it may run still
    elsewhere.mkdir()

    def fail() -> None:
        with writers.atomic_folder(target) as folder:
            assert not stale.exists()
            (folder / "x").write_text("new")
            raise RuntimeError("failed halfway")

    with pytest.raises(RuntimeError, match="failed halfway"):
        fail()
    assert (target / "x").read_text() == "old"
    with writers.atomic_folder(target) as folder:
        (folder / "x").write_text("new")
    assert (target / "x").read_text() == "new"
    assert {path.name for path in tmp_path.iterdir()} == {target.name, elsewhere.name}
    writers.clear_leftovers(target)
    assert [path.name for path in tmp_path.iterdir()] == [target.name]


def test_events_of_no_window_are_noise(tmp_path: Path) -> None:
    from fake_segmenter import FakeSegmentation

    events = EventArray([0] * 6, [0] * 6, range(6), [1] * 6, width=4, height=4)
    with writers.ResultWriter(tmp_path) as writer:
        writer.add(FakeSegmentation(events[2:4], 2, 4))
        with pytest.raises(ValueError, match="window 1 begins with event 3, before 4"):
            writer.add(FakeSegmentation(events[3:5], 3, 5))
        writer.finish({}, events=6)
    result, _ = writers.load_result(tmp_path)
    assert result.labels.tolist() == [-1, -1, 1, 1, -1, -1]
    assert [window["start"] for window in result.models] == [2]
    assert writer.timings == {"graph": 0.25, "labels": 0.5}


def test_a_result_without_windows(tmp_path: Path) -> None:
    with writers.ResultWriter(tmp_path) as writer:
        writer.finish({}, events=0)
    result, _ = writers.load_result(tmp_path)
    assert (len(result.labels), len(result.start), len(result.tracks), result.models) == (0, 0, 0, [])
