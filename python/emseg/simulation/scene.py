"""Scenes as plain data: frozen, typed, YAML both ways.

Frames: a camera looks along its z axis, x to the right, y down; the world is the frame of a camera that
stands upright, so that gravity points along y.  Positions are in metres, times in seconds, rotations are
rotation vectors in degrees, reflectances lie between 0 and 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import yaml
from pydantic import Field, ValidationError, model_validator

from emseg.camera import Camera
from emseg.simulation.motion import ZERO, Description, Motion, NotNegative, Positive, Vector
from emseg.yaml_files import ConfigError, nearest, read_yaml

__all__ = [
    "Ball",
    "Blob",
    "Body",
    "Box",
    "CameraDescription",
    "Cylinder",
    "Disc",
    "Flicker",
    "Lighting",
    "Mesh",
    "Net",
    "Part",
    "Person",
    "Rectangle",
    "Scene",
    "Sensor",
    "Shape",
    "Texture",
    "TruthRate",
]

LARGEST_SENSOR: Final = 4096  # px each way

Share = Annotated[float, Field(ge=0, le=1)]
Pair = Annotated[tuple[Positive, Positive], Field(strict=False)]


class Texture(Description):
    """What a surface shows.

    Attributes:
        kind: plain; leaves (overlapping discs); blocks (overlapping rectangles); checker; stripes; clouds.
        grain: Size of its features, m.
        density: For leaves and blocks, how often the features would cover the surface, lying side by side.
        low, high: Range of reflectance, spread evenly in its logarithm.
        seed: None: from the scene's seed and the body's place in it.
    """

    kind: Literal["plain", "leaves", "blocks", "checker", "stripes", "clouds"] = "leaves"
    grain: Positive = 0.1
    density: Annotated[float, Field(ge=0, le=10)] = 2.0
    low: Annotated[float, Field(gt=0, le=1)] = 0.12
    high: Annotated[float, Field(gt=0, le=1)] = 0.9
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None

    @model_validator(mode="after")
    def _range_rises(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"low is {self.low} and high is {self.high}, expected low ≤ high")
        return self


class Rectangle(Description):
    """A flat rectangle that faces along -z, seen from both sides."""

    kind: Literal["rectangle"] = "rectangle"
    size: Pair


class Disc(Description):
    """A flat disc that faces along -z, seen from both sides."""

    kind: Literal["disc"] = "disc"
    radius: Positive


class Blob(Description):
    """A flat shape with a wavy outline, seen from both sides."""

    kind: Literal["blob"] = "blob"
    radius: Positive
    irregularity: Annotated[float, Field(ge=0, le=0.5)] = 0.2  # of the outline, as a share of the radius
    seed: Annotated[int, Field(ge=0)] = 0


class Net(Description):
    """Bars of a grid in a flat rectangle; a pitch of zero along an axis leaves its bars out: a fence."""

    kind: Literal["net"] = "net"
    size: Pair
    pitch: Annotated[tuple[NotNegative, NotNegative], Field(strict=False)]
    bar: Positive

    @model_validator(mode="after")
    def _bars_fit(self) -> Self:
        if any(0 < pitch <= self.bar for pitch in self.pitch) or not any(self.pitch):
            raise ValueError(f"pitch is {self.pitch} with bars of {self.bar} m, expected pitch > bar or 0")
        return self


class Box(Description):
    """A box; with `seen_from: inside` a room."""

    kind: Literal["box"] = "box"
    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    seen_from: Literal["outside", "inside"] = "outside"


class Cylinder(Description):
    """A prism with many sides, its axis along y."""

    kind: Literal["cylinder"] = "cylinder"
    radius: Positive
    height: Positive
    sides: Annotated[int, Field(ge=3, le=64)] = 12


class Ball(Description):
    """An icosahedron whose faces are divided `detail` times: 20, 80 or 320 triangles."""

    kind: Literal["ball"] = "ball"
    radius: Positive
    detail: Annotated[int, Field(ge=0, le=2)] = 1


class Mesh(Description):
    """Flat convex faces between vertices, each seen from one side.

    A face lists 3 to 8 vertices in such an order that cross(second - first, last - first) points to where it
    is seen from.
    """

    kind: Literal["mesh"] = "mesh"
    vertices: Annotated[tuple[Vector, ...], Field(strict=False, min_length=3)]
    faces: Annotated[
        tuple[Annotated[tuple[int, ...], Field(strict=False, min_length=3, max_length=8)], ...],
        Field(strict=False, min_length=1),
    ]

    @model_validator(mode="after")
    def _indices_exist(self) -> Self:
        for number, face in enumerate(self.faces):
            for index in face:
                if not 0 <= index < len(self.vertices):
                    last = len(self.vertices) - 1
                    raise ValueError(f"face {number} names vertex {index}, expected 0..{last}")
        return self


Shape = Annotated[Rectangle | Disc | Blob | Net | Box | Cylinder | Ball | Mesh, Field(discriminator="kind")]


class Part(Description):
    """A part of an articulated body; its motion is relative to its parent's frame, or to the body's.

    `position` of the motion is where the joint is in the parent; `offset` where the shape's centre is from
    the joint.
    """

    name: Annotated[str, Field(min_length=1)]
    shape: Shape
    parent: str | None = None
    motion: Motion = Motion()
    offset: Vector = ZERO
    texture: Texture | None = None  # None: the body's


class Person(Description):
    """A walking person of ten parts: legs and arms swing about hips, knees, shoulders and elbows.

    Stands on y = 0 of the body's frame and faces along its x axis; the body's motion carries it forward.
    """

    height: Annotated[float, Field(gt=0.1, le=5)] = 1.75  # m
    cadence: NotNegative = 0.95  # Hz, double steps; 0: stands
    swing: Annotated[float, Field(ge=0, le=80)] = 30.0  # degrees, of the thighs
    phase: float = 0.0  # turns


class Body(Description):
    """Something rigid or articulated; exactly one of shape, parts and person.

    `label` is the owner of its events: 0 background, 1.. objects.  None: 0 if it never moves, else the next
    number.
    """

    name: str = ""
    shape: Shape | None = None
    parts: Annotated[tuple[Part, ...], Field(strict=False)] = ()
    person: Person | None = None
    motion: Motion = Motion()
    texture: Texture = Texture()
    light: str | None = None  # name of a flicker; None: steady
    label: Annotated[int, Field(ge=0, le=127)] | None = None

    @model_validator(mode="after")
    def _one_figure(self) -> Self:
        given = [name for name in ("shape", "parts", "person") if getattr(self, name)]
        if len(given) != 1:
            raise ValueError(f"{' and '.join(given) or 'none'} given, expected one of shape, parts, person")
        names: set[str] = set()
        for part in self.parts:
            if part.parent is not None and part.parent not in names:
                raise ValueError(f"part '{part.name}' hangs on '{part.parent}', expected an earlier part")
            if part.name in names:
                raise ValueError(f"there are two parts '{part.name}'")
            names.add(part.name)
        return self

    @property
    def is_still(self) -> bool:
        """Whether nothing of it moves."""
        walks = self.person is not None and self.person.cadence > 0
        return self.motion.is_still and not walks and all(part.motion.is_still for part in self.parts)


class CameraDescription(Description):
    """The camera: its sensor, lens and motion.  Give fx and fy, or the field of view."""

    width: Annotated[int, Field(ge=8, le=LARGEST_SENSOR)] = 346
    height: Annotated[int, Field(ge=8, le=LARGEST_SENSOR)] = 260
    field_of_view: Annotated[float, Field(gt=1, lt=170)] | None = None  # degrees, horizontal; None: 65
    fx: Positive | None = None
    fy: Positive | None = None
    cx: float | None = None  # None: the middle
    cy: float | None = None
    distortion: Annotated[tuple[float, ...], Field(strict=False, max_length=5)] = ()
    model: Literal["radtan", "equidistant"] | None = None
    motion: Motion = Motion()

    @model_validator(mode="after")
    def _focal_length_once(self) -> Self:
        if self.field_of_view is not None and (self.fx is not None or self.fy is not None):
            raise ValueError("field_of_view and fx or fy given, expected one of them")
        self.to_camera()
        return self

    def to_camera(self) -> Camera:
        """The same as :class:`emseg.Camera`."""
        wide = math.radians(65.0 if self.field_of_view is None else self.field_of_view)
        fx = self.fx if self.fx is not None else self.fy
        if fx is None:
            fx = round(self.width / 2 / math.tan(wide / 2), 6)
        return Camera(
            self.width,
            self.height,
            fx=fx,
            fy=self.fy if self.fy is not None else fx,
            cx=self.cx if self.cx is not None else (self.width - 1) / 2,
            cy=self.cy if self.cy is not None else (self.height - 1) / 2,
            distortion=self.distortion,
            model=self.model,
        )


class Flicker(Description):
    """A light whose brightness changes periodically, down from 1 by `depth`.

    sine: as lamps on the mains; square: on for the share `duty` of the period; strobe: flashes of that share,
    with edges of a twentieth of it.
    """

    kind: Literal["sine", "square", "strobe"] = "sine"
    frequency: Annotated[float, Field(gt=0, le=2000)]
    depth: Annotated[float, Field(ge=0, lt=1)] = 0.3
    duty: Annotated[float, Field(gt=0, lt=1)] = 0.5
    phase: float = 0.0  # turns


class Lighting(Description):
    """Light: from everywhere and from a sun; flickering lights by name, for bodies that ask for them."""

    ambient: Share = 0.65
    sun: Vector = (0.3, 0.7, 0.65)  # the way it shines
    sky: Share = 0.5  # intensity where there is no surface
    flickers: dict[str, Flicker] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _sun_shines(self) -> Self:
        if self.sun == ZERO:
            raise ValueError("sun is the zero vector, expected a direction")
        return self


class Sensor(Description):
    """The sensor; names and defaults are the native ones, see docs/simulation.md for their meaning."""

    threshold_on: Positive = 0.25
    threshold_off: Positive = 0.25
    threshold_sigma: NotNegative = 0.03
    refractory: NotNegative = 1e-3
    cutoff: NotNegative = 0.0
    dark_intensity: Positive = 0.02
    shot_noise: NotNegative = 0.0
    shot_noise_bright: Share = 0.25
    leak: NotNegative = 0.0
    leak_sigma: Share = 0.2
    hot_fraction: Share = 0.0
    hot_rate: NotNegative = 50.0
    latency_jitter: NotNegative = 0.0
    readout_interval: NotNegative = 0.0

    @classmethod
    def ideal(cls) -> Self:
        """Equal pixels without noise and refractory time: for checks."""
        return cls(threshold_sigma=0.0, refractory=0.0)


class TruthRate(Description):
    """How often the truth is given."""

    interval: Annotated[float, Field(gt=0, le=10)] = 0.01  # s, of masks, depth, flow and poses
    imu_rate: Annotated[float, Field(gt=0, le=2000)] = 200.0  # Hz


class Scene(Description):
    """A scene: everything that `emseg simulate` needs to know.

    The same scene gives the same bytes.

    Raises:
        pydantic.ValidationError: a ValueError that names the field and what was expected.
    """

    name: str = "scene"
    duration: Annotated[float, Field(gt=0, le=3600)] = 1.0  # s
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    camera: CameraDescription = CameraDescription()
    sensor: Sensor = Sensor()
    lighting: Lighting = Lighting()
    truth: TruthRate = TruthRate()
    bodies: Annotated[tuple[Body, ...], Field(strict=False, min_length=1)]

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, values: Any) -> Any:
        if isinstance(values, Mapping):
            for key in values:
                if key not in cls.model_fields:
                    raise ValueError(f"{key}: unknown key{nearest(str(key), cls.model_fields)}")
        return values

    @model_validator(mode="after")
    def _lights_exist(self) -> Self:
        for number, body in enumerate(self.bodies):
            if body.light is not None and body.light not in self.lighting.flickers:
                known = ", ".join(self.lighting.flickers) or "none"
                raise ValueError(f"bodies.{number}.light is '{body.light}', expected a flicker of: {known}")
        return self

    def labels(self) -> tuple[int, ...]:
        """The label of each body: as given, 0 if it never moves, else the next number that is free."""
        taken = {body.label for body in self.bodies}
        free = (number for number in range(1, 10**6) if number not in taken)
        return tuple(
            body.label if body.label is not None else 0 if body.is_still else next(free)
            for body in self.bodies
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, origin: str = "scene") -> Self:
        """A scene from plain data.

        Args:
            values: As YAML holds them.
            origin: What to call them in an error.

        Raises:
            ConfigError: naming the origin, the place in it and what was expected, in one line.
        """
        try:
            return cls(**values)
        except ValidationError as error:
            raise ConfigError(f"{origin}: {_first_problem(error)}") from None

    @classmethod
    def from_yaml(cls, path: str | PathLike[str]) -> Self:
        """A scene from a YAML file; without a name it takes the file's.

        Raises:
            ConfigError: naming the file, the place in it and what was expected, in one line.
        """
        values = read_yaml(path)
        values.setdefault("name", Path(path).stem)
        return cls.from_mapping(values, origin=str(path))

    def to_yaml(self) -> str:
        """This scene as YAML, without what is at its default."""
        values = _plain(self.model_dump(mode="json", exclude_defaults=True))
        # The kind of a shape is its default, but tells which shape it is.
        for body, described in zip(self.bodies, values["bodies"], strict=True):
            if body.shape is not None:
                described["shape"]["kind"] = body.shape.kind
            for part, of in zip(body.parts, described.get("parts", ()), strict=True):
                of["shape"]["kind"] = part.shape.kind
        text: str = yaml.safe_dump(values, sort_keys=False, default_flow_style=None, width=110)
        return text


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value


def _first_problem(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(step) for step in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message = "unknown key"
    given = first["input"]
    shown = f", not {given!r}" if isinstance(given, str | int | float | list | None) else ""
    if first["type"] in ("extra_forbidden", "value_error"):
        shown = ""
    return f"{place}: {message}{shown}" if place else message
