"""A walking person as an articulated body."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from emseg.simulation.motion import Motion, Wave
from emseg.simulation.scene import Ball, Box, Part, Person, Texture

__all__ = ["parts_of_person"]

KNEE: Final = 45.0  # degrees, most that a knee bends
ELBOW: Final = 35.0


def parts_of_person(person: Person, texture: Texture) -> list[Part]:
    """The parts of a person who stands on y = 0 and faces along x.

    Lengths are shares of the height (Winter, Biomechanics and Motor Control of Human Movement, 2009, p. 83,
    rounded).  Thighs and upper arms swing as sines in opposite phase, knees and elbows bend one way only, and
    the trunk rises and falls twice in a double step.
    """
    h = person.height
    bob: tuple[Wave, ...] = ()
    if person.cadence:
        amplitude = (0.0, 0.012 * h, 0.0)
        bob = (Wave(amplitude=amplitude, frequency=2 * person.cadence, phase=2 * person.phase),)
    trunk = Part(
        name="trunk",
        shape=Box(size=(0.11 * h, 0.31 * h, 0.2 * h)),
        motion=Motion(position=(0.0, -0.53 * h, 0.0), waves=bob),
        offset=(0.0, -0.145 * h, 0.0),
    )
    head = Part(
        name="head",
        parent="trunk",
        shape=Ball(radius=0.065 * h, detail=1),
        motion=Motion(position=(0.0, -0.3 * h, 0.0)),
        offset=(0.01 * h, -0.085 * h, 0.0),
        texture=texture.model_copy(update={"low": min(0.3, texture.high), "grain": texture.grain / 2}),
    )
    trousers = texture.model_copy(update={"high": max(texture.low, 0.6 * texture.high)})
    return [trunk, head, *_limbs(person, trousers)]


def _limbs(person: Person, trousers: Texture) -> Iterator[Part]:
    h = person.height
    for side, name, phase in ((-1, "left", 0.0), (1, "right", 0.5)):
        phase += person.phase
        leg = _Joint(person, phase)
        arm = _Joint(person, phase + 0.5)
        yield Part(
            name=f"{name} thigh",
            parent="trunk",
            shape=Box(size=(0.085 * h, 0.25 * h, 0.08 * h)),
            motion=leg.swinging((0.0, 0.0, side * 0.052 * h), person.swing),
            offset=(0.0, 0.12 * h, 0.0),
            texture=trousers,
        )
        yield Part(
            name=f"{name} shank",
            parent=f"{name} thigh",
            shape=Box(size=(0.065 * h, 0.27 * h, 0.06 * h)),
            motion=leg.bending((0.0, 0.245 * h, 0.0), KNEE * person.swing / 30),
            offset=(0.0, 0.135 * h, 0.0),
            texture=trousers,
        )
        yield Part(
            name=f"{name} upper arm",
            parent="trunk",
            shape=Box(size=(0.055 * h, 0.18 * h, 0.05 * h)),
            motion=arm.swinging((0.0, -0.28 * h, side * 0.128 * h), 0.9 * person.swing),
            offset=(0.0, 0.085 * h, 0.0),
        )
        yield Part(
            name=f"{name} forearm",
            parent=f"{name} upper arm",
            shape=Box(size=(0.045 * h, 0.2 * h, 0.042 * h)),
            motion=arm.bending((0.0, 0.17 * h, 0.0), -ELBOW * person.swing / 30),
            offset=(0.0, 0.1 * h, 0.0),
        )


class _Joint:
    """Rotations about z, the axis from side to side, in step with the walk."""

    def __init__(self, person: Person, phase: float) -> None:
        self._cadence, self._phase = person.cadence, phase

    def swinging(self, position: tuple[float, float, float], degrees: float) -> Motion:
        return Motion(position=position, swings=self._waves(degrees, 0.0))

    def bending(self, position: tuple[float, float, float], degrees: float) -> Motion:
        """Between straight and bent; most while the limb swings forward, a quarter turn after its extreme."""
        return Motion(
            position=position, rotation=(0.0, 0.0, degrees / 2), swings=self._waves(degrees / 2, 0.5)
        )

    def _waves(self, degrees: float, lag: float) -> tuple[Wave, ...]:
        if not self._cadence or not degrees:
            return ()
        phase = self._phase + lag / 2
        return (Wave(amplitude=(0.0, 0.0, degrees), frequency=self._cadence, phase=phase),)
