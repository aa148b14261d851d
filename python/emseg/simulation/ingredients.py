"""What the scenes of the suite are made of: sensors, cameras, surroundings and things that move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from emseg.simulation.motion import Motion, Shake, Wave
from emseg.simulation.randomness import Random
from emseg.simulation.scene import (
    Ball,
    Blob,
    Body,
    Box,
    CameraDescription,
    Cylinder,
    Disc,
    Net,
    Person,
    Rectangle,
    Sensor,
    Shape,
    Texture,
)

__all__ = ["Place", "cards", "furniture", "grid", "room", "sensor", "texture", "wall"]

# Sensors: name, width, height, and a usual focal length, px.
SMALL: Final = (240, 180, 200.0)
MEDIUM: Final = (346, 260, 258.0)
LARGE: Final = (640, 480, 540.0)
HD: Final = (1280, 720, 900.0)

Vector = tuple[float, float, float]


class Place:
    """A camera's view, in which things are placed by where they are in the image.

    Args:
        random: What draws.
        sensors: Sensors to choose from.
        duration: Of the scene, s.
    """

    def __init__(self, random: Random, sensors: Sequence[tuple[int, int, float]], duration: float) -> None:
        self.random = random
        self.duration = duration
        self.width, self.height, focal = random.choice(sensors)
        self.focal = round(focal * random.uniform(0.9, 1.15), 1)

    def camera(self, motion: Motion) -> CameraDescription:
        """The camera with a motion."""
        return CameraDescription(width=self.width, height=self.height, fx=self.focal, motion=motion)

    def at(self, x: float, y: float, depth: float) -> Vector:
        """The point seen at (x, y), in units of half the image's width and height from its middle."""
        reach = depth / self.focal / 2
        return (x * self.width * reach, y * self.height * reach, depth)

    def metres(self, share: float, depth: float) -> float:
        """How long something is that takes a share of the image's height at this depth."""
        return share * self.height * depth / self.focal

    def velocity(self, px_per_s: float, direction: float, depth: float) -> Vector:
        """The velocity, m/s, of what moves through the image at a speed, in a direction (turns from x to y).

        Speeds are those of a sensor 346 px wide: on others they are as fast in proportion.
        """
        speed = px_per_s * self.width / 346 * depth / self.focal
        angle = 2 * math.pi * direction
        return (speed * math.cos(angle), speed * math.sin(angle), 0.0)

    def crossing(self, speed: tuple[float, float], depth: float, *, margin: float = 0.7) -> Motion:
        """A motion through the image that passes within `margin` of its middle at half time."""
        random = self.random
        velocity = self.velocity(
            random.spread(*speed), random.uniform(-0.08, 0.08) + random.choice((0, 0.5)), depth
        )
        x, y, z = self.at(random.uniform(-margin, margin), random.uniform(-margin, margin) * 0.8, depth)
        half = self.duration / 2
        approach = random.uniform(-0.15, 0.15) * depth
        return Motion(
            position=(x - velocity[0] * half, y - velocity[1] * half, z),
            velocity=(velocity[0], velocity[1], approach),
            rotation=tilt(random),
            spin=(0.0, 0.0, random.uniform(-120, 120)),
        )

    # Camera motions.

    def still(self) -> Motion:
        """On a tripod."""
        return Motion()

    def hand_held(self, strength: float = 1.0) -> Motion:
        """In a hand: trembling, and a slow drift."""
        random = self.random
        return Motion(
            velocity=tuple_of(random, 0.12 * strength),
            spin=tuple_of(random, 4 * strength),
            shake=Shake(
                translation=0.012 * strength,
                rotation=0.8 * strength * random.uniform(0.6, 1.4),
                frequency=random.uniform(3, 6),
                seed=random.integer(0, 10**6),
            ),
        )

    def panning(self, degrees_per_s: tuple[float, float]) -> Motion:
        """Turning to the side."""
        random = self.random
        rate = random.sign() * random.spread(*degrees_per_s)
        return Motion(
            rotation=(0.0, -rate * self.duration / 2, 0.0),
            spin=(random.uniform(-5, 5), rate, random.uniform(-5, 5)),
            velocity=tuple_of(random, 0.1),
            shake=Shake(rotation=0.15, translation=0.003, frequency=10, seed=random.integer(0, 10**6)),
        )

    def flying(self) -> Motion:
        """On a drone: sweeping, leaning, with vibrations."""
        random = self.random
        sweep = Wave(
            amplitude=(random.uniform(-3, 3), random.sign() * random.uniform(4, 9), random.uniform(-6, 6)),
            frequency=random.uniform(0.5, 1.2),
            phase=random.uniform(0, 1),
        )
        return Motion(
            velocity=(random.uniform(-0.6, 0.6), random.uniform(-0.2, 0.2), random.uniform(-0.3, 0.6)),
            swings=(sweep,),
            shake=Shake(rotation=0.12, translation=0.002, frequency=25, seed=random.integer(0, 10**6)),
        )

    def any_camera(self) -> Motion:
        """One of the above."""
        kind = self.random.integer(0, 3)
        if kind == 0:
            return self.hand_held(self.random.uniform(0.5, 2))
        if kind == 1:
            return self.panning((15, 50))
        return self.flying() if kind == 2 else self.sliding((0.1, 0.6))

    def sliding(self, speed: tuple[float, float]) -> Motion:
        """Moving to the side, so that near things pass faster than far ones; m/s."""
        random = self.random
        return Motion(
            velocity=(
                random.sign() * random.spread(*speed),
                random.uniform(-0.1, 0.1),
                random.uniform(-0.2, 0.2),
            ),
            shake=Shake(rotation=0.2, translation=0.004, frequency=6, seed=random.integer(0, 10**6)),
        )


def tuple_of(random: Random, reach: float) -> Vector:
    """A vector of which no part exceeds the reach."""
    return (random.uniform(-reach, reach), random.uniform(-reach, reach), random.uniform(-reach, reach))


def tilt(random: Random, degrees: float = 25.0) -> Vector:
    """A rotation out of the image plane, and any in it."""
    return (random.uniform(-degrees, degrees), random.uniform(-degrees, degrees), random.uniform(-60, 60))


def sensor(random: Random, **fixed: Any) -> Sensor:
    """A sensor as they differ: thresholds, mismatch, noise, bandwidth, latency."""
    threshold = random.uniform(0.17, 0.36)
    drawn: dict[str, Any] = {
        "threshold_on": round(threshold * random.uniform(0.9, 1.1), 4),
        "threshold_off": round(threshold * random.uniform(0.9, 1.1), 4),
        "threshold_sigma": round(random.uniform(0.01, 0.04), 4),
        "refractory": random.choice((5e-4, 1e-3, 1e-3, 2.2e-3)),
        "cutoff": random.choice((0.0, 0.0, 150.0, 400.0)),
        "shot_noise": round(random.spread(0.08, 0.6), 4),
        "leak": random.choice((0.0, 0.05, 0.1)),
        "hot_fraction": random.choice((0.0, 0.0, 1e-4, 3e-4)),
        "latency_jitter": random.choice((0.0, 2e-6, 1e-5, 3e-5)),
    }
    return Sensor(**drawn | fixed)


def texture(random: Random, grain: float, *, plenty: bool = True, of: Sequence[str] = ()) -> Texture:
    """A texture whose features are about `grain` large; not plenty: few of them, as on walls."""
    kind = random.choice(of or ("leaves", "leaves", "blocks", "blocks", "checker", "stripes"))
    low = random.uniform(0.06, 0.25)
    return Texture(
        kind=kind,  # type: ignore[arg-type]
        grain=round(grain * random.spread(0.7, 1.5), 5),
        density=round(random.uniform(1.2, 2.5) if plenty else random.spread(0.08, 0.8), 4),
        low=round(low, 4),
        high=round(min(0.95, low * random.spread(2.5, 8)), 4),
        seed=random.integer(0, 2**40),
    )


def wall(place: Place, depth: float, *, plenty: bool | None = None) -> Body:
    """A large wall that fills the view, perhaps aslant."""
    random = place.random
    plenty = random.chance(0.4) if plenty is None else plenty
    grain = place.metres(random.uniform(0.05, 0.14), depth)
    return Body(
        name="wall",
        shape=Rectangle(size=(8 * depth, 8 * depth)),
        motion=Motion(
            position=(0.0, 0.0, depth), rotation=(random.uniform(-12, 12), random.uniform(-15, 15), 0.0)
        ),
        texture=texture(random, grain, plenty=plenty, of=("leaves", "blocks") if not plenty else ()),
    )


def cards(place: Place, count: int, depths: tuple[float, float]) -> list[Body]:
    """Things that stand still at several depths: what looks as if it moved is parallax."""
    random = place.random
    found = []
    for number in range(count):
        depth = random.uniform(*depths)
        size = place.metres(random.uniform(0.15, 0.4), depth)
        shape: Shape = Rectangle(size=(size, size * random.uniform(0.6, 1.4)))
        if random.chance(0.3):
            shape = Box(size=(size, size * random.uniform(0.6, 1.4), size * random.uniform(0.3, 1)))
        found.append(
            Body(
                name=f"card {number}",
                shape=shape,
                motion=Motion(
                    position=place.at(random.uniform(-1.2, 1.2), random.uniform(-1.1, 1.1), depth),
                    rotation=tilt(random, 35),
                ),
                texture=texture(random, place.metres(random.uniform(0.03, 0.06), depth)),
            )
        )
    return found


def room(place: Place, size: Vector, *, eye_height: float = 1.4, plenty: bool | None = None) -> Body:
    """A room around the camera, which stands near its front wall."""
    random = place.random
    plenty = random.chance(0.4) if plenty is None else plenty
    return Body(
        name="room",
        shape=Box(size=size, seen_from="inside"),
        motion=Motion(position=(0.0, eye_height - size[1] / 2, size[2] / 2 - 1.0)),
        texture=texture(
            random, place.metres(random.uniform(0.05, 0.1), size[2]), plenty=plenty, of=("leaves", "blocks")
        ),
    )


def furniture(place: Place, count: int, depths: tuple[float, float], floor: float) -> list[Body]:
    """Boxes and cylinders that stand on the floor, `floor` m below the camera."""
    random = place.random
    found = []
    for number in range(count):
        depth = random.uniform(*depths)
        height, width = random.uniform(0.3, 1.4), random.uniform(0.2, 0.6)
        x = place.at(random.uniform(-1.1, 1.1), 0, depth)[0]
        shape: Shape = Box(size=(width, height, width))
        if random.chance(0.35):
            shape = Cylinder(radius=width / 2, height=height, sides=16)
        found.append(
            Body(
                name=f"furniture {number}",
                shape=shape,
                motion=Motion(
                    position=(x, floor - height / 2, depth), rotation=(0.0, random.uniform(0, 90), 0.0)
                ),
                texture=texture(random, random.uniform(0.05, 0.12), plenty=random.chance(0.7)),
            )
        )
    return found


def grid(place: Place, depth: float) -> Body:
    """A net or fence in front of everything."""
    random = place.random
    pitch = place.metres(random.uniform(0.22, 0.4), depth)
    fence = random.chance(0.3)
    return Body(
        name="net",
        shape=Net(
            size=(6 * depth, 6 * depth),
            pitch=(pitch, 0.0 if fence else pitch),
            bar=pitch * random.uniform(0.08, 0.22),
        ),
        motion=Motion(
            position=(0.0, 0.0, depth), rotation=(0.0, random.uniform(-8, 8), random.uniform(-8, 8))
        ),
        texture=texture(random, pitch / 3, of=("leaves", "clouds", "stripes")),
    )


def thing(random: Random, size: float, *, solid: float = 0.5) -> Shape:
    """A shape about `size` m large; with probability `solid` no flat one."""
    if random.chance(solid):
        kind = random.integer(0, 2)
        if kind == 0:
            return Ball(radius=size / 2)
        if kind == 1:
            return Box(
                size=(
                    size * random.uniform(0.6, 1),
                    size * random.uniform(0.6, 1),
                    size * random.uniform(0.5, 1),
                )
            )
        return Cylinder(radius=size * random.uniform(0.25, 0.45), height=size, sides=14)
    kind = random.integer(0, 2)
    if kind == 0:
        return Rectangle(size=(size, size * random.uniform(0.6, 1.2)))
    if kind == 1:
        return Disc(radius=size / 2)
    return Blob(radius=size / 2, irregularity=random.uniform(0.1, 0.35), seed=random.integer(0, 10**6))


def mover(place: Place, share: float, depth: float, motion: Motion, *, solid: float = 0.5) -> Body:
    """A thing that takes a share of the image's height, with a motion."""
    size = place.metres(share, depth)
    shape = thing(place.random, size, solid=solid)
    if not isinstance(shape, Rectangle | Disc | Blob):  # solid things turn about any axis
        motion = motion.model_copy(update={"spin": tuple_of(place.random, 150)})
    grain = size * place.random.uniform(0.12, 0.25)
    return Body(name="thing", shape=shape, motion=motion, texture=texture(place.random, grain))


def walker(place: Place, depth: float, floor: float, speed: float, *, start: float | None = None) -> Body:
    """A person who walks across the view, mostly to the side."""
    random = place.random
    height = random.uniform(1.55, 1.9)
    side = random.sign()
    heading = (0.0 if side > 0 else 180.0) + random.uniform(-25, 25)
    angle = math.radians(heading)
    x = place.at(random.uniform(-0.3, 0.3) if start is None else start, 0, depth)[0]
    velocity = (speed * math.cos(angle), 0.0, -speed * math.sin(angle))
    half = place.duration / 2
    return Body(
        name="person",
        person=Person(
            height=height,
            cadence=round(max(0.3, speed / 1.4), 4),  # a double step is 1.4 m
            swing=random.uniform(24, 34),
            phase=random.uniform(0, 1),
        ),
        motion=Motion(
            position=(x - velocity[0] * half, floor, depth - velocity[2] * half),
            rotation=(0.0, heading, 0.0),
            velocity=velocity,
        ),
        texture=texture(random, 0.07, of=("leaves", "blocks", "stripes", "checker")),
    )
