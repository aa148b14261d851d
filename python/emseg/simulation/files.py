"""Simulated recordings as .npz, to the byte the same for the same scene."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import emseg
from emseg.simulation.simulator import Simulation

__all__ = ["arrays_of", "write_arrays", "write_npz"]

EPOCH: Final = (
    1980,
    1,
    1,
    0,
    0,
    0,
)  # of every member of the archive: the file does not tell when it was made
COMPRESSION: Final = 1  # events and flow hardly get smaller by more


def write_npz(path: Path, simulation: Simulation) -> None:
    """Write a simulation, complete or not at all."""
    write_arrays(path, arrays_of(simulation))


def arrays_of(simulation: Simulation) -> dict[str, NDArray[Any]]:
    """The arrays of a simulation by name, as docs/simulation.md lists them."""
    events, truth, camera = simulation.events, simulation.truth, simulation.camera
    arrays: dict[str, NDArray[Any]] = {
        "x": events.x,
        "y": events.y,
        "t": events.t,
        "p": events.p,
        "label": simulation.owners.astype(np.int8),
        "width": np.array(camera.width),
        "height": np.array(camera.height),
        "K": camera.K,
        "D": np.array(camera.distortion, np.float64),
        "gt_t": truth.t,
        "gt_T_world_camera": truth.T_world_camera,
        "gt_T_world_object": truth.T_world_object,
        "gt_object_label": truth.labels,
        "imu_t": simulation.imu["t"],
        "imu_gyro": simulation.imu["gyro"],
        "imu_accel": simulation.imu["accel"],
        "scene": np.array(simulation.scene.to_yaml()),
        "version": np.array(emseg.__version__),
    }
    if len(truth.mask):
        arrays |= {
            "gt_mask": truth.mask,
            "gt_depth": truth.depth.astype(np.float16),
            "gt_flow": truth.flow.astype(np.float16),
            "gt_frame": np.rint(255 * np.clip(truth.frame, 0, 1)).astype(np.uint8),
        }
    return arrays


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays as .npz without any trace of when, complete or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    work = path.with_name(f".{path.name}.tmp-{os.getpid()}")
    try:
        with zipfile.ZipFile(work, "w", zipfile.ZIP_DEFLATED, compresslevel=COMPRESSION) as archive:
            for name, array in arrays.items():
                member = zipfile.ZipInfo(f"{name}.npy", EPOCH)
                member.compress_type = zipfile.ZIP_DEFLATED
                with archive.open(member, "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, np.asarray(array, order="C"), allow_pickle=False)
        work.replace(path)
    finally:
        work.unlink(missing_ok=True)
