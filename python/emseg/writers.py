"""Writing results: the files of a segmented recording, complete or not at all."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.render import Picture

__all__ = ["TRACK_DTYPE", "SequenceResult", "atomic_folder", "load_result", "save_result", "write_png"]

TRACK_DTYPE: Final = np.dtype(
    [
        ("window", "i8"),
        ("t_us", "i8"),
        ("track", "i4"),
        ("x", "f4"),
        ("y", "f4"),
        ("w", "f4"),
        ("h", "f4"),
        ("events", "i8"),
    ]
)
"""A track in one window: reference time µs, box px (left upper corner and size), and its number of events."""


@dataclass(frozen=True)
class SequenceResult:
    """A recording's segmentation, window by window.

    Attributes:
        labels: Label of every event of the recording, int32 (n,): 0 background, 1.. tracks, -1 noise, and -1
            where an event lies in no window.
        start: First event of each window, int64 (m,).
        stop: One past the last event of each window, int64 (m,).
        t_ref: Time that each window's events are warped to, µs, int64 (m,).
        tracks: Structured array of :data:`TRACK_DTYPE`.
        models: For every window a mapping that JSON can hold: its interval, energy and motion models.
    """

    labels: npt.NDArray[np.int32]
    start: npt.NDArray[np.int64]
    stop: npt.NDArray[np.int64]
    t_ref: npt.NDArray[np.int64]
    tracks: npt.NDArray[Any]
    models: list[dict[str, Any]]


def save_result(folder: Path, result: SequenceResult, run: Mapping[str, Any]) -> None:
    """Write labels.npz, models.json, tracks.csv and run.json into an existing folder."""
    np.savez_compressed(
        folder / "labels.npz",
        start=result.start,
        stop=result.stop,
        t_ref=result.t_ref,
        labels=result.labels,
    )
    _write_json(folder / "models.json", result.models)
    with (folder / "tracks.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(TRACK_DTYPE.names or ())
        for row in result.tracks:
            writer.writerow([round(v, 3) if isinstance(v, float) else v for v in row.item()])
    _write_json(folder / "run.json", run)


def load_result(folder: str | PathLike[str]) -> tuple[SequenceResult, dict[str, Any]]:
    """A result folder's segmentation and its run.json.

    Raises:
        ValueError: naming the file that is missing or damaged.
    """
    folder = Path(folder)
    file = folder
    try:
        file = folder / "run.json"
        run: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        file = folder / "models.json"
        models: list[dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))
        file = folder / "labels.npz"
        with np.load(file, allow_pickle=False) as arrays:
            columns = {name: arrays[name] for name in ("labels", "start", "stop", "t_ref")}
        file = folder / "tracks.csv"
        with file.open(encoding="utf-8", newline="") as opened:
            rows = list(csv.reader(opened))
        if tuple(rows[0]) != TRACK_DTYPE.names:
            raise ValueError(f"its columns are {rows[0]}")
        tracks = np.array([tuple(row) for row in rows[1:]], dtype=TRACK_DTYPE)
    except FileNotFoundError:
        raise ValueError(f"{file}: no such file, expected a folder that `emseg segment` wrote") from None
    except Exception as error:  # whatever damage does to JSON, zip and CSV
        raise ValueError(f"{file}: damaged, expected as `emseg segment` wrote it: {error}") from None
    return SequenceResult(**columns, tracks=tracks, models=models), run


def write_png(path: str | PathLike[str], picture: Picture) -> None:
    """Write an RGB picture (h, w, 3) as PNG (ISO/IEC 15948), each row after the filter "up"."""
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or not picture.size:
        found = f"shape {picture.shape} and dtype {picture.dtype}"
        raise ValueError(f"picture has {found}, expected uint8 (h, w, 3)")
    height, width = picture.shape[:2]
    rows = picture.reshape(height, width * 3)
    filtered = np.empty((height, 1 + width * 3), np.uint8)
    filtered[:, 0] = 2
    filtered[0, 1:] = rows[0]
    filtered[1:, 1:] = rows[1:] - rows[:-1]  # modulo 256, as the format has it
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b""))
    with Path(path).open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, content in chunks:
            file.write(struct.pack(">I", len(content)) + kind + content)
            file.write(struct.pack(">I", zlib.crc32(kind + content)))


@contextlib.contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """A folder to write into that becomes `target`, replacing it, when the block ends well.

    Until then it lies beside the target under a hidden name; if the block fails or is interrupted it is
    removed and the target stays as it was.  What a killed process has left of the same target is cleared.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    for stale in _leftovers(target):
        shutil.rmtree(stale, ignore_errors=True)
    work = target.parent / f".{target.name}.tmp-{os.getpid()}"
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir()
    try:
        yield work
        for path in work.rglob("*"):
            _synchronise(path)
        _synchronise(work)
        _replace(work, target)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _replace(work: Path, target: Path) -> None:
    old = target.parent / f".{target.name}.old-{os.getpid()}"
    if target.exists():
        target.rename(old)
    try:
        work.rename(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise
    _synchronise(target.parent)
    shutil.rmtree(old, ignore_errors=True)


def _leftovers(target: Path) -> Iterator[Path]:
    """Work folders of `target` whose process has ended."""
    for kind in ("tmp", "old"):
        prefix = f".{target.name}.{kind}-"
        for path in target.parent.glob(f"{_escaped(prefix)}*"):
            process = path.name.removeprefix(prefix)
            if process.isdigit() and not _runs(int(process)):
                yield path


def _escaped(name: str) -> str:
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it runs, but is another user's
        return True
    return True


def _synchronise(path: Path) -> None:
    """Have the system put a file or folder to disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
