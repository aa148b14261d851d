"""Simulating a scene: events with their owners, and the truth about what moves."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from emseg import _core
from emseg.camera import Camera
from emseg.events import EventArray
from emseg.simulation.build import BuiltScene, build, native_sensor
from emseg.simulation.imu import measure
from emseg.simulation.scene import Scene

__all__ = ["Poses", "Simulation", "Truth", "simulate"]


@dataclass(frozen=True, eq=False)
class Poses:
    """Where the camera and the objects are at n moments.

    Attributes:
        t: Times, µs, int64 (n,).
        T_world_camera: Float64 (n, 4, 4): points of the camera's frame to the world's.
        T_world_object: The same of each object, float64 (n, k, 4, 4), in the order of `labels`.
        labels: Labels of the objects, int64 (k,).
    """

    t: NDArray[np.int64]
    T_world_camera: NDArray[np.float64]
    T_world_object: NDArray[np.float64]
    labels: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is seen, every `scene.truth.interval` seconds, at n moments.

    Attributes:
        poses: Where the camera and the objects are.
        mask: Label of what each pixel shows most of: 0 background, 1.. objects; int8 (n, height, width).
        depth: Along the optical axis, m, float32 (n, height, width); 0 where there is nothing.
        flow: Motion in the image, x and y in px, from this moment over the next interval, float32
            (n, 2, height, width): of what the pixel shows, seen or hidden at its end; NaN where there is
            nothing.
        frame: Intensity, 0 .. 1, float32 (n, height, width).
    """

    poses: Poses
    mask: NDArray[np.int8]
    depth: NDArray[np.float32]
    flow: NDArray[np.float32]
    frame: NDArray[np.float32]

    @property
    def t(self) -> NDArray[np.int64]:
        """Times, µs, int64 (n,)."""
        return self.poses.t

    @property
    def labels(self) -> NDArray[np.int64]:
        """Labels of the objects, int64 (k,)."""
        return self.poses.labels

    @property
    def T_world_camera(self) -> NDArray[np.float64]:
        """The camera's poses, see :class:`Poses`."""
        return self.poses.T_world_camera

    @property
    def T_world_object(self) -> NDArray[np.float64]:
        """The objects' poses, see :class:`Poses`."""
        return self.poses.T_world_object


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated recording.

    Attributes:
        scene: What was simulated.
        events: What the sensor reports.
        owners: For each event the label of the surface whose motion or light made it, int16 (len(events),):
            0 background, 1.. objects, -1 noise.
        camera: Intrinsics and distortion.
        imu: Structured array of :data:`emseg.simulation.imu.IMU_DTYPE`.
        trajectory: Poses at the times of the inertial measurements.
        truth: What is seen.
    """

    scene: Scene
    events: EventArray
    owners: NDArray[np.int16]
    camera: Camera
    imu: NDArray[np.void]
    trajectory: Poses
    truth: Truth

    def save(self, path: str | PathLike[str]) -> None:
        """Write everything as .npz, see docs/simulation.md; the file is there complete or not at all."""
        from emseg.simulation.files import write_npz

        write_npz(Path(path), self)


def simulate(
    scene: Scene | str | PathLike[str],
    *,
    threads: int = 0,
    truth: Literal["all", "poses"] = "all",
) -> Simulation:
    """Simulate a scene.  The result is the same for any number of threads.

    Args:
        scene: A scene, or a YAML file that describes one.
        threads: 0: all cores.
        truth: "poses" leaves masks, depth, flow and frames out: their arrays have no moments.

    Raises:
        ConfigError: a ValueError that names the file, the place in it and what was expected.
    """
    if not isinstance(scene, Scene):
        scene = Scene.from_yaml(scene)
    built = build(scene)
    options = _core.SimulationOptions()
    options.duration = scene.duration
    options.latency_jitter = scene.sensor.latency_jitter
    options.readout_interval = scene.sensor.readout_interval
    options.threads = threads
    columns = built.native.simulate(native_sensor(scene.sensor, scene.seed), options)
    camera = scene.camera.to_camera()
    events = EventArray(*(columns[name] for name in "xytp"), width=camera.width, height=camera.height)
    interval = scene.truth.interval
    seconds: NDArray[np.float64] = np.arange(int(scene.duration / interval + 1e-9) + 1, dtype=np.float64)
    seconds *= interval
    imu = measure(built.T_world_camera, scene.duration, scene.truth.imu_rate)
    images = built.native.truth(seconds if truth == "all" else seconds[:0], interval, threads)
    return Simulation(
        scene,
        events,
        columns["owner"],
        camera,
        imu,
        _poses(built, imu["t"] / 1e6),
        Truth(
            _poses(built, seconds),
            images["label"].astype(np.int8),
            images["depth"],
            np.stack([images["flow_x"], images["flow_y"]], axis=1),
            images["intensity"],
        ),
    )


def _poses(built: BuiltScene, seconds: NDArray[np.float64]) -> Poses:
    objects = [path.poses(seconds) for path in built.T_world_objects.values()]
    return Poses(
        np.rint(seconds * 1e6).astype(np.int64),
        built.T_world_camera.poses(seconds),
        np.stack(objects, axis=1) if objects else np.zeros((len(seconds), 0, 4, 4)),
        np.array(list(built.T_world_objects), np.int64),
    )
