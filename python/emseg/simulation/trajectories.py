"""Motions as functions of time, and their samples for the native core."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emseg import _core
from emseg.simulation.motion import Motion, Shake, Waypoint
from emseg.simulation.randomness import Random

__all__ = ["SAMPLE_INTERVAL", "Track", "multiply", "rotate", "rotation_quaternion"]

Floats = NDArray[np.float64]

SAMPLE_INTERVAL: Final = 1e-3  # s
RAMP: Final = 0.03  # s in which a motion stops and starts again
SHAKE_WAVES: Final = 9  # sines of a trembling, per component

# What mathematical libraries differ by is far below this grid, so that all machines simulate the same motion.
GRID: Final = 2.0**36


class Track:
    """A rigid motion, sampled every :data:`SAMPLE_INTERVAL` from time 0 on.

    Attributes:
        position: m, float64 (n, 3); one row where it stands still.
        quaternion: w, x, y, z, float64 (n, 4).
    """

    def __init__(self, position: Floats, quaternion: Floats) -> None:
        self.position = np.round(position * GRID) / GRID
        self.quaternion = np.round(quaternion * GRID) / GRID

    @classmethod
    def of(cls, motion: Motion, duration: float) -> Track:
        """The samples of a motion, until after `duration` s."""
        if motion.is_still:
            return cls(np.array([motion.position]), rotation_quaternion(np.array([motion.rotation])))
        clock = _clock(
            motion, np.arange(math.ceil(duration / SAMPLE_INTERVAL) + 3, dtype=np.float64) * SAMPLE_INTERVAL
        )
        t = clock[:, None]
        position = np.array(motion.position) + np.array(motion.velocity) * t
        position = position + 0.5 * np.array(motion.acceleration) * t**2
        swing = np.zeros_like(position)
        for waves, sum_ in ((motion.waves, position), (motion.swings, swing)):
            for wave in waves:
                sum_ += np.array(wave.amplitude) * np.sin(2 * np.pi * (wave.frequency * t + wave.phase))
        quaternion = rotation_quaternion(np.array([motion.rotation]))
        if motion.waypoints:
            at, turn = _spline(motion.waypoints, clock)
            position += at
            quaternion = multiply(quaternion, rotation_quaternion(turn))
        quaternion = multiply(quaternion, rotation_quaternion(np.array(motion.spin) * t))
        quaternion = multiply(quaternion, rotation_quaternion(swing))
        if motion.shake is not None:
            at, turn = _shake(motion.shake, clock)
            position += at
            quaternion = multiply(quaternion, rotation_quaternion(turn))
        return cls(position, quaternion)

    @property
    def is_still(self) -> bool:
        """Whether there is one pose only."""
        return len(self.position) == 1

    def __matmul__(self, child: Track) -> Track:
        """The motion of a child that moves in this one's frame."""
        quaternion = multiply(self.quaternion, child.quaternion)
        return Track(self.position + rotate(self.quaternion, child.position), quaternion)

    def to_native(self) -> _core.Path:
        """The path that the native core follows."""
        return _core.Path(np.concatenate([self.position, self.quaternion], axis=1), SAMPLE_INTERVAL)


def rotation_quaternion(degrees: Floats) -> Floats:
    """Quaternions w, x, y, z (n, 4) of rotation vectors (n, 3) in degrees."""
    half = np.radians(degrees) / 2
    angle = np.linalg.norm(half, axis=1, keepdims=True)
    # sin(a) / a, whose limit at 0 is 1.
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=1)


def multiply(a: Floats, b: Floats) -> Floats:
    """Products of quaternions (n, 4); single ones stand for all."""
    aw, ax, ay, az = (a[:, k] for k in range(4))
    bw, bx, by, bz = (b[:, k] for k in range(4))
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=1,
    )


def rotate(quaternion: Floats, vector: Floats) -> Floats:
    """Vectors (n, 3) turned by unit quaternions (n, 4); single ones stand for all."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    across = 2 * np.cross(axis, vector)
    return vector + w * across + np.cross(axis, across)


def _clock(motion: Motion, t: Floats) -> Floats:
    """The time that a motion has gone on for: it stops in its pauses, by a ramp at either end."""
    clock = t.copy()
    for start, end in motion.pauses:
        ramp = min(RAMP, (end - start) / 2)
        # The rate falls linearly to 0 over the first ramp and rises over the last: integrate its deficit.
        lost = _ramp_integral(t - start, ramp) - _ramp_integral(t - (end - ramp), ramp)
        clock = clock - lost
    return clock


def _ramp_integral(s: Floats, ramp: float) -> Floats:
    """Integral of a rate that rises from 0 at s = 0 to 1 at s = ramp and stays there."""
    inside = np.clip(s, 0, ramp)
    return inside**2 / (2 * ramp) + np.maximum(s - ramp, 0)


def _spline(points: tuple[Waypoint, ...], clock: Floats) -> tuple[Floats, Floats]:
    """Position and rotation vector of the natural cubic spline through the waypoints; held outside."""
    at = np.array([point.at for point in points])
    values = np.array([[*point.position, *point.rotation] for point in points])
    width = np.diff(at)
    slope = np.diff(values, axis=0) / width[:, None]
    count = len(at)
    system = np.eye(count)
    right = np.zeros_like(values)
    for row in range(1, count - 1):  # the second derivative is continuous, and zero at the ends
        system[row, row - 1 : row + 2] = width[row - 1], 2 * (width[row - 1] + width[row]), width[row]
        right[row] = 6 * (slope[row] - slope[row - 1])
    curvature = np.linalg.solve(system, right)
    inside = np.clip(clock, at[0], at[-1])
    k = np.clip(np.searchsorted(at, inside, side="right") - 1, 0, count - 2)
    s, h = (inside - at[k])[:, None], width[k][:, None]
    bend = (curvature[k + 1] - curvature[k]) / (6 * h)
    start = slope[k] - h * (2 * curvature[k] + curvature[k + 1]) / 6
    found = values[k] + s * (start + s * (curvature[k] / 2 + s * bend))
    return found[:, :3], found[:, 3:]


def _shake(shake: Shake, clock: Floats) -> tuple[Floats, Floats]:
    """Trembling of position, m, and rotation, degrees; each of its components has a third of the power."""
    random = Random(shake.seed)
    parts = []
    for size in (shake.translation, shake.rotation):
        sum_ = np.zeros((len(clock), 3))
        for k in range(SHAKE_WAVES):
            # Slow trembling is the larger, as of a hand: amplitudes fall with the frequency.
            share = (k + random.uniform(0, 1)) / SHAKE_WAVES
            weight = 1 / (0.3 + share)
            for component in range(3):
                phase = random.uniform(0, 1)
                sum_[:, component] += weight * np.sin(
                    2 * np.pi * (max(share, 0.02) * shake.frequency * clock + phase)
                )
        power = sum(0.5 / (0.3 + (k + 0.5) / SHAKE_WAVES) ** 2 for k in range(SHAKE_WAVES))
        parts.append(sum_ * size / math.sqrt(3 * power))
    return parts[0], parts[1]
