"""DSEC (Prophesee Gen3.1, 640x480): `<sequence>/events/left/events.h5`, and labels where there are some.

A sequence may lie in train/ or test/, or in a folder a kind (train_events/<sequence>/…), as its archives
unpack.  Labels are in the view of the left event camera, in one of three layouts:

- DSEC-MOS: `<sequence>/gt_mask/<frame>.png`, or `gt_mask/<sequence>/<frame>.png` as its authors' code reads
  them; what is above 0 moves, objects are not told apart.  Its makers show frames from 000001 on: where the
  last is as high as there are frames, they count from 1, else from 0 as DSEC does.  They say that these are
  the event camera's coordinates, not whether before or after rectification; before it is assumed.
- MOTS, pictures: `instances/<sequence>/*.png` of 16 bits, 1000 times the class plus the track, 10000 to be
  ignored.  Every labelled object is taken to move.
- MOTS, text: `instances_txt/<sequence>.txt` with lines "frame track class height width rle".

Frames are counted by the sequence's images/timestamps.txt (µs).

No download or description of DSEC-MOTS ("Out of the room", 3DV 2024) could be found; the layouts of the MOTS
challenge stand for it.

Sources: https://dsec.ifi.uzh.ch/data-format/; Zhou et al., "Event-free moving object segmentation from moving
ego vehicle", IROS 2024, and README and loader of https://github.com/ZZY-Zhou/DSEC-MOS; Voigtlaender et al.,
"MOTS: Multi-object tracking and segmentation", CVPR 2019, and https://www.vision.rwth-aachen.de/page/mots.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.datasets.folders import FolderDataset, named
from emseg.datasets.pictures import read_png
from emseg.datasets.truth import UNKNOWN, DatasetError, ImageTrack, LabelledRecording, Span, Truth
from emseg.io import read

__all__ = ["decode_rle", "dsec"]

WIDTH: Final = 640
HEIGHT: Final = 480
EVENTS: Final = "events/left/events.h5"
IGNORED: Final = 10_000
CLASS_STEP: Final = 1000

Mask = npt.NDArray[np.int32]


def dsec(root: Path) -> FolderDataset:
    """DSEC below a folder."""
    sequences = [path.parents[2] for path in root.rglob("events.h5") if path.as_posix().endswith(EVENTS)]

    def load(path: Path, name: str, span: Span | None) -> LabelledRecording:
        return _load(root, path, name, span)

    expected = f"<sequence>/{EVENTS}"
    return named("dsec", root, sequences, expected, load, naming=lambda path: path.name)


def _load(root: Path, path: Path, name: str, span: Span | None) -> LabelledRecording:
    events = read(path / EVENTS, span=span, width=WIDTH, height=HEIGHT)
    calibration = _beside(root, name, "cam_to_cam.yaml")
    camera = None
    if calibration is not None:
        camera = Camera.from_file(calibration, width=WIDTH, height=HEIGHT, name="cam0")
    return LabelledRecording(name, events, "", camera, Truth(masks=_masks(root, name)))


def _beside(root: Path, sequence: str, file: str) -> Path | None:
    """A file of the sequence, whichever archive it came in."""
    found = (path for path in sorted(root.rglob(file)) if sequence in path.relative_to(root).parts)
    return next(found, None)


def _masks(root: Path, sequence: str) -> ImageTrack | None:
    moving = sorted({*root.rglob(f"{sequence}/gt_mask/*.png"), *root.rglob(f"gt_mask/{sequence}/*.png")})
    pictures = sorted(path for path in root.rglob(f"instances/{sequence}/*.png"))
    text = next(iter(sorted(root.rglob(f"instances_txt/{sequence}.txt"))), None)
    if not moving and not pictures and text is None:
        return None
    times = _beside(root, sequence, "timestamps.txt")
    if times is None:
        raise DatasetError(f"{root}: no timestamps.txt of {sequence}, expected it for its labels")
    t = np.loadtxt(times, dtype=np.int64, ndmin=1)
    if moving:
        numbers = [_number(path) for path in moving]
        if numbers[-1] == len(t) and numbers[0] > 0:
            numbers = [number - 1 for number in numbers]
        _check(numbers, t, times)
        return ImageTrack(t[numbers], lambda k: _moving(_sized(moving[k])))
    if pictures:
        numbers = [_number(path) for path in pictures]
        _check(numbers, t, times)
        return ImageTrack(t[numbers], lambda k: _tracks(_sized(pictures[k])))
    assert text is not None
    frames = _read_text(text)
    numbers = sorted(frames)
    _check(numbers, t, times)
    return ImageTrack(t[numbers], lambda k: _paint(frames[numbers[k]], text))


def _number(path: Path) -> int:
    digits = re.findall(r"\d+", path.stem)
    if not digits:
        raise DatasetError(f"{path}: expected the frame's number as its name")
    return int(digits[-1])


def _check(numbers: list[int], t: npt.NDArray[np.int64], times: Path) -> None:
    if numbers and numbers[-1] >= len(t):
        raise DatasetError(f"{times}: {len(t)} times, expected one for frame {numbers[-1]} of the labels")


def _sized(path: Path) -> npt.NDArray[Any]:
    picture = read_png(path)
    if picture.shape[:2] != (HEIGHT, WIDTH):
        size = f"({HEIGHT}, {WIDTH})"
        raise DatasetError(f"{path}: shape {picture.shape[:2]}, expected the event camera's {size}")
    return picture


def _moving(picture: npt.NDArray[Any]) -> Mask:
    """1 where something moves, of a picture in grey or in colour."""
    moving: npt.NDArray[np.bool_] = np.any(picture.reshape(HEIGHT, WIDTH, -1) > 0, axis=2)
    return moving.astype(np.int32)


def _tracks(picture: npt.NDArray[np.uint16]) -> Mask:
    """Tracks from 1 up of a picture of labels; -1 where they say that it is to be ignored."""
    # The track alone recurs in other classes: the label as a whole tells objects apart.
    return np.where(picture == IGNORED, UNKNOWN, picture).astype(np.int32)


def _read_text(path: Path) -> dict[int, list[tuple[int, int, int, str]]]:
    """By frame: label (1000 times the class plus the track), height, width, code."""
    frames: dict[int, list[tuple[int, int, int, str]]] = {}
    for number, line in enumerate(path.read_text(encoding="ascii").splitlines(), 1):
        cells = line.split()
        if len(cells) != 6 or not all(cell.isdigit() for cell in cells[:5]):
            problem = "expected: frame track class height width rle"
            raise DatasetError(f"{path}, line {number}: {line[:60]!r}, {problem}")
        frame, track, kind, height, width = (int(cell) for cell in cells[:5])
        label = IGNORED if track == IGNORED else CLASS_STEP * kind + track % CLASS_STEP
        frames.setdefault(frame, []).append((label, height, width, cells[5]))
    return frames


def _paint(objects: list[tuple[int, int, int, str]], path: Path) -> Mask:
    mask = np.zeros((HEIGHT, WIDTH), np.int32)
    for label, height, width, code in objects:
        if (height, width) != (HEIGHT, WIDTH):
            raise DatasetError(f"{path}: {height}x{width}, expected the event camera's {HEIGHT}x{WIDTH}")
        mask[decode_rle(code, height, width)] = UNKNOWN if label == IGNORED else label
    return mask


def decode_rle(code: str, height: int, width: int) -> npt.NDArray[np.bool_]:
    """A mask from COCO's compressed run lengths: column by column, the first run off.

    Each number is written in groups of five bits, least first, each plus 48 as a letter; the sixth bit says
    that more follow, the fifth of the last is the sign; from the fourth number on they are differences to the
    last but one.

    Raises:
        ValueError: the runs do not fill the mask.
    """
    runs: list[int] = []
    at = 0
    while at < len(code):
        value, shift, more = 0, 0, 1
        while more:
            group = ord(code[at]) - 48
            value |= (group & 31) << shift
            more, at, shift = group & 32, at + 1, shift + 5
            if not more and group & 16:
                value -= 1 << shift
            if more and at == len(code):
                raise ValueError(f"run lengths {code[:30]!r} end in the midst of a number")
        runs.append(value + runs[-2] if len(runs) > 2 else value)
    if sum(runs) != height * width or min(runs, default=0) < 0:
        raise ValueError(f"run lengths of {sum(runs)} pixels, expected {height * width}")
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    return flat.reshape(width, height).T
