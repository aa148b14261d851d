"""Two commits beside each other: figures are told apart, and working trees do not outlive the comparison."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Stands for a benchmark: what it writes is in the commit.
BENCHMARK = """
import pathlib, shutil, sys
shutil.copy("figures.json", sys.argv[sys.argv.index("--json") + 1])
if pathlib.Path("fail").exists():
    sys.exit("no window is good enough")
"""


@pytest.fixture
def compare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The module, in a repository of its own whose commits need no build."""
    monkeypatch.syspath_prepend(str(ROOT))
    from bench import compare

    (tmp_path / "repository" / "bench").mkdir(parents=True)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(compare, "ROOT", tmp_path / "repository")
    monkeypatch.setattr(compare, "build", lambda tree, log: None)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (compare.ROOT / "bench" / "stages.py").write_text(BENCHMARK)
    git("init", "--quiet", cwd=compare.ROOT)
    return compare


def git(*arguments: str, cwd: Path) -> str:
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    done = subprocess.run(["git", *identity, *arguments], cwd=cwd, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def commit(root: Path, cold_cpu_s: float, accuracy: float) -> str:
    row = {"window": "w", "cold_cpu_s": cold_cpu_s, "accuracy": accuracy, "stages_wall_s": {"labels": 0.5}}
    (root / "figures.json").write_text(json.dumps({"commit": "x", "machine": {"cores": 2}, "windows": [row]}))
    git("add", "--all", cwd=root)
    git("commit", "--quiet", "-m", f"{cold_cpu_s}", cwd=root)
    return git("rev-parse", "HEAD", cwd=root)


def nothing_is_left(root: Path) -> bool:
    only_one = len(git("worktree", "list", cwd=root).splitlines()) == 1
    return only_one and not list((root.parent / "temporary").iterdir())


def test_a_pair_of_commits(compare: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slow, fast = commit(compare.ROOT, 3.0, 0.9), commit(compare.ROOT, 1.5, 0.95)
    written = tmp_path / "compared.json"
    compare.main([slow, "HEAD", "--rounds", "2", "--json", str(written), "--", "bench.stages"])
    compared = json.loads(written.read_text())
    assert (compared["a"], compared["b"]) == (slow, fast)
    assert [row["figure"] for row in compared["times"]] == ["w/cold_cpu_s", "w/stages_wall_s/labels"]
    assert compared["times"][0]["ratio"] == compared["times"][0]["least"] == 2.0
    (quality,) = compared["quality"]
    assert (quality["figure"], quality["a"], quality["b"]) == ("w/accuracy", 0.9, 0.95)
    assert "w/cold_cpu_s" in capsys.readouterr().out
    assert nothing_is_left(compare.ROOT)


def test_failures_are_named(compare: Any) -> None:
    head = commit(compare.ROOT, 1.0, 0.9)
    (compare.ROOT / "fail").touch()
    commit(compare.ROOT, 1.0, 0.8)
    with pytest.raises(SystemExit, match=r"bench\.stages .* in B failed: no window is good enough"):
        compare.main([head, "HEAD", "--rounds", "1", "--", "bench.stages"])
    assert nothing_is_left(compare.ROOT)
    with pytest.raises(SystemExit, match=r"git rev-parse .* nowhere"):
        compare.main([head, "nowhere"])
    with pytest.raises(SystemExit, match="2"):
        compare.main([head, head, "--", "bench.none"])


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit])
def test_an_interruption_leaves_nothing(
    compare: Any, monkeypatch: pytest.MonkeyPatch, interruption: type[BaseException]
) -> None:
    def interrupted(tree: Path, log: Path) -> None:
        assert (tree / "figures.json").exists()
        assert not nothing_is_left(compare.ROOT)
        raise interruption

    monkeypatch.setattr(compare, "build", interrupted)
    head = commit(compare.ROOT, 1.0, 0.9)
    with pytest.raises(interruption):
        compare.main([head, head])
    assert nothing_is_left(compare.ROOT)


def test_an_interrupted_step_ends_its_process(
    compare: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Also the processes that it started."""
    mark = tmp_path / "pid"
    script = f"sleep 60 & echo $! > {mark}; wait"

    waited_for = threading.Event()
    wait = subprocess.Popen.wait

    def told_wait(process: subprocess.Popen[bytes]) -> int:
        waited_for.set()
        return wait(process)

    def interrupt() -> None:
        waited_for.wait()
        while not mark.exists() or not mark.read_text().strip():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(subprocess.Popen, "wait", told_wait)
    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        compare.run(["sh", "-c", script], cwd=tmp_path, log=tmp_path / "log")
    grandchild = int(mark.read_text())
    for _ in range(500):
        try:
            os.kill(grandchild, 0)
        except ProcessLookupError:
            return
        stat = Path(f"/proc/{grandchild}/stat")
        if stat.exists() and stat.read_text().rpartition(")")[2].split()[0] == "Z":
            return  # ended, and nobody has asked how
        time.sleep(0.01)
    pytest.fail("the grandchild goes on")


def test_changing_answers_are_refused(compare: Any) -> None:
    rounds = [{"w/accuracy": 0.9, "w/cold_cpu_s": 1.0}, {"w/accuracy": 0.8, "w/cold_cpu_s": 2.0}]
    compare.check_answers("A", rounds[:1] * 2)
    with pytest.raises(AssertionError, match="A: w/accuracy differs between runs"):
        compare.check_answers("A", rounds)


def test_figures_are_found_by_what_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.figures import figures_of, is_quality, is_time

    kernel = {"what": "vote, 30 events: 164 Mev/s", "ours_ms": 2.0, "peer_ms": 9.0, "peer": "numba"}
    written = {
        "date": "today",
        "settings": {"sigma": 1.0},
        "events": 30,
        "rows": [kernel, {**kernel, "peer": "another", "peer_ms": 8.0}],
        "recordings": [
            {
                "recording": "hands",
                "seconds": 0.2,
                "runs": [{"threads": 2, "wall_s": 1.0, "latency_p95_s": 0.1, "windows_a_second": 3.0}],
                "warm": {"moving_iou_oracle": 0.9, "moving_iou_oracle_windows": 4, "object_iou": None},
            }
        ],
        "windows": [{"window": "w", "warm_cpu_s_one_thread": 1, "published": {"head": {"cpu_s": 9.0}}}],
    }
    figures = figures_of(written)
    assert {key for key in figures if is_time(key)} == {
        "vote, 30 events/ours_ms",
        "hands/runs/threads 2/wall_s",
        "hands/runs/threads 2/latency_p95_s",
        "w/warm_cpu_s_one_thread",
    }
    assert {key for key in figures if is_quality(key)} == {
        "hands/warm/moving_iou_oracle",
        "hands/warm/moving_iou_oracle_windows",
    }
