"""Writing results: the files of a segmented recording, complete or not at all."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import socket
import struct
import textwrap
import zipfile
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Literal, Self

import numpy as np
import numpy.typing as npt

from emseg.render import Picture

__all__ = [
    "TRACK_DTYPE",
    "ResultWriter",
    "SequenceResult",
    "atomic_folder",
    "clear_leftovers",
    "load_result",
    "write_png",
]

_BLOCK: Final = 1 << 20

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


class ResultWriter:
    """Writes a recording's segmentation into a folder window by window, in memory that hardly grows.

    Use as a context manager; what is there is complete after :meth:`finish`.

    Attributes:
        windows: Number of windows added.
        tracks: Their tracks.
        timings: The stages' times added up, s.
        thinned: Events that motions and labels were not found on, but extended to.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.windows = 0
        self.tracks: set[int] = set()
        self.timings: Counter[str] = Counter()
        self.thinned = 0
        self._written = 0  # labels
        self._bounds: dict[str, array[int]] = {name: array("q") for name in ("start", "stop", "t_ref")}
        with contextlib.ExitStack() as files:
            # An archive holds one array after the other, and the length of each before it.
            self._labels = files.enter_context((folder / "labels.column").open("wb"))
            self._models = files.enter_context((folder / "models.json").open("w", encoding="utf-8"))
            self._table = files.enter_context((folder / "tracks.csv").open("w", encoding="utf-8", newline=""))
            self._rows = csv.writer(self._table, lineterminator="\n")
            self._rows.writerow(TRACK_DTYPE.names or ())
            self._files = files.pop_all()

    def add(self, seg: Any) -> None:
        """Write the next window: a segmentation such as `Segmenter.run` gives."""
        start, stop, t_ref = int(seg.start), int(seg.stop), int(seg.t_ref)
        labels = np.asarray(seg.labels, np.int32)
        self._write_labels(labels, start)
        for name, value in zip(self._bounds, (start, stop, t_ref), strict=True):
            self._bounds[name].append(value)
        values, counts = np.unique(labels, return_counts=True)
        sizes = dict(zip(values.tolist(), counts.tolist(), strict=True))
        for box in seg.boxes:
            track = int(box["track"])
            place = (float(box[name]) for name in ("x", "y", "w", "h"))
            row = np.array((self.windows, t_ref, track, *place, sizes.get(track, 0)), TRACK_DTYPE).item()
            self._rows.writerow([round(v, 3) if isinstance(v, float) else v for v in row])
            self.tracks.add(track)
        window = {
            "window": self.windows,
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
        self._models.write(",\n" if self.windows else "[\n")
        self._models.write(textwrap.indent(json.dumps(window, indent=1, ensure_ascii=False), " "))
        self.timings.update({str(stage): float(seconds) for stage, seconds in seg.timings.items()})
        self.thinned += int(seg.thinned)
        self.windows += 1

    def _write_labels(self, labels: npt.NDArray[np.int32], start: int) -> None:
        """Labels of the events from `start` on; those passed over lie in no window."""
        if start < self._written:
            raise ValueError(f"window {self.windows} begins with event {start}, before {self._written}")
        for first in range(self._written, start, _BLOCK):
            np.full(min(_BLOCK, start - first), -1, "<i4").tofile(self._labels)
        labels.astype("<i4", copy=False).tofile(self._labels)
        self._written = start + len(labels)

    def finish(self, run: Mapping[str, Any], *, events: int) -> None:
        """Write what can only be written at the end.

        Args:
            run: What goes into run.json.
            events: Number of the recording's events.
        """
        self._write_labels(np.empty(0, np.int32), events)
        self._models.write("\n]\n" if self.windows else "[]\n")
        self.close()
        column = self._folder / "labels.column"
        with zipfile.ZipFile(self._folder / "labels.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, values in self._bounds.items():
                with archive.open(f"{name}.npy", "w") as member:
                    np.lib.format.write_array(member, np.array(values, "<i8"), allow_pickle=False)
            with archive.open("labels.npy", "w", force_zip64=True) as member, column.open("rb") as file:
                header = {"descr": "<i4", "fortran_order": False, "shape": (events,)}
                np.lib.format.write_array_header_1_0(member, header)
                shutil.copyfileobj(file, member, _BLOCK)
        column.unlink()
        _write_json(self._folder / "run.json", run)

    def close(self) -> None:
        """Close the files; they are complete only after :meth:`finish`."""
        self._files.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


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
    for stale in _leftovers(target, "dead"):
        shutil.rmtree(stale, ignore_errors=True)
    work = target.parent / f".{target.name}.tmp-{_this_process()}"
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
    old = target.parent / f".{target.name}.old-{_this_process()}"
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


def clear_leftovers(target: Path) -> None:
    """Remove what other processes, on any machine, have left of a target that is complete."""
    for path in _leftovers(target, "all"):
        shutil.rmtree(path, ignore_errors=True)


def _leftovers(target: Path, which: Literal["dead", "all"]) -> Iterator[Path]:
    """Work folders of `target`: all, or those of processes of this machine that have ended."""
    for kind in ("tmp", "old"):
        prefix = f".{target.name}.{kind}-"
        for path in target.parent.glob(f"{_escaped(prefix)}*"):
            process, _, host = path.name.removeprefix(prefix).partition("@")
            if not process.isdigit():
                continue
            if which == "all" or (host == socket.gethostname() and not _runs(int(process))):
                yield path


def _this_process() -> str:
    return f"{os.getpid()}@{socket.gethostname()}"


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
