"""MVSEC (DAVIS346): `<name>_data.hdf5`, with `<name>_gt.hdf5` or `<name>_gt_flow_dist.npz` beside it.

davis/left/events of the data is (n, 4): x, y, t (s), p (-1 or 1).  Of the truth, davis/left/flow_dist is
(m, 2, h, w) in px of the sensor, from flow_dist_ts to the next of them, 0 where there is none; in the .npz
x_flow_dist, y_flow_dist and timestamps are the same.  davis/left/depth_image_raw is (m, h, w), m, NaN where
unknown.  Indoors nothing but the camera moves; outdoors cars and people do, of which there is no truth.

Sources: https://daniilidis-group.github.io/mvsec/ (daniilidis-group/mvsec, website/content/download); keys as
the loaders of EV-FlowNet and its successors read them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from emseg.datasets.folders import FolderDataset, named
from emseg.datasets.truth import FlowTrack, ImageTrack, LabelledRecording, Span, Truth
from emseg.io import read
from emseg.io.extras import require

__all__ = ["mvsec"]

STREAM: Final = "davis/left/events"
WIDTH: Final = 346
HEIGHT: Final = 260
SUFFIX: Final = "_data.hdf5"


def mvsec(root: Path) -> FolderDataset:
    """MVSEC below a folder."""
    files = root.rglob(f"*{SUFFIX}")
    return named("mvsec", root, files, f"<name>{SUFFIX}", _load, naming=_sequence)


def _sequence(path: Path) -> str:
    return path.name.removesuffix(SUFFIX)


def _load(path: Path, name: str, span: Span | None) -> LabelledRecording:
    sequence = _sequence(path)
    events = read(path, span=span, stream=STREAM, width=WIDTH, height=HEIGHT)
    archive = path.with_name(f"{sequence}_gt_flow_dist.npz")
    hdf5 = path.with_name(f"{sequence}_gt.hdf5")
    flow, depth = None, None
    if hdf5.is_file():
        flow, depth = _hdf5_flow(hdf5), _hdf5_depth(hdf5)
    if archive.is_file() and flow is None:
        flow = _npz_flow(archive)
    indoors = sequence.startswith("indoor")
    truth = Truth(flow=flow, depth=depth, scene="still" if indoors else "unknown")
    group = "indoor_flying" if indoors else sequence.split("_day")[0].split("_night")[0]
    return LabelledRecording(name, events, group, None, truth)


def _hdf5_flow(path: Path) -> FlowTrack | None:
    h5py = require("h5py", "h5py", "HDF5", path)
    with h5py.File(path) as file:
        if "davis/left/flow_dist" not in file:
            return None
        seconds = np.asarray(file["davis/left/flow_dist_ts"], dtype=np.float64)

    def load(k: int) -> npt.NDArray[Any]:
        with h5py.File(path) as file:
            return _known(np.moveaxis(np.asarray(file["davis/left/flow_dist"][k]), 0, -1))

    return _track(seconds, load)


def _npz_flow(path: Path) -> FlowTrack:
    with np.load(path, allow_pickle=False) as archive:
        seconds = np.asarray(archive["timestamps"], dtype=np.float64)
        x, y = archive["x_flow_dist"], archive["y_flow_dist"]
    return _track(seconds, lambda k: _known(np.stack([x[k], y[k]], axis=-1)))


def _hdf5_depth(path: Path) -> ImageTrack | None:
    h5py = require("h5py", "h5py", "HDF5", path)
    with h5py.File(path) as file:
        if "davis/left/depth_image_raw" not in file:
            return None
        t = _microseconds(np.asarray(file["davis/left/depth_image_raw_ts"], dtype=np.float64))

    def load(k: int) -> npt.NDArray[Any]:
        with h5py.File(path) as file:
            return np.asarray(file["davis/left/depth_image_raw"][k])

    return ImageTrack(t, load)


def _track(seconds: npt.NDArray[np.float64], load: Any) -> FlowTrack:
    t = _microseconds(seconds)
    return FlowTrack(t[:-1], t[1:], load)


def _microseconds(seconds: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    return np.rint(1e6 * seconds).astype(np.int64)


def _known(flow: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    flow = flow.astype(np.float64)
    flow[(flow == 0).all(axis=-1)] = np.nan
    return flow
