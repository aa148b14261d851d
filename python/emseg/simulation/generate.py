"""Making the recordings of the suite: resumable, a process each, listed in a manifest."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

import emseg
from emseg.executors import exit_on_signal
from emseg.simulation.files import write_npz
from emseg.simulation.simulator import simulate
from emseg.simulation.suite import DURATION, NAMES, split_of, suite_scene

__all__ = ["MANIFEST", "Outcome", "SuiteJob", "generate", "suite_jobs", "write_manifest"]

MANIFEST: Final = "manifest.json"


@dataclass(frozen=True)
class SuiteJob:
    """One recording of the suite, to be written into a folder."""

    folder: Path
    name: str
    seed: int
    duration: float = DURATION
    threads: int = 0

    @property
    def target(self) -> Path:
        """Where it goes: folder/split/name_seed.npz."""
        return self.folder / split_of(self.seed) / f"{self.name}_{self.seed:05d}.npz"


@dataclass(frozen=True)
class Outcome:
    """What became of a job; `message` is one line."""

    job: SuiteJob
    status: Literal["done", "skipped", "failed"]
    message: str


def suite_jobs(
    folder: Path, seeds: range, *, names: Sequence[str] = NAMES, duration: float = DURATION
) -> list[SuiteJob]:
    """The jobs of all scenes (or some) for a range of seeds.

    Raises:
        ValueError: for an unknown name or a seed of no split.
    """
    for name in names:
        if name not in NAMES:
            raise ValueError(f"unknown scene '{name}', expected one of {', '.join(NAMES)}")
    for seed in seeds:
        split_of(seed)
    return [SuiteJob(folder, name, seed, duration) for seed in seeds for name in names]


def generate(jobs: Sequence[SuiteJob], *, processes: int = 1) -> Iterator[Outcome]:
    """Do all jobs, some at a time; a recording that is there already is not made again.

    The files do not depend on the number of processes.

    Args:
        jobs: What to do.
        processes: How many at a time, each in a process of its own; 1: all in this one, with all cores.
    """
    if processes <= 1 or len(jobs) <= 1:
        yield from map(_run, jobs)
        return
    pool = ProcessPoolExecutor(
        min(processes, len(jobs)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_prepare_worker,
    )
    threads = max(1, (os.cpu_count() or 1) // processes)
    others = set(multiprocessing.active_children())
    try:
        futures = {
            pool.submit(_run, SuiteJob(job.folder, job.name, job.seed, job.duration, threads)): job
            for job in jobs
        }
        for future in as_completed(futures):
            try:
                yield future.result()
            except Exception as error:  # the process died
                yield Outcome(
                    futures[future], "failed", f"{futures[future].target}: its process died: {error}"
                )
    except BaseException:  # interrupted: workers clear what they have begun, and go
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown()


def _prepare_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, exit_on_signal)


def _run(job: SuiteJob) -> Outcome:
    try:
        scene = suite_scene(job.name, job.seed, duration=job.duration)
        if _is_done(job.target, scene.to_yaml()):
            return Outcome(job, "skipped", f"{job.target}: already there")
        simulation = simulate(scene, threads=job.threads)
        write_npz(job.target, simulation)
    except (ValueError, OSError, MemoryError) as error:
        line = " ".join(str(error).split()) or type(error).__name__
        return Outcome(job, "failed", f"{job.target}: {line}")
    return Outcome(job, "done", f"{job.target}: {len(simulation.events):,} events")


def _is_done(target: Path, scene: str) -> bool:
    """Whether the target is this very scene, by this version."""
    try:
        with np.load(target, allow_pickle=False) as arrays:
            return str(arrays["scene"]) == scene and str(arrays["version"]) == emseg.__version__
    except (OSError, KeyError, ValueError, EOFError):
        return False
    except Exception:  # whatever a damaged archive makes of its decoders
        return False


def write_manifest(jobs: Sequence[SuiteJob]) -> Path:
    """List the recordings of these jobs, and those listed before, in the folder's manifest.json.

    Returns:
        The manifest's path.
    """
    folder = jobs[0].folder
    path = folder / MANIFEST
    entries: dict[str, Any] = {}
    if path.exists():
        listed = json.loads(path.read_text(encoding="utf-8"))["recordings"]
        entries = {entry["file"]: entry for entry in listed if (folder / entry["file"]).exists()}
    for job in jobs:
        if job.target.exists():
            entry = _entry(job)
            entries[entry["file"]] = entry
    content = {"version": emseg.__version__, "recordings": [entries[name] for name in sorted(entries)]}
    work = path.with_name(f".{MANIFEST}.tmp-{os.getpid()}")
    work.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    work.replace(path)
    return path


def _entry(job: SuiteJob) -> dict[str, Any]:
    with np.load(job.target, allow_pickle=False) as arrays:
        labels, counts = np.unique(arrays["label"], return_counts=True)
        width, height = int(arrays["width"]), int(arrays["height"])
    return {
        "file": job.target.relative_to(job.folder).as_posix(),
        "scene": job.name,
        "seed": job.seed,
        "split": split_of(job.seed),
        "duration": job.duration,
        "width": width,
        "height": height,
        "events": int(counts.sum()),
        "events_by_label": {str(k): int(n) for k, n in zip(labels, counts, strict=True)},
        "sha256": hashlib.sha256(job.target.read_bytes()).hexdigest(),
    }
