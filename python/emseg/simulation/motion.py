"""Motions as plain data."""

from __future__ import annotations

import itertools
from typing import Annotated, Final, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["ZERO", "Description", "Motion", "NotNegative", "Positive", "Shake", "Vector", "Wave", "Waypoint"]

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
# YAML knows lists only: they are taken for tuples, while their numbers stay strict.
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Interval = Annotated[tuple[float, float], Field(strict=False)]
ZERO: Final = (0.0, 0.0, 0.0)


class Description(BaseModel):
    """Plain data: frozen, typed, and unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Wave(Description):
    """A sine: amplitude sin(2π (frequency t + phase))."""

    amplitude: Vector  # m, or degrees
    frequency: Annotated[float, Field(gt=0, le=1000)]  # Hz
    phase: float = 0.0  # turns


class Waypoint(Description):
    """Where a motion passes at a time; between waypoints runs a natural cubic spline."""

    at: float  # s
    position: Vector = ZERO
    rotation: Vector = ZERO


class Shake(Description):
    """Trembling, as of a hand or a drone: a sum of sines of random directions below a frequency."""

    translation: NotNegative = 0.0  # m, root mean square
    rotation: NotNegative = 0.0  # degrees, root mean square
    frequency: Annotated[float, Field(gt=0, le=100)] = 8.0  # Hz, the highest
    seed: Annotated[int, Field(ge=0)] = 0


class Motion(Description):
    """A rigid motion: the sum of its parts.  Without any it stands still.

    Attributes:
        position, rotation: At the start.
        velocity: m/s.
        acceleration: m/s².
        spin: Degrees per second about an axis of the moving body.
        waves: Sines added to the position, m.
        swings: Sines of rotation, degrees.
        waypoints: A spline added to the position and rotation.
        shake: Trembling.
        pauses: Intervals, s, in which it stands still; it goes on where it stopped.
    """

    position: Vector = ZERO
    rotation: Vector = ZERO
    velocity: Vector = ZERO
    acceleration: Vector = ZERO
    spin: Vector = ZERO
    waves: Annotated[tuple[Wave, ...], Field(strict=False)] = ()
    swings: Annotated[tuple[Wave, ...], Field(strict=False)] = ()
    waypoints: Annotated[tuple[Waypoint, ...], Field(strict=False)] = ()
    shake: Shake | None = None
    pauses: Annotated[tuple[Interval, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _times_rise(self) -> Self:
        times = [point.at for point in self.waypoints]
        if len(times) == 1 or any(b <= a for a, b in itertools.pairwise(times)):
            raise ValueError(f"waypoints are at {times} s, expected two or more rising times")
        ends = [end for pause in self.pauses for end in pause]
        if any(b <= a for a, b in itertools.pairwise(ends)):
            raise ValueError(f"pauses are {list(self.pauses)}, expected rising times")
        return self

    @property
    def is_still(self) -> bool:
        """Whether nothing in it moves."""
        moving = (self.velocity, self.acceleration, self.spin)
        return (
            all(vector == ZERO for vector in moving)
            and not (self.waves or self.swings or self.waypoints)
            and (self.shake is None or not (self.shake.translation or self.shake.rotation))
        )
