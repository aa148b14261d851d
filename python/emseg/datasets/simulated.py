"""Recordings that `emseg simulate` wrote: docs/simulation.md says what is in them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from emseg.camera import Camera
from emseg.datasets.folders import FolderDataset, named
from emseg.datasets.truth import FlowTrack, ImageTrack, LabelledRecording, Span, Truth
from emseg.events import EventArray

__all__ = ["simulated"]


def simulated(root: Path) -> FolderDataset:
    """Simulated recordings below a folder."""
    files = [path for path in root.rglob("*.npz") if _has_labels(path)]
    return named("sim", root, files, "recordings (.npz) with label, as emseg simulate writes them", _load)


def _has_labels(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return {f"{name}.npy" for name in ("x", "y", "t", "p", "label")} <= set(archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return False


def _load(path: Path, name: str, span: Span | None) -> LabelledRecording:
    with np.load(path, allow_pickle=False) as archive:
        arrays: dict[str, Any] = {key: archive[key] for key in archive.files}
    width, height = int(arrays["width"]), int(arrays["height"])
    t = arrays["t"]
    part = slice(None)
    if span is not None and len(t):
        part = slice(*np.searchsorted(t, t[0] + np.rint(1e6 * np.array(span)).astype(np.int64)).tolist())
    events = EventArray(*(arrays[column][part] for column in "xytp"), width=width, height=height)
    labels = arrays["label"][part].astype(np.int64)
    truth = Truth(
        labels=labels,
        masks=_images(arrays, "gt_mask"),
        flow=_flow(arrays),
        depth=_images(arrays, "gt_depth"),
        scene="moving" if (labels > 0).any() else "still",
    )
    return LabelledRecording(name, events, _scene_name(path), _camera(arrays, width, height), truth)


def _scene_name(path: Path) -> str:
    """The scene's name: that of a recording of the suite ends in its seed."""
    stem, _, seed = path.stem.rpartition("_")
    return stem if seed.isdigit() and stem else path.stem


def _images(arrays: dict[str, Any], key: str) -> ImageTrack | None:
    if key not in arrays or "gt_t" not in arrays:
        return None
    images: npt.NDArray[Any] = arrays[key]
    return ImageTrack(arrays["gt_t"].astype(np.int64), lambda k: np.asarray(images[k]))


def _flow(arrays: dict[str, Any]) -> FlowTrack | None:
    if "gt_flow" not in arrays:
        return None
    t, flow = arrays["gt_t"].astype(np.int64), arrays["gt_flow"]
    return FlowTrack(t[:-1], t[1:], lambda k: np.moveaxis(flow[k].astype(np.float64), 0, -1))


def _camera(arrays: dict[str, Any], width: int, height: int) -> Camera | None:
    if "K" not in arrays:
        return None
    K = arrays["K"]
    distortion = tuple(float(value) for value in arrays.get("D", ()))
    return Camera(width, height, fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2], distortion=distortion)
