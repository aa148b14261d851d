"""EV-IMO and EVIMO2, in every layout in which they are given out.

- EV-IMO and EVIMO2 v1, `<sequence>.npz`: events (n, 4) of t (s), x, y, p; depth (mm) and mask (m, h, w);
  meta.
- EVIMO2 v2, a folder: dataset_events_t.npy, _xy.npy, _p.npy; dataset_depth.npz and dataset_mask.npz with
  depth_<id> and mask_<id>; dataset_info.npz with meta.
- text, a folder: events.txt of "t x y p"; img/depth_mask_<id>.png, 16 bit, with the mask in red and depth in
  green and blue; meta.txt, a Python literal.

Masks hold a thousand times the object's number, also of objects that stand still: those that move are told by
the poses in meta (see `emseg.datasets.poses`).  Frames come as often as the poses allow, unevenly.

Sources: https://better-flow.github.io/evimo/docs/ground-truth-format.html; the channel of the mask as SpikeMS
reads it (prgumd/SpikeMS, dataloader/base.py).
"""

from __future__ import annotations

import ast
import pickle
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.datasets.folders import FolderDataset, folders_with, named
from emseg.datasets.pictures import read_png
from emseg.datasets.poses import moving_objects
from emseg.datasets.truth import UNKNOWN, DatasetError, ImageTrack, LabelledRecording, Span, Truth
from emseg.events import EventArray
from emseg.io import read

__all__ = ["evimo", "evimo2"]

MASK_STEP: Final = 1000
GROUPS: Final = ("tabletop", "table", "box", "floor", "wall", "fast")
"""EV-IMO's kinds of scenes, as folders and names of its sequences have them."""

Meta = Mapping[str, Any]
Image = npt.NDArray[Any]
Images = Callable[[Mapping[str, Any]], Image]
"""Gives the image of an entry of meta's `frames`."""


def evimo(root: Path) -> FolderDataset:
    """EV-IMO below a folder."""
    return _open("evimo", root)


def evimo2(root: Path) -> FolderDataset:
    """EVIMO2, v1 or v2, below a folder."""
    return _open("evimo2", root)


def _open(name: str, root: Path) -> FolderDataset:
    archives = [path for path in root.rglob("*.npz") if _is_sequence(path)]
    folders = folders_with(root, "dataset_info.npz", "dataset_events_t.npy")
    texts = folders_with(root, "meta.txt", "events.txt")
    expected = "<sequence>.npz, or folders with dataset_info.npz, or with meta.txt and events.txt"
    return named(name, root, [*archives, *folders, *texts], expected, _load)


def _is_sequence(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return {"events.npy", "mask.npy", "meta.npy"} <= set(archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return False


def _load(path: Path, name: str, span: Span | None) -> LabelledRecording:
    if path.is_file():
        meta = _read_meta(path, "meta")
        events = read(path, span=span, width=_side(path, meta, "res_x"), height=_side(path, meta, "res_y"))
        frames = list(meta["frames"])
        mask, depth = _archive_images(path)
    elif (path / "dataset_info.npz").is_file():
        meta = _read_meta(path / "dataset_info.npz", "meta")
        events = _folder_events(path, meta, span)
        frames, mask, depth = _folder_images(path, meta)
    else:
        meta = _literal(path / "meta.txt")
        width, height = _side(path, meta, "res_x"), _side(path, meta, "res_y")
        text = path / "events.txt"
        events = read(text, span=span, columns="txyp", time_unit="s", width=width, height=height)
        frames = [frame for frame in meta["frames"] if (path / "img" / str(frame.get("gt_frame"))).is_file()]
        mask, depth = partial(_of_picture, path, 0), partial(_of_picture, path, 2)
    truth = _truth(frames, meta, mask, depth)
    return LabelledRecording(name, events, _group(name), _camera(meta), truth)


def _truth(frames: Sequence[Meta], meta: Meta, mask: Images, depth: Images) -> Truth:
    frames = sorted(frames, key=lambda frame: float(frame["ts"]))
    seconds = np.array([float(frame["ts"]) for frame in frames])
    moving = moving_objects(meta.get("full_trajectory") or frames, seconds)
    t = np.rint(1e6 * seconds).astype(np.int64)

    def masks(k: int) -> Image:
        return moving_mask(mask(frames[k]), moving[k])

    def depths(k: int) -> Image:
        return depth(frames[k]).astype(np.float32) / 1000

    return Truth(masks=ImageTrack(t, masks), depth=ImageTrack(t, depths), scene="moving")


def moving_mask(mask: Image, moving: Mapping[int, bool]) -> npt.NDArray[np.int32]:
    """The mask with the numbers of objects that move, 0 for those that stand, -1 where that is not known."""
    numbers = np.rint(mask / MASK_STEP).astype(np.int64)
    present, index = np.unique(numbers, return_inverse=True)
    of_number = [
        0 if number == 0 else UNKNOWN if number not in moving else number if moving[number] else 0
        for number in present.tolist()
    ]
    return np.array(of_number, dtype=np.int32)[index].reshape(mask.shape)


# --- files -------------------------------------------------------------------------------------------------


@lru_cache(maxsize=2)
def _stack(path: Path, what: str) -> Image:
    """All images of a sequence: in a compressed archive they cannot be had one by one."""
    with np.load(path, allow_pickle=False) as archive:
        return np.asarray(archive[what])


def _archive_images(path: Path) -> tuple[Images, Images]:
    return partial(_numbered, path, "mask"), partial(_numbered, path, "depth")


def _numbered(path: Path, what: str, frame: Meta) -> Image:
    images = _stack(path, what)
    number = int(frame["id"])
    if not number < len(images):
        raise DatasetError(f"{path}: {what} has {len(images)} images, expected number {number} of meta")
    return np.asarray(images[number])


def _folder_events(path: Path, meta: Meta, span: Span | None) -> EventArray:
    try:
        t, xy, p = (np.load(path / f"dataset_events_{name}.npy", mmap_mode="r") for name in ("t", "xy", "p"))
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path}: {error}, expected dataset_events_t, _xy and _p") from None
    t = t.reshape(-1)
    first, last = 0, len(t)
    if span is not None and len(t):
        first, last = np.searchsorted(t, float(t[0]) + np.array(span)).tolist()
    return EventArray(
        xy[first:last, 0],
        xy[first:last, 1],
        np.rint(1e6 * t[first:last]).astype(np.int64),
        p.reshape(-1)[first:last],
        width=_side(path, meta, "res_x"),
        height=_side(path, meta, "res_y"),
    )


def _folder_images(path: Path, meta: Meta) -> tuple[list[Meta], Images, Images]:
    """The frames with truth: the classical camera's go on where poses are lost."""
    archives = {what: np.load(path / f"dataset_{what}.npz", allow_pickle=False) for what in ("mask", "depth")}

    def image(what: str, frame: Meta) -> Image:
        return np.asarray(archives[what][f"{what}_{int(frame['id']):010d}"])

    with_truth = set(archives["mask"].files)
    frames = [frame for frame in meta["frames"] if f"mask_{int(frame['id']):010d}" in with_truth]
    return frames, partial(image, "mask"), partial(image, "depth")


def _of_picture(path: Path, channel: int, frame: Meta) -> Image:
    picture = read_png(path / "img" / str(frame["gt_frame"]))
    if picture.ndim != 3:
        raise DatasetError(f"{path}/img/{frame['gt_frame']}: grey, expected depth and mask as colours")
    return np.asarray(picture[..., channel])


def _literal(path: Path) -> Meta:
    try:
        text = path.read_text(encoding="utf-8")
        meta = ast.literal_eval(re.sub(r"\b(nan|inf)\b", "None", text))
    except (OSError, ValueError, SyntaxError, MemoryError, RecursionError) as error:
        raise DatasetError(f"{path}: {error}, expected a Python dictionary") from None
    return _checked(path, meta)


def _read_meta(path: Path, key: str) -> Meta:
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{key}.npy") as file:
            meta = _read_object(file)
    except (KeyError, zipfile.BadZipFile, OSError, ValueError, EOFError, pickle.UnpicklingError) as error:
        raise DatasetError(f"{path}: {key}: {error}, expected a pickled dictionary") from None
    return _checked(path, meta)


def _checked(path: Path, meta: Any) -> Meta:
    if not isinstance(meta, Mapping) or not {"frames", "meta"} <= set(meta):
        raise DatasetError(f"{path}: no meta of EV-IMO, expected a dictionary with 'frames' and 'meta'")
    return meta


def _read_object(file: IO[bytes]) -> Any:
    """The one object of an .npy, by an unpickler that makes nothing but plain data."""
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in read_header:
        raise ValueError(f"version {version} of .npy")
    _, _, dtype = read_header[version](file)
    if not dtype.hasobject:
        raise ValueError(f"array of {dtype}")
    loaded = _PlainUnpickler(file, encoding="latin1").load()
    return loaded.item() if isinstance(loaded, np.ndarray) and loaded.size == 1 else loaded


class _PlainUnpickler(pickle.Unpickler):
    """Makes arrays, numbers and containers, and nothing that could run code."""

    _ALLOWED: Final = {
        "_reconstruct": np.empty(0).__reduce__()[0],
        "scalar": np.float64().__reduce__()[0],
        "ndarray": np.ndarray,
        "dtype": np.dtype,
    }

    def find_class(self, module: str, name: str) -> Any:
        if module.partition(".")[0] == "numpy" and name in self._ALLOWED:
            return self._ALLOWED[name]
        raise pickle.UnpicklingError(f"{module}.{name} in it, which is not plain data")


# --- what meta says ----------------------------------------------------------------------------------------


def _side(path: Path, meta: Meta, key: str) -> int:
    side = meta["meta"].get(key)
    if not isinstance(side, int | float) or not 0 < side < 65536:
        raise DatasetError(f"{path}: {key} is {side!r}, expected the sensor's size in px")
    return int(side)


def _camera(meta: Meta) -> Camera | None:
    """The calibration, where it is complete and can be inverted on the whole sensor."""
    found = meta["meta"]
    names = ("k1", "k2", "k3", "k4") if found.get("dist_model") == "equidistant" else ("k1", "k2", "p1", "p2")
    try:
        return Camera(
            int(found["res_x"]),
            int(found["res_y"]),
            **{name: float(found[name]) for name in ("fx", "fy", "cx", "cy")},
            distortion=tuple(float(found[name]) for name in names),
            model="equidistant" if found.get("dist_model") == "equidistant" else "radtan",
        )
    except (KeyError, TypeError, ValueError):
        return None


def _group(name: str) -> str:
    parts = re.split(r"[/_\-]", name.lower())
    return next((group for group in GROUPS if group in parts), "")
