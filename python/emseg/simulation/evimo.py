"""Simulated recordings in the layouts of EV-IMO and EVIMO2.

Formats: https://better-flow.github.io/evimo/docs/ground-truth-format.html.  Depth is uint16 in mm; masks are
uint16 with a thousand times the object's label; 0 is unknown and background.  Poses of objects map their
frame to the camera's, those of the camera its frame to the world's.
"""

from __future__ import annotations

import os
import pprint
import struct
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from emseg.simulation.files import EPOCH, write_arrays
from emseg.simulation.simulator import Poses, Simulation
from emseg.writers import atomic_folder

__all__ = ["metadata", "write_evimo", "write_evimo2", "write_text"]

MASK_STEP: Final = 1000
DISCRETIZATION: Final = 0.01  # s between entries of the index of events
IMU_TOPIC: Final = "/simulated/imu"


def write_evimo2(folder: Path, simulation: Simulation) -> None:
    """Write the folder of a sequence as EVIMO2 v2 has it, complete or not at all."""
    _require_truth(simulation)
    events, depth, mask, classical = simulation.events, *_images(simulation)
    with atomic_folder(folder) as work:
        np.save(work / "dataset_events_t.npy", _seconds(events.t))
        np.save(work / "dataset_events_xy.npy", np.stack([events.x, events.y], axis=1))
        np.save(work / "dataset_events_p.npy", events.p)
        for name, images in (("depth", depth), ("mask", mask), ("classical", classical)):
            keyed = {f"{name}_{number:010d}": image for number, image in enumerate(images)}
            write_arrays(work / f"dataset_{name}.npz", keyed)
        _write_with_pickle(work / "dataset_info.npz", _info(simulation))


def write_evimo(path: Path, simulation: Simulation) -> None:
    """Write a sequence as one .npz, as EV-IMO and EVIMO2 v1 have it, complete or not at all."""
    _require_truth(simulation)
    events, (depth, mask, classical) = simulation.events, _images(simulation)
    table = np.stack([_seconds(events.t), events.x, events.y, events.p], axis=1)
    arrays = {"events": table, "depth": depth, "mask": mask, "classical": classical, **_info(simulation)}
    path.parent.mkdir(parents=True, exist_ok=True)
    work = path.with_name(f".{path.name}.tmp-{os.getpid()}")
    try:
        _write_with_pickle(work, arrays)
        work.replace(path)
    finally:
        work.unlink(missing_ok=True)


def write_text(folder: Path, simulation: Simulation) -> None:
    """Write the folder of a sequence in the text layout, complete or not at all.

    events.txt holds "t x y p"; img/depth_mask_N.png 16 bit, which OpenCV reads as depth, depth, mask;
    img/img_N.png the frames; meta.txt a Python literal; calib.txt fx fy cx cy and the distortion.
    """
    _require_truth(simulation)
    events, (depth, mask, classical) = simulation.events, _images(simulation)
    camera = simulation.camera
    with atomic_folder(folder) as work:
        with (work / "events.txt").open("w", encoding="ascii") as file:
            for row in zip(*(getattr(events, name).tolist() for name in "txyp"), strict=True):
                file.write(f"{row[0] / 1e6:.6f} {row[1]} {row[2]} {row[3]}\n")
        (work / "img").mkdir()
        for number in range(len(depth)):
            # Red, green, blue; OpenCV gives them the other way round.
            channels = np.stack([mask[number], depth[number], depth[number]], axis=-1)
            _write_png(work / "img" / f"depth_mask_{number}.png", channels)
            _write_png(work / "img" / f"img_{number}.png", classical[number][..., None])
        numbers = (camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion)
        (work / "calib.txt").write_text(" ".join(f"{number:.9g}" for number in numbers) + "\n")
        (work / "meta.txt").write_text(pprint.pformat(metadata(simulation), compact=True) + "\n")


def metadata(simulation: Simulation) -> dict[str, Any]:
    """The dictionary `meta`: frames, full_trajectory, imu and intrinsics, in plain Python numbers."""
    truth, camera = simulation.truth, simulation.camera
    frames = _poses(truth.poses)
    for number, frame in enumerate(frames):
        frame |= {
            "id": number,
            "gt_frame": f"depth_mask_{number}.png",
            "classical_frame": f"img_{number}.png",
        }
    names = ("k1", "k2", "k3", "k4") if camera.model == "equidistant" else ("k1", "k2", "p1", "p2", "k3")
    coefficients = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0)
    coefficients |= dict(zip(names, camera.distortion, strict=False))
    imu = [
        {
            "ts": int(sample["t"]) / 1e6,
            "angular_velocity": _xyz(sample["gyro"]),
            "linear_acceleration": _xyz(sample["accel"]),
        }
        for sample in simulation.imu
    ]
    return {
        "frames": frames,
        "full_trajectory": _poses(simulation.trajectory),
        "imu": {IMU_TOPIC: imu},
        "meta": {
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            **coefficients,
            "dist_model": camera.model or "radtan",
            "res_x": camera.width,
            "res_y": camera.height,
            "ros_time_offset": 0.0,
        },
    }


def _require_truth(simulation: Simulation) -> None:
    if not len(simulation.truth.mask):
        raise ValueError("the simulation has no masks and depth, expected truth='all'")


def _images(simulation: Simulation) -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint8]]:
    """Depth, masks and frames (n, height, width) in the units of the layouts."""
    truth = simulation.truth
    depth = np.rint(np.minimum(1000 * truth.depth, 65535)).astype(np.uint16)
    mask = truth.mask.astype(np.uint16) * MASK_STEP
    classical = np.rint(255 * np.clip(truth.frame, 0, 1)).astype(np.uint8)
    return depth, mask, classical


def _seconds(t: NDArray[np.int64]) -> NDArray[np.float64]:
    return t / 1e6


def _info(simulation: Simulation) -> dict[str, NDArray[Any]]:
    events, camera = simulation.events, simulation.camera
    ticks = np.arange(int(simulation.scene.duration / DISCRETIZATION) + 1) * round(1e6 * DISCRETIZATION)
    meta = np.empty((), object)
    meta[()] = metadata(simulation)
    return {
        "K": camera.K,
        "D": np.array([*camera.distortion, *[0.0] * 4][: max(4, len(camera.distortion))]),
        "index": np.searchsorted(events.t, ticks).astype(np.uint64),
        "discretization": np.array(DISCRETIZATION),
        "meta": meta,
    }


def _poses(poses: Poses) -> list[dict[str, Any]]:
    """One dictionary a moment: poses of the objects by label, and of the camera, `cam`."""
    entries = []
    for k, t in enumerate(poses.t):
        seconds = int(t) / 1e6
        camera = poses.T_world_camera[k]
        entry: dict[str, Any] = {"ts": seconds, "cam": {"pos": _pose(camera), "ts": seconds}}
        for label, T_world_object in zip(poses.labels, poses.T_world_object[k], strict=True):
            seen = np.linalg.inv(camera) @ T_world_object
            entry[str(label)] = {"pos": _pose(seen), "ts": seconds}
        entries.append(entry)
    return entries


def _pose(matrix: NDArray[np.float64]) -> dict[str, dict[str, float]]:
    rotation = Rotation.from_matrix(matrix[:3, :3])
    x, y, z, w = (float(part) for part in rotation.as_quat(canonical=True))
    roll, pitch, yaw = (float(angle) for angle in rotation.as_euler("xyz"))
    return {
        "t": _xyz(matrix[:3, 3]),
        "q": {"w": w, "x": x, "y": y, "z": z},
        "rpy": {"r": roll, "p": pitch, "y": yaw},
    }


def _xyz(vector: NDArray[np.float64]) -> dict[str, float]:
    return {name: float(value) for name, value in zip("xyz", vector, strict=True)}


def _write_with_pickle(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """As :func:`write_arrays`, for arrays of Python objects too: the layout wants a pickled dictionary."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy", EPOCH)
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array, order="C"), allow_pickle=True)


def _write_png(path: Path, picture: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write (h, w, 1) as grey or (h, w, 3) as RGB, 8 or 16 bit (ISO/IEC 15948)."""
    height, width, channels = picture.shape
    depth = 8 * picture.dtype.itemsize
    rows = np.ascontiguousarray(picture.astype(picture.dtype.newbyteorder(">"))).view(np.uint8)
    lines = np.zeros((height, 1 + rows.size // height), np.uint8)  # each after the filter "none"
    lines[:, 1:] = rows.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, depth, 2 if channels == 3 else 0, 0, 0, 0)
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, content in (
            (b"IHDR", header),
            (b"IDAT", zlib.compress(lines.tobytes(), 1)),
            (b"IEND", b""),
        ):
            file.write(struct.pack(">I", len(content)) + kind + content)
            file.write(struct.pack(">I", zlib.crc32(kind + content)))
