"""Many recordings: each is read, segmented and written as one job, complete or not at all."""

from __future__ import annotations

import errno
import hashlib
import importlib
import json
import logging
import multiprocessing
import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

import emseg
from emseg.config import Config
from emseg.events import EventArray
from emseg.io import ReadError, find_reader, read
from emseg.render import label_picture, motion_picture, polarity_picture, side_by_side
from emseg.video import VideoError, VideoWriter, film
from emseg.writers import TRACK_DTYPE, SequenceResult, atomic_folder, save_result, write_png

__all__ = ["Job", "Outcome", "collect", "find_inputs", "name_inputs", "run_job", "run_jobs", "write_video"]

_log = logging.getLogger(__name__)

SEGMENTER: Final = "emseg.segmentation:Segmenter"
"""What segments, as module:name; imported in the process that runs the job."""

Progress = Callable[[int, int], None]
"""Called with the number of events done and of all events of the recording."""


@dataclass(frozen=True)
class Job:
    """One recording to segment.

    Attributes:
        source: The recording.
        target: The folder of its results.
        config: Settings.
        camera: Arguments of :class:`emseg.Camera`, or None.
        video: Whether to write a video, "yes" or "no".
        existing: What to do about results of another recording or of other settings, "keep" or "replace".
        segmenter: What segments, as module:name.
    """

    source: Path
    target: Path
    config: Config
    camera: Mapping[str, Any] | None = None
    video: Literal["yes", "no"] = "no"
    existing: Literal["keep", "replace"] = "keep"
    segmenter: str = SEGMENTER


@dataclass(frozen=True)
class Outcome:
    """What became of a job; `message` is one line."""

    job: Job
    status: Literal["done", "skipped", "failed"]
    message: str


class _JobError(Exception):
    """A job that cannot be done, for a reason that one line tells."""


def find_inputs(paths: Iterable[Path]) -> Iterator[Path]:
    """The given files, and the recordings in the given folders, in order.

    In folders, files that are no recordings are passed over, as are hidden ones and folders of results.
    """
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        for folder, folders, files in os.walk(path):
            if "run.json" in files and "labels.npz" in files:
                folders.clear()
                continue
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(files):
                if not name.startswith(".") and _is_recording(Path(folder, name)):
                    yield Path(folder, name)


def _is_recording(path: Path) -> bool:
    try:
        find_reader(path)
    except ReadError as error:
        level = logging.WARNING if "not supported yet" in str(error) else logging.DEBUG
        _log.log(level, "%s: passed over", error)
        return False
    return True


def name_inputs(sources: Sequence[Path]) -> list[str]:
    """A folder name for each input: its stem, with as much before or after as tells it from the others."""
    paths = list(dict.fromkeys(path.resolve() for path in sources))
    candidates: tuple[Callable[[Path], str], ...] = (
        lambda path: path.stem,
        lambda path: path.name.replace(".", "_"),
        lambda path: f"{path.parent.name}-{path.name.replace('.', '_')}",
        lambda path: f"{path.stem}-{hashlib.sha256(str(path).encode()).hexdigest()[:12]}",
    )
    names: dict[Path, str] = {}
    for candidate in candidates:
        open_paths = [path for path in paths if path not in names]
        counts = Counter([*names.values(), *(candidate(path) for path in open_paths)])
        names.update((path, candidate(path)) for path in open_paths if counts[candidate(path)] == 1)
    return [names[path.resolve()] for path in sources]


def collect(
    events: EventArray, segmentations: Iterable[Any], progress: Progress | None = None
) -> tuple[SequenceResult, Any, dict[str, float]]:
    """Gather successive segmentations of one recording.

    Args:
        events: The recording.
        segmentations: What `Segmenter.run` gives.
        progress: Called after every window.

    Returns:
        The result; the segmentation that has most moving events, or None where there is none; and the
        stages' times added up, s.
    """
    labels = np.full(len(events), -1, np.int32)
    windows: list[tuple[int, int, int]] = []
    tracks: list[Any] = []
    models: list[dict[str, Any]] = []
    timings: Counter[str] = Counter()
    best, most_moving = None, -1
    for index, seg in enumerate(segmentations):
        start, stop, t_ref = int(seg.start), int(seg.stop), int(seg.t_ref)
        labels[start:stop] = seg.labels
        windows.append((start, stop, t_ref))
        counts = Counter(np.asarray(seg.labels).tolist())
        for box in seg.boxes:
            track = int(box["track"])
            place = (float(box[name]) for name in ("x", "y", "w", "h"))
            tracks.append((index, t_ref, track, *place, counts[track]))
        models.append(
            {
                "window": index,
                "start": start,
                "stop": stop,
                "t_ref_us": t_ref,
                "energy": float(seg.energy),
                "models": [
                    {
                        "label": int(model.label),
                        "kind": str(model.kind),
                        "params": [float(value) for value in np.ravel(model.params)],
                    }
                    for model in seg.models
                ],
            }
        )
        timings.update({str(stage): float(seconds) for stage, seconds in seg.timings.items()})
        moving = sum(count for label, count in counts.items() if label > 0)
        if moving > most_moving:
            best, most_moving = seg, moving
        if progress is not None:
            progress(stop, len(events))
    start, stop, t_ref = np.array(windows, np.int64).reshape(-1, 3).T
    result = SequenceResult(
        labels, start.copy(), stop.copy(), t_ref.copy(), np.array(tracks, TRACK_DTYPE), models
    )
    return result, best, dict(timings)


def run_job(job: Job, progress: Progress | None = None) -> Outcome:
    """Segment one recording, unless its results are there already.  Never raises for what is wrong with it."""
    try:
        return _run(job, progress)
    except (ReadError, _JobError, VideoError) as error:
        return Outcome(job, "failed", str(error))
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return Outcome(job, "failed", f"{job.source}: no space left to write {job.target}")
        return Outcome(job, "failed", f"{job.source}: {error}")
    except MemoryError:
        return Outcome(job, "failed", f"{job.source}: not enough memory")
    except Exception as error:  # a defect of ours must not take the other recordings with it
        _log.debug("%s", job.source, exc_info=True)
        line = " ".join(str(error).split()) or "no message"
        return Outcome(job, "failed", f"{job.source}: {type(error).__name__}: {line}")


def _run(job: Job, progress: Progress | None) -> Outcome:
    began = time.perf_counter()
    find_reader(job.source)  # names what is wrong before the file is hashed
    identity = {
        "input_sha256": _sha256(job.source),
        "config_sha256": job.config.fingerprint(),
        "camera": dict(job.camera) if job.camera is not None else None,
    }
    if job.existing == "keep" and job.target.exists():
        _check_existing(job, identity)
        return Outcome(job, "skipped", f"{job.source}: already done: {job.target}")
    events = read(job.source)
    read_s = time.perf_counter() - began
    segmenter = _segmenter(job, events)
    result, best, stages = collect(events, segmenter.run(events), progress)
    segmented_s = time.perf_counter() - began - read_s
    with atomic_folder(job.target) as folder:
        if best is not None:
            _write_pictures(folder, events, best)
        if job.video == "yes":
            write_video(folder / "segmentation.mp4", events, result)
        run = {
            "input": {
                "name": job.source.name,
                "path": str(job.source.resolve()),
                "bytes": job.source.stat().st_size,
                "events": len(events),
                "width": events.width,
                "height": events.height,
            },
            **identity,
            "config": job.config.model_dump(),
            "seed": job.config.seed,
            "version": emseg.__version__,
            "commit": _commit(),
            "windows": len(result.start),
            "timings_s": {
                "read": round(read_s, 6),
                "segment": round(segmented_s, 6),
                "total": round(time.perf_counter() - began, 6),
                "stages": {stage: round(seconds, 6) for stage, seconds in sorted(stages.items())},
            },
        }
        save_result(folder, result, run)
    tracks = len(np.unique(result.tracks["track"]))
    return Outcome(
        job,
        "done",
        f"{job.source}: {len(events):,} events, {len(result.start)} windows, {tracks} tracks, "
        f"{time.perf_counter() - began:.1f} s: {job.target}",
    )


def _check_existing(job: Job, identity: Mapping[str, Any]) -> None:
    """Whether the target holds just these results; raises where it holds others."""
    try:
        run = json.loads((job.target / "run.json").read_text(encoding="utf-8"))
        found = {key: run[key] for key in identity}
    except (OSError, ValueError, KeyError, TypeError):
        raise _JobError(f"{job.source}: {job.target} holds no result of emseg; --overwrite replaces it") from None
    if found["input_sha256"] != identity["input_sha256"]:
        raise _JobError(f"{job.source}: {job.target} holds another recording's result; --overwrite replaces it")
    if found != identity:
        raise _JobError(f"{job.source}: {job.target} has other settings' result; --overwrite replaces it")
    if job.video == "yes" and not (job.target / "segmentation.mp4").exists():
        raise _JobError(f"{job.source}: {job.target} has no video; `emseg render {job.target}` makes it")


def _segmenter(job: Job, events: EventArray) -> Any:
    module, _, name = job.segmenter.partition(":")
    factory = getattr(importlib.import_module(module), name)
    camera = None
    if job.camera is not None:
        camera = importlib.import_module("emseg.camera").Camera(**job.camera)
        if (camera.width, camera.height) != (events.width, events.height):
            raise _JobError(
                f"{job.source}: is {events.width}x{events.height}, "
                f"expected the camera's {camera.width}x{camera.height}"
            )
    return factory(width=events.width, height=events.height, camera=camera, config=job.config)


def _write_pictures(folder: Path, events: EventArray, seg: Any) -> None:
    window = events[seg.start : seg.stop]
    caption = f"t = {(int(seg.t_ref) - int(events.t[0])) / 1e6:.3f} s   {len(window)} events"
    write_png(
        folder / "preview.png",
        side_by_side(
            polarity_picture(window, caption=caption),
            label_picture(window, seg.labels, boxes=seg.boxes, caption=f"{len(seg.boxes)} moving"),
        ),
    )
    write_png(folder / "motion.png", motion_picture(seg, caption=f"{caption}, each moved by its own motion"))


def write_video(path: Path, events: EventArray, result: SequenceResult) -> None:
    """Write the film of a segmented recording."""
    shown = film(events, result)
    with VideoWriter(path, frames_per_s=shown.frames_per_s) as writer:
        for frame in shown.frames:
            writer.write(frame)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _commit() -> str | None:
    """The commit of the source tree that this package is run from, if it is one; "+" marks changes."""
    folder = Path(__file__).parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)  # else it is merely installed inside some tree
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None


def run_jobs(
    jobs: Sequence[Job], *, processes: int, progress: Callable[[Job, int, int], None] | None = None
) -> Iterator[Outcome]:
    """Do all jobs, some at a time, and give their outcomes as they end; the results do not depend on it.

    Args:
        jobs: What to do.
        processes: How many to do at a time, each in a process of its own; 1: all in this one.
        progress: Called with a job and its events done and in all; with processes, only where a job ends.
    """
    if processes <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield run_job(job, _bound(progress, job) if progress is not None else None)
        return
    cores = os.cpu_count() or 1
    shared = [_share_cores(job, max(1, cores // processes)) for job in jobs]
    unfinished = yield from _run_pool(shared, processes)
    for job in unfinished:  # a process died, and the pool with it: find out whose, one by one
        if (yield from _run_pool([job], 1)):
            yield Outcome(job, "failed", f"{job.source}: its process died, perhaps for want of memory")


def _bound(progress: Callable[[Job, int, int], None], job: Job) -> Progress:
    return lambda done, of: progress(job, done, of)


def _share_cores(job: Job, threads: int) -> Job:
    if job.config.threads != 0:
        return job
    return replace(job, config=job.config.model_copy(update={"threads": threads}))


def _run_pool(jobs: Sequence[Job], processes: int) -> Iterator[Outcome]:
    raise NotImplementedError


def _run_pool_(jobs: Sequence[Job], processes: int) -> Any:
    raise NotImplementedError
