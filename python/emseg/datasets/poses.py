"""Which objects move, from the poses of objects and camera: masks of EV-IMO label still objects too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

__all__ = ["moving_objects", "pose_matrix"]

CAMERA: Final = "cam"
BASELINE: Final = 0.1
"""Time over which motion is judged, s: long against the jitter of the poses, short against the motion."""
ARM: Final = 0.1
"""Distance from an object's origin, m, at which its turning counts as motion: about the objects' size."""
MIN_SPEED: Final = 0.05
"""m/s in the world from which an object moves.

Poses jitter by a millimetre or two, which over the baseline looks like 0.02 m/s.
"""


def pose_matrix(pose: Mapping[str, Any]) -> npt.NDArray[np.float64]:
    """A pose {"t": {x, y, z}, "q": {w, x, y, z}} as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([pose["q"][name] for name in "xyzw"]).as_matrix()
    matrix[:3, 3] = [pose["t"][name] for name in "xyz"]
    return matrix


def moving_objects(
    trajectory: Sequence[Mapping[str, Any]], t: npt.ArrayLike, *, min_speed: float = MIN_SPEED
) -> list[dict[int, bool]]:
    """Whether each object moves in the world at each moment; objects without a pose about it are left out.

    An object moves if its origin, or a point 0.1 m off it, moves faster than min_speed over the 0.1 s about
    the moment.

    Args:
        trajectory: Entries as EV-IMO's meta has them, by time: "ts" (s), "cam" and objects by number, each
            with "pos".  Poses of objects map their frame to the camera's, that of the camera its frame to the
            world's.
        t: Moments, s.
        min_speed: m/s.
    """
    times, poses = _world_poses(trajectory)
    found: list[dict[int, bool]] = []
    for moment in np.atleast_1d(np.asarray(t, dtype=np.float64)).tolist():
        states = {}
        for number, seen in times.items():
            first = int(np.searchsorted(seen, moment - 0.5 * BASELINE))
            last = int(np.searchsorted(seen, moment + 0.5 * BASELINE, side="right")) - 1
            if last <= first:
                continue
            start, end = poses[number][first], poses[number][last]
            turn = np.linalg.norm(Rotation.from_matrix(end[:3, :3] @ start[:3, :3].T).as_rotvec())
            way = np.linalg.norm(end[:3, 3] - start[:3, 3]) + ARM * turn
            states[number] = bool(way > min_speed * (seen[last] - seen[first]))
        found.append(states)
    return found


def _world_poses(
    trajectory: Sequence[Mapping[str, Any]],
) -> tuple[dict[int, npt.NDArray[np.float64]], dict[int, list[npt.NDArray[np.float64]]]]:
    """Times and poses in the world of every object."""
    times: dict[int, list[float]] = {}
    poses: dict[int, list[npt.NDArray[np.float64]]] = {}
    for entry in trajectory:
        if CAMERA not in entry:
            continue
        T_world_camera = pose_matrix(entry[CAMERA]["pos"])
        for key, value in entry.items():
            if not (key.isdigit() and isinstance(value, Mapping) and "pos" in value):
                continue
            times.setdefault(int(key), []).append(float(entry["ts"]))
            poses.setdefault(int(key), []).append(T_world_camera @ pose_matrix(value["pos"]))
    return {number: np.array(seen) for number, seen in times.items()}, poses
