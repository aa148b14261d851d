"""From the description of a scene to what the native renderer takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emseg import _core
from emseg.simulation.person import parts_of_person
from emseg.simulation.randomness import seed_from
from emseg.simulation.scene import Body, Flicker, Part, Scene, Sensor, Shape, Texture
from emseg.simulation.shapes import FlatSurface, surfaces_of
from emseg.simulation.trajectories import Track

__all__ = ["BuiltScene", "build"]

TEXTURE_SIZE: Final = 512  # texels; textures repeat
TEXELS_PER_GRAIN: Final = 16
LIGHT_SAMPLES_PER_PERIOD: Final = 64
STROBE_EDGES: Final = 20  # samples of the light in a flash


@dataclass(frozen=True)
class BuiltScene:
    """A scene for the native core, and the motions in it.

    Attributes:
        native: What renders and simulates.
        T_world_camera: Path of the camera.
        T_world_objects: Path of each body that is no background, by label.
    """

    native: _core.Scene
    T_world_camera: _core.Path
    T_world_objects: dict[int, _core.Path]


def build(scene: Scene) -> BuiltScene:
    """The scene with all its textures and paths.

    Raises:
        ValueError: where a shape cannot be drawn.
    """
    path = Track.of(scene.camera.motion, scene.duration).to_native()
    native = _core.Scene(scene.camera.to_camera().to_native(), path)
    lighting = scene.lighting
    sun = np.array(lighting.sun) / math.sqrt(sum(part**2 for part in lighting.sun))
    native.set_light(sun=(sun[0], sun[1], sun[2]), ambient=lighting.ambient, sky=lighting.sky)
    lights: dict[str | None, int] = {None: native.add_light(np.ones(1, np.float32), 1.0)}
    for name, flicker in lighting.flickers.items():
        lights[name] = native.add_light(*_brightness(flicker, scene.duration))
    objects: dict[int, _core.Path] = {}
    builder = _Builder(native, scene)
    for number, (body, label) in enumerate(zip(scene.bodies, scene.labels(), strict=True)):
        root = Track.of(body.motion, scene.duration)
        if label > 0:
            objects.setdefault(label, root.to_native())
        builder.add(body, number, label, lights[body.light], root)
    return BuiltScene(native, path, dict(sorted(objects.items())))


class _Builder:
    def __init__(self, native: _core.Scene, scene: Scene) -> None:
        self._native, self._scene = native, scene
        self._textures: dict[Texture, int] = {}

    def add(self, body: Body, number: int, label: int, light: int, root: Track) -> None:
        if body.shape is not None:
            self._add_rigid(body.shape, root, label, light, self._texture(body.texture, number, 0))
            return
        parts = parts_of_person(body.person, body.texture) if body.person is not None else body.parts
        tracks: dict[str | None, Track] = {None: root}
        for index, part in enumerate(parts):
            track = tracks[part.parent] @ Track.of(part.motion, self._scene.duration)
            tracks[part.name] = track
            texture = self._texture(part.texture or body.texture, number, index)
            self._add_rigid(part.shape, track @ _shifted(part), label, light, texture)

    def _add_rigid(self, shape: Shape, track: Track, label: int, light: int, texture: Texture) -> None:
        body = self._native.add_body(track.to_native(), label)
        if texture not in self._textures:
            self._textures[texture] = self._add_texture(texture)
        scale = TEXELS_PER_GRAIN / texture.grain
        for surface in surfaces_of(shape):
            self._add_surface(surface, body, self._textures[texture], scale, light)

    def _add_surface(self, surface: FlatSurface, body: int, texture: int, scale: float, light: int) -> None:
        period = TEXTURE_SIZE / scale
        shift = tuple(scale * math.fmod(offset, period) for offset in surface.texture_offset)
        self._native.add_surface(
            body=body,
            origin=surface.origin,
            axis_u=surface.axis_u,
            axis_v=surface.axis_v,
            polygon=surface.polygon,
            outline=getattr(_core.OutlineKind, surface.outline),
            radius=surface.radius,
            harmonics=surface.harmonics,
            pitch=surface.pitch,
            bar=surface.bar,
            texture=texture,
            texels_per_metre=scale,
            texture_offset=(shift[0], shift[1]),
            light=light,
            two_sided=surface.sides == "both",
        )

    def _texture(self, texture: Texture, body: int, part: int) -> Texture:
        """The texture with a seed."""
        if texture.seed is not None and part == 0:
            return texture
        base = self._scene.seed if texture.seed is None else texture.seed
        return texture.model_copy(update={"seed": seed_from(base, body, part)})

    def _add_texture(self, texture: Texture) -> int:
        assert texture.seed is not None
        return self._native.add_texture(
            kind=getattr(_core.TextureKind, texture.kind),
            grain=float(TEXELS_PER_GRAIN),
            density=texture.density,
            low=texture.low,
            high=texture.high,
            size=TEXTURE_SIZE,
            seed=texture.seed,
        )


def _shifted(part: Part) -> Track:
    """The shape's frame in its part's."""
    return Track(np.array([part.offset]), np.array([[1.0, 0.0, 0.0, 0.0]]))


def _brightness(flicker: Flicker, duration: float) -> tuple[NDArray[np.float32], float]:
    """Samples of a light's brightness and their interval, s."""
    period = 1 / flicker.frequency
    samples = LIGHT_SAMPLES_PER_PERIOD
    if flicker.kind == "strobe":
        samples = max(samples, math.ceil(STROBE_EDGES / flicker.duty))
    interval = period / samples
    step = np.arange(math.ceil(duration / interval) + 2)
    turn = np.mod(step / samples + flicker.phase, 1.0)
    if flicker.kind == "sine":
        on = 0.5 + 0.5 * np.sin(2 * np.pi * turn)
    elif flicker.kind == "square":
        on = (turn < flicker.duty).astype(np.float64)
    else:  # rises and falls within a twentieth of the flash
        edge = flicker.duty / STROBE_EDGES
        on = np.clip(np.minimum(turn / edge, (flicker.duty - turn) / edge), 0, 1)
    gain = 1 - flicker.depth * (1 - on)
    return np.round(gain * 2**20).astype(np.float32) / np.float32(2**20), interval


def native_sensor(sensor: Sensor, seed: int) -> _core.SensorOptions:
    """The sensor's settings for the native core."""
    options = _core.SensorOptions()
    for name, value in sensor.model_dump().items():
        if hasattr(options, name):
            setattr(options, name, value)
    options.seed = seed_from("sensor", seed)
    return options
