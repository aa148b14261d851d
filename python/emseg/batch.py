"""Many recordings: each is read, segmented and written as one job, complete or not at all."""

from __future__ import annotations

import errno
import hashlib
import importlib
import json
import logging
import os
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

import emseg
from emseg.camera import Camera
from emseg.config import Config
from emseg.events import EventArray
from emseg.io import ReadError, find_reader
from emseg.reading import OpenPart, Reading
from emseg.render import label_picture, motion_picture, polarity_picture, side_by_side
from emseg.video import VideoError, VideoWriter, film
from emseg.writers import ResultWriter, SequenceResult, atomic_folder, load_result, write_png

__all__ = [
    "Job",
    "Outcome",
    "find_inputs",
    "name_inputs",
    "read_result",
    "render_video",
    "run_job",
    "source_commit",
]

_log = logging.getLogger(__name__)

VIDEO_NAME: Final = "segmentation.mp4"

SEGMENTER: str = "emseg.segmentation:Segmenter"
"""What segments, as module:name; imported in the process that runs the job."""

Progress = Callable[[int], None]
"""Called with the number of events done."""


@dataclass(frozen=True)
class Job:
    """One recording to segment.

    Attributes:
        source: The recording.
        target: The folder of its results.
        config: Settings.
        reading: What of it is read, and how.
        camera: Calibration file of the camera, or None.
        video: Whether to write a video, "yes" or "no".
        existing: What to do about results of another recording or of other settings, "keep" or "replace".
        threads: Threads where the settings leave their number open; 0: all cores.
        segmenter: What segments, as module:name.
    """

    source: Path
    target: Path
    config: Config
    reading: Reading = field(default_factory=Reading)
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
        "reading": job.reading.to_json(),
    }
    if job.existing == "keep" and job.target.exists():
        _check_existing(job, identity)
        if job.video == "yes" and not (job.target / VIDEO_NAME).exists():
            render_video(job.target, job.source)
        return Outcome(job, "skipped", f"{job.source}: already done: {job.target}")
    with job.reading.open(job.source) as part, atomic_folder(job.target) as folder:
        events = _Counted(part.chunks)
        with ResultWriter(folder) as writer:
            best = _segment(_segmenter(job, part), events, writer, progress)
            segmented_s = time.perf_counter() - began - events.seconds
            run = {
                "input": {
                    "name": job.source.name,
                    "path": str(job.source.resolve()),
                    "bytes": job.source.stat().st_size,
                    "events": events.count,
                    "width": part.size[0],
                    "height": part.size[1],
                },
                **identity,
                "config": asdict(job.config),
                "seed": job.config.seed,
                "version": emseg.__version__,
                "commit": source_commit(),
                "windows": writer.windows,
                "thinned": writer.thinned,
                "timings_s": {
                    "read": round(events.seconds, 6),
                    "segment": round(segmented_s, 6),
                    "total": round(time.perf_counter() - began, 6),
                    "stages": {stage: round(s, 6) for stage, s in sorted(writer.timings.items())},
                },
            }
            writer.finish(run, events=events.count)
        if best is not None:
            _write_pictures(folder, best, events.origin)
        if job.video == "yes":
            _write_video(folder / VIDEO_NAME, job.reading.read(job.source), load_result(folder)[0])
    thinned = f" ({writer.thinned / events.count:.0%} thinned)" if writer.thinned else ""
    return Outcome(
        job,
        "done",
        f"{job.source}: {events.count:,} events{thinned}, {writer.windows} windows, "
        f"{len(writer.tracks)} tracks, {time.perf_counter() - began:.1f} s: {job.target}",
    )


class _Counted:
    """Chunks of events that pass by: how many, from when on, and the time that reading them took, s."""

    def __init__(self, chunks: Iterable[EventArray]) -> None:
        self._chunks = iter(chunks)
        self.count, self.origin, self.seconds = 0, 0, 0.0

    def __iter__(self) -> Iterator[EventArray]:
        while True:
            began = time.perf_counter()
            chunk = next(self._chunks, None)
            self.seconds += time.perf_counter() - began
            if chunk is None:
                return
            if not self.count and len(chunk):
                self.origin = int(chunk.t[0])
            self.count += len(chunk)
            yield chunk


def _segment(segmenter: Any, events: _Counted, writer: ResultWriter, progress: Progress | None) -> Any:
    """Write all windows; gives the one that has most moving events, or None where there is none."""
    best, most_moving = None, -1
    for seg in segmenter.run(events):
        writer.add(seg)
        moving = int(np.count_nonzero(np.asarray(seg.labels) > 0))
        if moving > most_moving:
            best, most_moving = seg, moving
        if progress is not None:
            progress(int(seg.stop))
    return best


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


def _segmenter(job: Job, part: OpenPart) -> Any:
    module, _, name = job.segmenter.partition(":")
    factory = getattr(importlib.import_module(module), name)
    config = job.config
    if config.threads == 0:
        config = replace(config, threads=job.threads)
    return factory(width=part.size[0], height=part.size[1], camera=_camera(job, part), config=config)


def _camera(job: Job, part: OpenPart) -> Camera | None:
    if job.camera is None:
        return None
    width, height = part.sensor
    try:
        camera = Camera.from_file(job.camera, width=width, height=height)
        crop = job.reading.crop
        if crop is None:
            return camera
        cx, cy = camera.cx - crop.x, camera.cy - crop.y
        return replace(camera, width=crop.width, height=crop.height, cx=cx, cy=cy)
    except ValueError as error:
        raise _JobError(f"{job.source}: {error}") from None


def _write_pictures(folder: Path, seg: Any, origin: int) -> None:
    window = seg.events
    caption = f"t = {(int(seg.t_ref) - origin) / 1e6:.3f} s   {len(window)} events"
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
    events, result = read_result(folder, source)
    work = folder / f".{VIDEO_NAME}.tmp-{os.getpid()}.mp4"
    try:
        _write_video(work, events, result)
        return work.replace(folder / VIDEO_NAME)
    finally:
        work.unlink(missing_ok=True)


def read_result(folder: Path, source: Path | None = None) -> tuple[EventArray, SequenceResult]:
    """A result folder's segmentation, and the events that it is of.

    Args:
        folder: What :func:`run_job` wrote.
        source: The recording, if it is no longer where it was.

    Raises:
        ValueError: naming the file that is missing, damaged or of another recording.
    """
    result, run = load_result(folder)
    try:
        source = source or Path(run["input"]["path"])
        expected = run["input_sha256"]
        reading = Reading.from_json(run["reading"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{folder / 'run.json'}: damaged, or of another version: {error!r}") from None
    if _sha256(_existing(source)) != expected:
        raise ReadError(source, f"is not the recording that {folder} is the result of")
    return reading.read(source), result


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
