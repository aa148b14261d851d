"""Data sets of recordings without truth of moving objects, or in which nothing but the camera moves.

- DVSMOTION20 (DAVIS346): recordings as .mat of struct `aedat`, or .aedat, in folders such as
  `camera-motion-data/<name>_sequence/`.  Its truth is flow, of whose layout nothing could be looked up.
- DistSurf and HKUST-EMS (DAVIS346), as EMSGC has them: `DistSurf/{car,hand}/events.txt`,
  `hkust_EMS/{cast,corridor}/events_filtered.txt`, "t x y p" (s).  Source: HKUST-Aerial-Robotics/EMSGC, its
  launch files and the calibrations in calib/.
- Event Camera Dataset (DAVIS240C): `<name>/events.txt`, "t x y p" (s), calib.txt, and images.txt,
  groundtruth.txt, imu.txt; or `<name>.bag`.  Source: https://rpg.ifi.uzh.ch/davis_data.html.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Final, Literal

from emseg.camera import Camera
from emseg.datasets.folders import FolderDataset, named
from emseg.datasets.truth import LabelledRecording, Span, Truth
from emseg.io import read

__all__ = ["distsurf", "dvsmotion20", "ecd", "hkust_ems"]

Cameras = Mapping[str, Mapping[str, object]]
"""Intrinsics by sequence."""

DAVIS346: Final = (346, 260)
DAVIS240: Final = (240, 180)
TEXTS: Final = ("events.txt", "events_filtered.txt")

DISTSURF_CAMERA: Final = {
    "fx": 289.774042631025,
    "fy": 288.809833981223,
    "cx": 185.976950157181,
    "cy": 132.584991698716,
    "distortion": (-0.361699983842314, 0.158697458565572, 0.0, 0.0),
}
HKUST_CAMERAS: Final = {
    "cast": {
        "fx": 263.28364,
        "fy": 263.69952,
        "cx": 176.161,
        "cy": 125.098,
        "distortion": (-0.384006, 0.154708, 0.000817, 0.000338),
    },
    "corridor": {
        "fx": 262.76480588211632,
        "fy": 262.42274243034620,
        "cx": 175.89534865536419,
        "cy": 123.74031642899564,
        "distortion": (
            -0.37725451491065165,
            0.14273569289480459,
            8.1237045841725736e-4,
            2.5329725529011173e-4,
        ),
    },
}

STILL: Final = ("shapes_", "poster_", "boxes_", "hdr_", "slider_", "calibration", "simulation_")
"""How sequences of the Event Camera Dataset begin in which only the camera moves."""


def dvsmotion20(root: Path) -> FolderDataset:
    """DVSMOTION20 below a folder."""
    files = [path for suffix in ("*.mat", "*.aedat", "*.aedat4") for path in root.rglob(suffix)]
    expected = "sequences as .mat, .aedat or .aedat4"
    return named("dvsmotion20", root, files, expected, partial(_load, cameras={}))


def distsurf(root: Path) -> FolderDataset:
    """DistSurf's sequences below a folder, as EMSGC gives them out."""
    cameras = dict.fromkeys(("car", "hand"), DISTSURF_CAMERA)
    return _of_emsgc("distsurf", root, "car/events.txt", cameras)


def hkust_ems(root: Path) -> FolderDataset:
    """HKUST-EMS below a folder."""
    return _of_emsgc("hkust-ems", root, "cast/events_filtered.txt", HKUST_CAMERAS)


def ecd(root: Path) -> FolderDataset:
    """The Event Camera Dataset below a folder."""
    texts = {path.parent for path in root.rglob("events.txt")}
    bags = [path for path in root.rglob("*.bag") if path.with_suffix("") not in texts]
    return named("ecd", root, [*texts, *bags], "folders with events.txt, or .bag", _load_ecd)


def _of_emsgc(dataset: str, root: Path, expected: str, cameras: Cameras) -> FolderDataset:
    folders = {path.parent for name in TEXTS for path in root.rglob(name)}
    load = partial(_load, cameras=cameras)
    return named(dataset, root, folders, expected, load, naming=lambda path: path.name)


def _load(path: Path, name: str, span: Span | None, *, cameras: Cameras) -> LabelledRecording:
    width, height = DAVIS346
    if path.is_dir():
        text = next(path / file for file in TEXTS if (path / file).is_file())
        events = read(text, span=span, columns="txyp", time_unit="s", width=width, height=height)
    else:
        events = read(path, span=span, width=width, height=height)
    known = cameras.get(name)
    camera = Camera(width, height, **known) if known else None  # type: ignore[arg-type]
    return LabelledRecording(name, events, "", camera, Truth(scene="moving"))


def _load_ecd(path: Path, name: str, span: Span | None) -> LabelledRecording:
    width, height = DAVIS240
    if path.is_dir():
        events = read(
            path / "events.txt", span=span, columns="txyp", time_unit="s", width=width, height=height
        )
    else:
        events = read(path, span=span, width=width, height=height)
    calibration = (path if path.is_dir() else path.parent) / "calib.txt"
    camera = Camera.from_file(calibration, width=width, height=height) if calibration.is_file() else None
    sequence = name.split("/")[-1]
    scene: Literal["still", "unknown"] = "still" if sequence.startswith(STILL) else "unknown"
    return LabelledRecording(name, events, scene, camera, Truth(scene=scene))
