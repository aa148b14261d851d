"""Many recordings: each is read, segmented and written as one job, complete or not at all."""

from __future__ import annotations

import errno
import functools
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
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any, Final, Literal, NoReturn

import numpy as np

import emseg
from emseg.camera import Camera
from emseg.config import Config
from emseg.events import EventArray
from emseg.io import ReadError, find_reader, read
from emseg.render import label_picture, motion_picture, polarity_picture, side_by_side
from emseg.video import VideoError, VideoWriter, film
from emseg.writers import TRACK_DTYPE, SequenceResult, atomic_folder, load_result, save_result, write_png

__all__ = [
    "Job",
    "Outcome",
    "collect",
    "find_inputs",
    "name_inputs",
    "render_video",
    "run_job",
    "run_jobs",
    "source_commit",
]

_log = logging.getLogger(__name__)

VIDEO_NAME: Final = "segmentation.mp4"

SEGMENTER: str = "emseg.segmentation:Segmenter"
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
        camera: Calibration file of the camera, or None.
        video: Whether to write a video, "yes" or "no".
        existing: What to do about results of another recording or of other settings, "keep" or "replace".
        threads: Threads where the settings leave their number open; 0: all cores.
        segmenter: What segments, as module:name.
    """

    source: Path
    target: Path
    config: Config
    camera: Path | None = None
    video: Literal["yes", "no"] = "no"
    existing: Literal["keep", "replace"] = "keep"
    threads: int = 0
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
        level = logging.WARNING if "recognised as" in str(error) else logging.DEBUG
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
    table = np.array(windows, np.int64).reshape(-1, 3)
    result = SequenceResult(
        labels,
        start=table[:, 0].copy(),
        stop=table[:, 1].copy(),
        t_ref=table[:, 2].copy(),
        tracks=np.array(tracks, TRACK_DTYPE),
        models=models,
    )
    return result, best, dict(timings)


def run_job(job: Job, progress: Progress | None = None) -> Outcome:
    """Segment one recording, unless its results are there.  Whatever goes wrong is a failed outcome."""
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
    identity = {
        "input_sha256": _sha256(_existing(job.source)),
        "config_sha256": job.config.fingerprint(),
        "camera_sha256": None if job.camera is None else _sha256(job.camera),
    }
    if job.existing == "keep" and job.target.exists():
        _check_existing(job, identity)
        if job.video == "yes" and not (job.target / VIDEO_NAME).exists():
            render_video(job.target, job.source)
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
            _write_video(folder / VIDEO_NAME, events, result)
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
            "config": asdict(job.config),
            "seed": job.config.seed,
            "version": emseg.__version__,
            "commit": source_commit(),
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
        problem = f"{job.target} holds no complete result; --overwrite replaces it"
        raise _JobError(f"{job.source}: {problem}") from None
    if found["input_sha256"] != identity["input_sha256"]:
        problem = f"{job.target} holds another recording's result; --overwrite replaces it"
        raise _JobError(f"{job.source}: {problem}")
    if found != identity:
        problem = f"{job.target} holds a result of other settings; --overwrite replaces it"
        raise _JobError(f"{job.source}: {problem}")


def _segmenter(job: Job, events: EventArray) -> Any:
    module, _, name = job.segmenter.partition(":")
    factory = getattr(importlib.import_module(module), name)
    camera = None
    if job.camera is not None:
        try:
            camera = Camera.from_file(job.camera, width=events.width, height=events.height)
        except ValueError as error:
            raise _JobError(f"{job.source}: {error}") from None
    config = job.config
    if config.threads == 0:
        config = replace(config, threads=job.threads)
    return factory(width=events.width, height=events.height, camera=camera, config=config)


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


def render_video(folder: Path, source: Path | None = None) -> Path:
    """Make the video of a result folder (again).

    Args:
        folder: What :func:`run_job` wrote.
        source: The recording, if it is no longer where it was.

    Returns:
        The video's path.

    Raises:
        ValueError: naming the file that is missing, damaged or of another recording.
        VideoError: where it cannot be encoded.
    """
    result, run = load_result(folder)
    source = source or Path(run["input"]["path"])
    if _sha256(_existing(source)) != run["input_sha256"]:
        raise ReadError(source, f"is not the recording that {folder} is the result of")
    work = folder / f".{VIDEO_NAME}.tmp-{os.getpid()}.mp4"
    try:
        _write_video(work, read(source), result)
        return work.replace(folder / VIDEO_NAME)
    finally:
        work.unlink(missing_ok=True)


def _existing(source: Path) -> Path:
    find_reader(source)  # raises, naming the file, where there is none
    return source


def _write_video(path: Path, events: EventArray, result: SequenceResult) -> None:
    shown = film(events, result)
    with VideoWriter(path, frames_per_s=shown.frames_per_s) as writer:
        for frame in shown.frames:
            writer.write(frame)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def source_commit() -> str | None:
    """The commit of the source tree that this package is run from, if it is one; "+" marks changes."""
    folder = Path(__file__).parent

    def git(*arguments: str) -> str:
        command = ["git", "--no-optional-locks", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", Path(__file__).name)  # else it is only installed inside a tree
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
        progress: Called with a job and its events done and in all; not across processes.
    """
    if processes <= 1 or len(jobs) <= 1:
        for job in jobs:
            yield run_job(job, None if progress is None else functools.partial(progress, job))
        return
    threads = max(1, (os.cpu_count() or 1) // processes)
    unfinished = yield from _run_pool([replace(job, threads=threads) for job in jobs], processes)
    for job in unfinished:  # a process died, and the pool with it: find out whose, one by one
        if (yield from _run_pool([job], 1)):
            yield Outcome(job, "failed", f"{job.source}: its process died, perhaps for want of memory")


def _run_pool(jobs: Sequence[Job], processes: int) -> Generator[Outcome, None, list[Job]]:
    """Outcomes as they end; returns the jobs that were open when a process died."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        min(processes, len(jobs)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_prepare_worker,
    )
    unfinished: list[Job] = []
    futures: dict[Future[Outcome], Job] = {}
    try:
        for job in jobs:
            try:
                futures[pool.submit(run_job, job)] = job
            except BrokenProcessPool:
                unfinished.append(job)
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except BrokenProcessPool:
                unfinished.append(futures[future])
            else:
                yield outcome
    except BaseException:  # interrupted: the workers clear their half-written results and go
        pool.shutdown(wait=False, cancel_futures=True)
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown()
    return unfinished


def _prepare_worker() -> None:
    """Leave a worker's end to its parent: no interrupt from the keyboard, but SIGTERM clears up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, exit_on_signal)


def exit_on_signal(number: int, frame: FrameType | None) -> NoReturn:
    """Signal handler: end by an exception, so that half-written results are removed on the way."""
    raise SystemExit(128 + number)
