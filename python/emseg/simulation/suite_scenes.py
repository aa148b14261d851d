"""The scenes of the suite, one function each; see :mod:`emseg.simulation.suite`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from emseg.simulation.ingredients import (
    HD,
    LARGE,
    MEDIUM,
    SMALL,
    Place,
    cards,
    furniture,
    grid,
    mover,
    room,
    sensor,
    texture,
    tuple_of,
    walker,
    wall,
)
from emseg.simulation.motion import Motion, Shake, Wave, Waypoint
from emseg.simulation.randomness import Random
from emseg.simulation.scene import Blob, Body, Box, Flicker, Lighting, Rectangle, Scene

__all__ = ["SCENES"]

Maker = Callable[[Random, float], Scene]
SCENES: Final[dict[str, Maker]] = {}
"""What makes a scene from random numbers and a duration, s, by name."""


def _scene(maker: Maker) -> Maker:
    """Add a scene under its function's name."""
    SCENES[maker.__name__] = maker
    return maker


def _surroundings(place: Place, depth: float, *, clutter: int = 4) -> list[Body]:
    """A wall, or a room, with things in front of it."""
    count = place.random.integer(max(0, clutter - 2), clutter + 2)
    if place.random.chance(0.6):
        return [wall(place, depth), *cards(place, count, (0.6 * depth, 0.95 * depth))]
    inside = room(place, (2.2 * depth, 2.8, depth + 1))
    return [inside, *furniture(place, count, (0.5 * depth, 0.9 * depth), 1.4)]


# --- one camera that stands still -------------------------------------------------------------------------


@_scene
def hands(random: Random, duration: float) -> Scene:
    """A still camera; two hands wave before it, passing each other."""
    place = Place(random, (MEDIUM, MEDIUM, SMALL, LARGE), duration)
    bodies = [wall(place, random.uniform(1.8, 2.5), plenty=False), *cards(place, 2, (1.6, 1.9))]
    for side in (-1, 1):
        depth = 1.1 + 0.1 * side + random.uniform(-0.05, 0.05)
        reach = place.metres(random.uniform(0.2, 0.45), depth)
        waving = Wave(
            amplitude=(reach, reach * random.uniform(-0.6, 0.6), 0.0),
            frequency=random.uniform(0.7, 1.8),
            phase=random.uniform(0, 1),
        )
        turning = Wave(amplitude=(0.0, 0.0, random.uniform(10, 40)), frequency=random.uniform(0.7, 1.8))
        size = place.metres(random.uniform(0.28, 0.4), depth)
        bodies.append(
            Body(
                name="hand",
                shape=Blob(radius=size / 2, irregularity=0.3, seed=random.integer(0, 10**6)),
                motion=Motion(
                    position=place.at(0.4 * side, random.uniform(-0.3, 0.3), depth),
                    waves=(waving,),
                    swings=(turning,),
                ),
                texture=texture(random, size * 0.2, of=("leaves", "blocks", "clouds")),
            )
        )
    return Scene(
        duration=duration, camera=place.camera(place.still()), sensor=sensor(random), bodies=tuple(bodies)
    )


@_scene
def passers_by(random: Random, duration: float) -> Scene:
    """A still camera; people walk by near it, often seen in part, or things pass it: all else stands."""
    place = Place(random, (SMALL, MEDIUM, LARGE, LARGE), duration)
    bodies = [wall(place, random.uniform(4.5, 6.0), plenty=random.chance(0.5))]
    for k in range(random.integer(1, 2)):
        depth = random.uniform(1.6, 3.5) + 0.6 * k
        if random.chance(0.7):
            # The camera's height above the floor: the whole person, or legs, or the upper body.
            bodies.append(walker(place, depth, random.uniform(0.3, 1.5), random.uniform(0.5, 1.8)))
        else:
            motion = place.crossing((40, 300), depth, margin=0.4)
            bodies.append(mover(place, random.uniform(0.3, 1.1), depth, motion))
    return Scene(
        duration=duration,
        camera=place.camera(place.still()),
        sensor=sensor(random, shot_noise=round(random.spread(0.1, 3), 4)),
        bodies=tuple(bodies),
    )


# --- the Extreme Event Dataset ------------------------------------------------------------------------------


@_scene
def fast_drone(random: Random, duration: float) -> Scene:
    """A small fast thing crosses the view of a panning or flying camera."""
    place = Place(random, (SMALL, SMALL, MEDIUM, LARGE), duration)
    motion = place.panning((12, 60)) if random.chance(0.6) else place.flying()
    bodies = _surroundings(place, random.uniform(3, 4.5))
    depth = random.uniform(1.8, 2.4)
    crossing = place.crossing((250, 900), depth, margin=0.3)
    wobble = Wave(
        amplitude=(0.0, place.metres(random.uniform(0.02, 0.08), depth), 0.0), frequency=random.uniform(1, 4)
    )
    drone = mover(
        place,
        random.uniform(0.07, 0.16),
        depth,
        crossing.model_copy(update={"waves": (wobble,)}),
        solid=0.6,
    )
    return Scene(
        duration=duration, camera=place.camera(motion), sensor=sensor(random), bodies=(*bodies, drone)
    )


@_scene
def light_variations(random: Random, duration: float) -> Scene:
    """Flickering lamps over what a hand-held camera sees; things pass behind pillars."""
    scene = _behind_pillars(random, duration, (SMALL, SMALL, MEDIUM))
    flickers = {
        "lamp": Flicker(
            kind=random.choice(("sine", "square")),
            frequency=random.choice((50.0, 60.0, 100.0, 120.0, random.uniform(5, 30))),
            depth=random.uniform(0.1, 0.35),
            phase=random.uniform(0, 1),
        )
    }
    lit = tuple(
        body.model_copy(update={"light": "lamp"}) if random.chance(0.6) else body for body in scene.bodies
    )
    noisy = sensor(random, shot_noise=round(random.spread(0.5, 3), 4))
    return scene.model_copy(update={"bodies": lit, "lighting": Lighting(flickers=flickers), "sensor": noisy})


@_scene
def occlusions(random: Random, duration: float) -> Scene:
    """Things pass behind pillars, which move in the image as the camera does."""
    return _behind_pillars(random, duration, (SMALL, SMALL, MEDIUM, LARGE))


def _behind_pillars(random: Random, duration: float, sensors: tuple[tuple[int, int, float], ...]) -> Scene:
    place = Place(random, sensors, duration)
    bodies = [wall(place, 3.0), *cards(place, random.integer(1, 4), (2.2, 2.9))]
    for x in (-0.6, 0.45):
        depth = random.uniform(0.9, 1.2)
        width = place.metres(random.uniform(0.12, 0.3), depth)
        bodies.append(
            Body(
                name="pillar",
                shape=Rectangle(size=(width, 8.0)),
                motion=Motion(
                    position=place.at(x + random.uniform(-0.2, 0.2), 0, depth),
                    rotation=(0.0, 0.0, random.uniform(-8, 8)),
                ),
                texture=texture(random, width / 4),
            )
        )
    for _ in range(random.integer(1, 2)):
        depth = random.uniform(1.6, 2.1)
        motion = place.crossing((120, 400), depth, margin=0.5)
        bodies.append(mover(place, random.uniform(0.15, 0.35), depth, motion))
    camera = place.sliding((0.1, 0.4)) if random.chance(0.5) else place.hand_held(1.5)
    return Scene(duration=duration, camera=place.camera(camera), sensor=sensor(random), bodies=tuple(bodies))


@_scene
def blinds(random: Random, duration: float) -> Scene:
    """Things pass slats, boards and fences that nearly stand still: straight edges hide motion along them."""
    place = Place(random, (SMALL, SMALL, MEDIUM, LARGE), duration)
    bodies = [wall(place, 3.0), *cards(place, random.integer(1, 3), (2.2, 2.9))]
    turned = 90 if random.chance(0.2) else 0
    for at in (-0.6, 0.1, 0.6)[: random.integer(1, 3)]:
        depth = random.uniform(0.9, 2.3)
        width = place.metres(random.uniform(0.15, 0.5), depth)
        x, y = (0, at) if turned else (at, 0)
        bodies.append(
            Body(
                name="slats",
                shape=Rectangle(size=(width, 8.0)),
                motion=Motion(
                    position=place.at(x + random.uniform(-0.2, 0.2), y, depth),
                    rotation=(0.0, 0.0, turned + random.uniform(-8, 8)),
                ),
                texture=texture(random, width / random.uniform(6, 20), of=("stripes",)),
            )
        )
    depth = random.uniform(1.2, 2.1)
    motion = place.crossing((80, 400), depth, margin=0.5)
    bodies.append(mover(place, random.uniform(0.15, 0.35), depth, motion))
    slow = place.sliding((0.03, 0.2)) if random.chance(0.4) else place.hand_held(random.spread(0.4, 1.5))
    exact = {"threshold_sigma": 0.01, "cutoff": 0.0, "latency_jitter": 0.0} if random.chance(0.6) else {}
    return Scene(
        duration=duration,
        camera=place.camera(slow),
        sensor=sensor(random, **exact),
        bodies=tuple(bodies),
    )


@_scene
def what_is_background(random: Random, duration: float) -> Scene:
    """A net before all, something moving behind it; or a moving thing that hides most of the wall."""
    place = Place(random, (SMALL, SMALL, MEDIUM), duration)
    bodies = [wall(place, 3.2), *cards(place, 2, (2.4, 3.0))]
    if random.chance(0.6):
        bodies.append(grid(place, random.uniform(0.8, 1.1)))
        depth = random.uniform(1.5, 2.2)
        motion = place.crossing((150, 450), depth, margin=0.4)
        bodies.append(mover(place, random.uniform(0.2, 0.4), depth, motion))
    else:
        depth = random.uniform(1.4, 1.8)
        size = (place.metres(1.5, depth), place.metres(0.9, depth))
        velocity = place.velocity(random.spread(60, 200), random.choice((0, 0.5)), depth)
        bodies.append(
            Body(
                name="large thing",
                shape=Rectangle(size=size),
                motion=Motion(
                    position=place.at(random.uniform(-0.3, 0.3), random.uniform(-0.2, 0.2), depth),
                    velocity=velocity,
                ),
                texture=texture(random, size[1] / 10),
            )
        )
    camera = place.hand_held(random.uniform(0.8, 1.6))
    return Scene(duration=duration, camera=place.camera(camera), sensor=sensor(random), bodies=tuple(bodies))


@_scene
def multiple_objects(random: Random, duration: float) -> Scene:
    """Two to eight things, some of which stop and start, enter, leave and pass each other."""
    place = Place(random, (SMALL, MEDIUM, MEDIUM, LARGE, HD), duration)
    count = random.integer(2, 8)
    bodies = _surroundings(place, random.uniform(3.5, 5))
    depths = [1.3 + 0.17 * k for k in range(count)]
    for depth in random.shuffled(depths):
        motion = place.crossing((80, 500), depth, margin=0.9)
        if random.chance(0.35):
            start = random.uniform(0.15, 0.5) * duration
            pause = (start, start + random.uniform(0.25, 0.6) * duration)
            motion = motion.model_copy(update={"pauses": (pause,)})
        bodies.append(mover(place, random.uniform(0.12, 0.3), depth, motion))
    camera = place.any_camera() if random.chance(0.8) else place.still()
    return Scene(duration=duration, camera=place.camera(camera), sensor=sensor(random), bodies=tuple(bodies))


# --- collisions, as in EV-IMO: two things meet and part -----------------------------------------------------


@_scene
def collision_wall(random: Random, duration: float) -> Scene:
    """Before a wall."""
    place = Place(random, (MEDIUM, MEDIUM, LARGE), duration)
    bodies = [wall(place, 2.3), *cards(place, random.integer(1, 4), (1.7, 2.2))]
    return _collision(place, bodies, 1.3, (0.0, 0.0, 0.0))


@_scene
def collision_box(random: Random, duration: float) -> Scene:
    """Before and between boxes that stand still."""
    place = Place(random, (MEDIUM, MEDIUM, LARGE), duration)
    bodies = [room(place, (5.0, 2.6, 4.0), eye_height=1.2), *furniture(place, 5, (1.6, 2.8), 1.2)]
    return _collision(place, bodies, 1.3, (-8.0, 0.0, 0.0))


@_scene
def collision_table(random: Random, duration: float) -> Scene:
    """Above a table, on which things stand."""
    place = Place(random, (MEDIUM, MEDIUM, LARGE), duration)
    top = Body(
        name="table",
        shape=Box(size=(2.4, 0.05, 1.6)),
        motion=Motion(position=(0.0, 0.55, 1.5), rotation=(0.0, random.uniform(-20, 20), 0.0)),
        texture=texture(random, 0.08, plenty=random.chance(0.5), of=("leaves", "blocks", "stripes")),
    )
    bodies = [room(place, (6.0, 2.8, 5.0), eye_height=1.3), top]
    for number in range(random.integer(2, 4)):
        height = random.uniform(0.1, 0.25)
        bodies.append(
            Body(
                name=f"thing on the table {number}",
                shape=Box(size=(0.15, height, 0.12)),
                motion=Motion(
                    position=(random.uniform(-0.7, 0.7), 0.525 - height / 2, random.uniform(1.4, 1.9)),
                    rotation=(0.0, random.uniform(0, 90), 0.0),
                ),
                texture=texture(random, 0.04),
            )
        )
    return _collision(place, bodies, 1.25, (-18.0, 0.0, 0.0))


@_scene
def collision_floor(random: Random, duration: float) -> Scene:
    """Above the floor, seen from above."""
    place = Place(random, (MEDIUM, MEDIUM, LARGE), duration)
    inside = room(place, (7.0, 3.0, 6.0), eye_height=1.6, plenty=random.chance(0.6))
    return _collision(place, [inside, *furniture(place, 2, (1.8, 3), 1.6)], 1.4, (-38.0, 0.0, 0.0))


def _collision(place: Place, bodies: list[Body], depth: float, gaze: tuple[float, float, float]) -> Scene:
    """Two things fly at each other before the camera, meet and bounce off."""
    random = place.random
    meeting = random.uniform(0.35, 0.65) * place.duration
    share = random.uniform(0.25, 0.38)
    size = place.metres(share, depth)
    speed = place.velocity(random.spread(150, 450), 0, depth)[0]
    slope = random.uniform(-0.3, 0.3)
    for side in (-1, 1):
        after = random.uniform(0.3, 0.9) * speed
        moves = []
        for at in (0.0, meeting - 0.02, meeting, meeting + 0.02, place.duration + 0.1):
            gone = speed * (at - meeting) if at < meeting else -after * (at - meeting)
            x = side * (0.5 * size - gone)
            moves.append(Waypoint(at=at, position=(x, slope * x, 0.05 * side)))
        # Waypoints are in the frame of the camera's first gaze.
        frame = Motion(position=(0.0, 0.0, 0.0), rotation=gaze)
        offset = _along(gaze, depth)
        spin = tuple_of(random, 60)
        body = mover(place, share, depth, Motion(), solid=0.5)
        motion = frame.model_copy(
            update={"position": offset, "waypoints": tuple(moves), "spin": spin, "rotation": gaze}
        )
        bodies.append(body.model_copy(update={"motion": motion, "name": f"collider {side}"}))
    hold = place.hand_held(random.uniform(0.7, 1.8))
    camera = hold.model_copy(update={"rotation": gaze})
    return Scene(
        duration=place.duration,
        camera=place.camera(camera),
        sensor=sensor(random),
        bodies=tuple(bodies),
    )


def _along(gaze: tuple[float, float, float], distance: float) -> tuple[float, float, float]:
    """The point at a distance along the gaze of a camera that is pitched by gaze[0] degrees."""
    pitch = math.radians(gaze[0])
    return (0.0, -math.sin(pitch) * distance, math.cos(pitch) * distance)


# --- people -------------------------------------------------------------------------------------------------


@_scene
def slow_cam(random: Random, duration: float) -> Scene:
    """A person walks; the camera moves slowly."""
    place = Place(random, (LARGE, LARGE, MEDIUM), duration)
    return _people(place, place.hand_held(0.35), (0.8, 1.5), 1)


@_scene
def fast_cam(random: Random, duration: float) -> Scene:
    """A person walks; the camera turns fast."""
    place = Place(random, (LARGE, LARGE, MEDIUM), duration)
    swing = place.panning((40, 110))
    shake = Shake(translation=0.03, rotation=1.0, frequency=5, seed=random.integer(0, 10**6))
    return _people(place, swing.model_copy(update={"shake": shake}), (0.8, 1.8), 1)


def _people(place: Place, camera: Motion, speed: tuple[float, float], count: int) -> Scene:
    random = place.random
    floor = 1.0
    depth = random.uniform(4.6, 5.5)
    if random.chance(0.5):
        bodies = [wall(place, depth), *cards(place, random.integer(4, 9), (0.62 * depth, 0.97 * depth))]
    else:
        bodies = [
            room(place, (9.0, 3.2, depth + 1), eye_height=floor),
            *furniture(place, random.integer(2, 5), (0.62 * depth, 0.9 * depth), floor),
        ]
    for k in range(count):
        away = random.uniform(2.7, 3.4) + 0.5 * k
        bodies.append(walker(place, away, floor, random.uniform(*speed)))
    return Scene(
        duration=place.duration, camera=place.camera(camera), sensor=sensor(random), bodies=tuple(bodies)
    )


@_scene
def corridor(random: Random, duration: float) -> Scene:
    """The camera walks down a corridor; someone crosses or comes towards it."""
    place = Place(random, (MEDIUM, MEDIUM, LARGE), duration)
    eye = 1.3
    hall = Body(
        name="corridor",
        shape=Box(size=(random.uniform(2.2, 3.2), 2.6, 16.0), seen_from="inside"),
        motion=Motion(position=(0.0, eye - 1.3, 6.5)),
        texture=texture(random, random.uniform(0.2, 0.4), plenty=random.chance(0.5), of=("leaves", "blocks")),
    )
    doors = [
        Body(
            name=f"door {k}",
            shape=Box(size=(0.06, 2.0, 0.9)),
            motion=Motion(position=(random.sign() * 1.1, eye - 1.0, 3.0 + 2.4 * k + random.uniform(0, 1))),
            texture=texture(random, 0.2, of=("blocks", "stripes")),
        )
        for k in range(3)
    ]
    forward = random.uniform(0.6, 1.6)
    bob = Wave(amplitude=(0.01, 0.02, 0.0), frequency=1.9, phase=random.uniform(0, 1))
    camera = Motion(
        velocity=(0.0, 0.0, forward),
        waves=(bob,),
        shake=Shake(rotation=0.4, frequency=4, seed=random.integer(0, 10**6)),
    )
    people = [
        walker(place, random.uniform(3, 4.2), eye, random.uniform(0.9, 1.5))
        for _ in range(random.integer(1, 2))
    ]
    return Scene(
        duration=duration,
        camera=place.camera(camera),
        sensor=sensor(random),
        bodies=(hall, *doors, *people),
    )


# --- cameras that roll, drive, look through nets; lights that flash -----------------------------------------


@_scene
def roll(random: Random, duration: float) -> Scene:
    """The camera rolls about its axis; two to four things move."""
    place = Place(random, (MEDIUM, SMALL, LARGE), duration)
    bodies = _surroundings(place, 3.0, clutter=5)
    for _ in range(random.integer(2, 4)):
        depth = random.uniform(1.5, 2.2)
        motion = place.crossing((80, 300), depth)
        bodies.append(mover(place, random.uniform(0.15, 0.3), depth, motion))
    rate = random.sign() * random.spread(30, 120)
    camera = Motion(
        spin=(0.0, 0.0, rate), velocity=tuple_of(random, 0.2), rotation=(0.0, 0.0, -rate * duration / 2)
    )
    return Scene(duration=duration, camera=place.camera(camera), sensor=sensor(random), bodies=tuple(bodies))


@_scene
def behind_net(random: Random, duration: float) -> Scene:
    """Something moves behind a net; the camera hardly does."""
    place = Place(random, (SMALL, MEDIUM), duration)
    depth = random.uniform(1.6, 2.2)
    motion = place.crossing((120, 350), depth, margin=0.3)
    bodies = (
        wall(place, 3.0, plenty=False),
        *cards(place, 2, (2.3, 2.8)),
        grid(place, 1.0),
        mover(place, random.uniform(0.2, 0.35), depth, motion),
    )
    camera = place.camera(place.hand_held(0.6))
    return Scene(duration=duration, camera=camera, sensor=sensor(random), bodies=bodies)


@_scene
def car(random: Random, duration: float) -> Scene:
    """From a car on a street: other cars drive, people walk, houses and posts stand."""
    place = Place(random, (LARGE, MEDIUM, HD), duration)
    eye = 1.3
    road = Body(
        name="road",
        shape=Rectangle(size=(60.0, 200.0)),
        motion=Motion(position=(0.0, eye, 80.0), rotation=(90.0, 0.0, 0.0)),
        texture=texture(random, 0.8, plenty=False, of=("leaves", "blocks")),
    )
    bodies = [road]
    for side in (-1, 1):
        for k in range(5):
            width = random.uniform(6, 10)
            bodies.append(
                Body(
                    name="house",
                    shape=Box(size=(8.0, random.uniform(6, 11), width)),
                    motion=Motion(position=(side * random.uniform(10.5, 13), eye - 3.5, 6.0 + 10.5 * k)),
                    texture=texture(random, 1.0, of=("blocks", "checker", "stripes")),
                )
            )
        for k in range(4):
            bodies.append(
                Body(
                    name="post",
                    shape=Box(size=(0.15, 3.5, 0.15)),
                    motion=Motion(position=(side * 5.2, eye - 1.75, 7.0 + 6 * k + random.uniform(0, 3))),
                    texture=texture(random, 0.3, of=("stripes", "leaves")),
                )
            )
    far = Body(
        name="far houses",
        shape=Rectangle(size=(160.0, 30.0)),
        motion=Motion(position=(0.0, eye - 13, 75.0)),
        texture=texture(random, 4.0, of=("blocks",)),
    )
    bodies.append(far)
    for _ in range(random.integer(1, 3)):
        lane, distance = random.choice((-2.8, 0.3, 2.9)), random.uniform(10, 24)
        speed = random.uniform(4, 14) * (-1 if lane < -1 else 1)
        bodies.append(
            Body(
                name="other car",
                shape=Box(size=(1.8, 1.5, 4.2)),
                motion=Motion(position=(lane, eye - 0.85, distance), velocity=(0.0, 0.0, speed)),
                texture=texture(random, 0.35, of=("blocks", "stripes")),
            )
        )
    for _ in range(random.integer(1, 2)):
        bodies.append(walker(place, random.uniform(6.5, 10), eye, random.uniform(1, 1.7)))
    camera = Motion(
        velocity=(0.0, 0.0, random.uniform(3, 9)),
        spin=(0.0, random.uniform(-4, 4), 0.0),
        shake=Shake(rotation=0.08, translation=0.004, frequency=12, seed=random.integer(0, 10**6)),
    )
    return Scene(
        duration=duration,
        camera=place.camera(camera),
        sensor=sensor(random),
        bodies=tuple(bodies),
        lighting=Lighting(sky=0.8),
    )


@_scene
def strobe(random: Random, duration: float) -> Scene:
    """A flashing lamp lights a part of what is seen, or a screen flickers; something moves."""
    place = Place(random, (SMALL, MEDIUM), duration)
    flash = Flicker(
        kind="strobe",
        frequency=random.uniform(4, 15),
        depth=random.uniform(0.35, 0.7),
        duty=random.uniform(0.05, 0.3),
        phase=random.uniform(0, 1),
    )
    bodies = [wall(place, 3.0)]
    bodies += [
        body.model_copy(update={"light": "flash" if random.chance(0.7) else None})
        for body in cards(place, random.integer(3, 5), (2.0, 2.8))
    ]
    if random.chance(0.4):
        bodies[0] = bodies[0].model_copy(update={"light": "flash"})
    for _ in range(random.integer(1, 2)):
        depth = random.uniform(1.4, 1.9)
        motion = place.crossing((120, 400), depth)
        bodies.append(mover(place, random.uniform(0.2, 0.35), depth, motion))
    camera = place.hand_held(random.uniform(0.3, 1.2)) if random.chance(0.8) else place.still()
    return Scene(
        duration=duration,
        camera=place.camera(camera),
        sensor=sensor(random),
        bodies=tuple(bodies),
        lighting=Lighting(flickers={"flash": flash}),
    )
