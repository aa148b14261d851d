"""Where jobs are done: the same results from a Dask cluster that loses a worker, and from submitit."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_cli import contents, emseg_, recording, use

from emseg import batch, executors
from emseg.config import Config
from emseg.executors import DaskCluster, ExecutorError, LocalProcesses, Slurm, make_executor

HERE = Path(__file__).parent
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{HERE.parents[1] / 'python'}{os.pathsep}{HERE}"}


def wait_for(condition: Callable[[], object], seconds: float = 40) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def jobs_of(sources: list[Path], out: Path, segmenter: str) -> list[batch.Job]:
    return [
        batch.Job(source, out / source.stem, Config(), segmenter=f"fake_segmenter:{segmenter}")
        for source in sources
    ]


@contextlib.contextmanager
def started(*arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", *arguments], env=ENVIRONMENT, stdout=output, stderr=subprocess.STDOUT
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler's host and port, and two workers, each a process of its own, on loopback."""
    pytest.importorskip("distributed", reason="distributed (extra `cluster`) is not installed")
    file = tmp_path / "scheduler.json"
    common = ["--no-dashboard", "--scheduler-file", str(file), "--host", "127.0.0.1"]
    alone = ["--no-nanny", "--nworkers", "1", "--nthreads", "1", "--local-directory", str(tmp_path)]
    with contextlib.ExitStack() as stack:
        scheduler = ["distributed.cli.dask_scheduler", "--port", "0", *common]
        stack.enter_context(started(*scheduler, log=tmp_path / "scheduler.log"))
        wait_for(file.exists)
        workers = [
            stack.enter_context(
                started("distributed.cli.dask_worker", *alone, *common, log=tmp_path / f"worker{k}.log")
            )
            for k in range(2)
        ]
        address = json.loads(file.read_text())["address"].removeprefix("tcp://")
        yield address, workers


def test_a_dask_worker_is_killed_in_the_midst(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(HERE))
    use(monkeypatch, "SlowSegmenter")
    address, workers = cluster
    sources = [recording(tmp_path / f"{k}.npz", seed=k) for k in range(6)]
    out = tmp_path / "out"
    victim = workers[0]

    def kill() -> None:
        wait_for(lambda: list(out.glob("*/run.json")) and list(out.glob(f".*.tmp-{victim.pid}@*")))
        victim.kill()

    killer = threading.Thread(target=kill)
    killer.start()
    result = emseg_("segment", *sources, "--out", out, "--executor", f"dask://{address}")
    killer.join()
    assert result.exit_code == 0, result.output
    assert victim.wait() == -signal.SIGKILL
    # A result that was complete when its worker died is found done when the job is given to the other.
    lines = [line.split(": ")[:2] for line in result.output.splitlines()]
    assert {status for status, _ in lines} <= {"done", "skipped"}
    assert sorted(source for _, source in lines) == [str(source) for source in sources]
    assert sorted(path.name for path in out.iterdir()) == [source.stem for source in sources]

    use(monkeypatch, "FakeSegmenter")
    assert emseg_("segment", *sources, "--out", tmp_path / "serial").exit_code == 0
    for source in sources:
        assert contents(out / source.stem) == contents(tmp_path / "serial" / source.stem)


def test_no_dask_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="distributed (extra `cluster`) is not installed")
    monkeypatch.setattr(executors, "_CONNECT_S", 0.2)
    source = recording(tmp_path / "a.npz")
    result = emseg_("segment", source, "--out", tmp_path / "out", "--executor", "dask://127.0.0.1:9")
    assert result.exit_code == 1
    assert "failed: no Dask scheduler at tcp://127.0.0.1:9" in result.output
    assert not (tmp_path / "out").exists()


def test_submitit_does_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On its own local processes, which it hands jobs to as it does to Slurm."""
    submitit = pytest.importorskip("submitit", reason="submitit (extra `cluster`) is not installed")
    monkeypatch.setattr(submitit.Job, "_results_timeout_s", 1)  # how long it waits for those of a dead job
    monkeypatch.setenv("PYTHONPATH", ENVIRONMENT["PYTHONPATH"])
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setattr(executors, "_LARGEST_ARRAY", 2)
    sources = [recording(tmp_path / f"{k}.npz", n=600 + k, seed=k) for k in range(3)]
    slurm = Slurm(tmp_path / "logs", cluster="local", parameters={"timeout_min": 2})
    outcomes = list(slurm.run(jobs_of(sources, tmp_path / "out", "DyingSegmenter")))
    assert sorted((o.job.source.stem, o.status) for o in outcomes) == [
        ("0", "done"),
        ("1", "failed"),
        ("2", "done"),
    ]
    failed = next(outcome for outcome in outcomes if outcome.status == "failed")
    assert failed.message.startswith(f"{sources[1]}: lost by the cluster: ")
    assert "\n" not in failed.message
    serial = list(
        LocalProcesses().run(jobs_of([sources[0], sources[2]], tmp_path / "serial", "FakeSegmenter"))
    )
    assert [outcome.status for outcome in serial] == ["done", "done"]
    for name in ("0", "2"):
        assert contents(tmp_path / "out" / name) == contents(tmp_path / "serial" / name)


def test_a_killed_run_is_taken_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))
    use(monkeypatch, "SlowSegmenter")
    sources = [recording(tmp_path / f"{k}.npz", seed=k) for k in range(3)]
    out = tmp_path / "out"
    code = "from emseg import batch, cli; batch.SEGMENTER = 'fake_segmenter:SlowSegmenter'; cli.main()"
    command = [sys.executable, "-c", code, "segment", *map(str, sources), "--out", str(out)]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.DEVNULL) as process:
        wait_for(lambda: (out / "0" / "run.json").exists() and list(out.glob(".1.tmp-*")))
        process.kill()
    assert list(out.glob(".1.tmp-*"))
    again = emseg_("segment", *sources, "--out", out)
    assert again.exit_code == 0, again.output
    assert [line.partition(":")[0] for line in again.output.splitlines()] == ["skipped", "done", "done"]
    assert sorted(path.name for path in out.iterdir()) == ["0", "1", "2"]


def test_addresses_of_executors(tmp_path: Path) -> None:
    def made(where: str) -> executors.Executor:
        return make_executor(where, processes=3, folder=tmp_path)

    assert made("local") == LocalProcesses(3)
    assert made("dask://there:8786") == DaskCluster("tcp://there:8786")
    assert made("slurm") == Slurm(tmp_path / ".slurm", at_a_time=3)
    assert made("slurm://gpu?timeout_min=60&qos=low") == Slurm(
        tmp_path / ".slurm", partition="gpu", at_a_time=3, parameters={"timeout_min": 60, "qos": "low"}
    )
    for wrong in ("dask", "dask://", "pbs://a", ""):
        with pytest.raises(ValueError, match="expected local, dask://host:port"):
            made(wrong)
    source = recording(tmp_path / "a.npz")
    assert emseg_("segment", source, "--out", tmp_path / "out", "--executor", "pbs").exit_code == 2


def test_without_the_extra_it_says_which(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setitem(sys.modules, "submitit", None)
    for executor in (DaskCluster("tcp://there:8786"), Slurm(tmp_path)):
        with pytest.raises(ExecutorError, match=r"is not installed: pip install 'emseg\[cluster\]'"):
            list(executor.run([]))
