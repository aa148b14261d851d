"""Shapes as flat surfaces: what the renderer draws of a body."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from emseg.simulation.randomness import Random
from emseg.simulation.scene import Ball, Blob, Box, Cylinder, Disc, Mesh, Net, Rectangle, Shape

__all__ = ["FlatSurface", "surfaces_of"]

Floats = NDArray[np.float64]

NO_HARMONICS: Final = ((0.0, 0.0),) * 4


@dataclass(frozen=True)
class FlatSurface:
    """A part of a plane, in the frame of its body.

    Attributes:
        origin: A point of the plane, m.
        axis_u, axis_v: Perpendicular unit vectors in it; it is seen from where their cross product points.
        polygon: Corners u, v, m, convex and anticlockwise from u to v.
        sides: Whether it is seen from one side or from both.
        outline: What of the polygon it covers.
        radius, harmonics: Of a blob.
        pitch, bar: Of a net, m.
        texture_offset: u, v, m, of the texture on the plane.
    """

    origin: tuple[float, float, float]
    axis_u: tuple[float, float, float]
    axis_v: tuple[float, float, float]
    polygon: tuple[tuple[float, float], ...]
    sides: Literal["one", "both"] = "one"
    outline: Literal["polygon", "blob", "net"] = "polygon"
    radius: float = 0.0
    harmonics: tuple[tuple[float, float], ...] = NO_HARMONICS
    pitch: tuple[float, float] = (0.0, 0.0)
    bar: float = 0.0
    texture_offset: tuple[float, float] = (0.0, 0.0)


def surfaces_of(shape: Shape) -> list[FlatSurface]:
    """The surfaces of a shape, whose centre is the frame's origin."""
    match shape:
        case Rectangle():
            return [_sheet(*shape.size)]
        case Net():
            return [replace(_sheet(*shape.size), outline="net", pitch=shape.pitch, bar=shape.bar)]
        case Disc():
            return [_round_sheet(shape.radius, shape.radius, NO_HARMONICS)]
        case Blob():
            return [_blob(shape)]
        case Box():
            return list(_box(shape))
        case Cylinder():
            return list(_cylinder(shape))
        case Ball():
            return list(_ball(shape))
        case Mesh():
            vertices = np.array(shape.vertices)
            return [_face(vertices[list(face)], f"face {number}") for number, face in enumerate(shape.faces)]


def _sheet(width: float, height: float) -> FlatSurface:
    half_width, half_height = width / 2, height / 2
    corners = (
        (-half_width, -half_height),
        (half_width, -half_height),
        (half_width, half_height),
        (-half_width, half_height),
    )
    return FlatSurface((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), corners, sides="both")


def _round_sheet(radius: float, reach: float, harmonics: tuple[tuple[float, float], ...]) -> FlatSurface:
    square = _sheet(2.02 * reach, 2.02 * reach)
    return replace(square, outline="blob", radius=radius, harmonics=harmonics)


def _blob(shape: Blob) -> FlatSurface:
    random = Random("blob", shape.seed)
    raw = [(random.uniform(-1, 1) / order, random.uniform(-1, 1) / order) for order in range(2, 6)]
    total = sum(math.hypot(a, b) for a, b in raw)
    # The outline strays from the circle by no more than the irregularity.
    harmonics = tuple((a * shape.irregularity / total, b * shape.irregularity / total) for a, b in raw)
    return _round_sheet(shape.radius, shape.radius * (1 + shape.irregularity), harmonics)


def _box(shape: Box) -> Iterator[FlatSurface]:
    half = np.array(shape.size) / 2
    side = 1 if shape.seen_from == "outside" else -1
    for axis, sign in itertools.product(range(3), (-1, 1)):
        u_axis, v_axis = (axis + 1) % 3, (axis + 2) % 3
        centre, u, v = np.zeros(3), np.zeros(3), np.zeros(3)
        centre[axis] = sign * half[axis]
        u[u_axis] = 1
        v[v_axis] = sign * side  # so that u x v points to where the face is seen from
        a, b = float(half[u_axis]), float(half[v_axis])
        corners = ((-a, -b), (a, -b), (a, b), (-a, b))
        shift = (1.7 * a * (2 * axis + sign), 2.3 * b * (axis + sign))  # faces show different parts
        yield FlatSurface(_triple(centre), _triple(u), _triple(v), corners, texture_offset=shift)


def _cylinder(shape: Cylinder) -> Iterator[FlatSurface]:
    count = shape.sides
    angles = 2 * np.pi * (np.arange(count + 1) % count) / count
    ring = np.stack([shape.radius * np.cos(angles), np.zeros(count + 1), shape.radius * np.sin(angles)], 1)
    down = np.array([0.0, shape.height / 2, 0.0])
    for k in range(count):
        a, b = ring[k], ring[k + 1]
        face = _face(np.array([a - down, a + down, b + down, b - down]), f"side {k}")
        # The texture runs on from side to side.
        width = float(np.linalg.norm(b - a))
        yield replace(face, texture_offset=(face.texture_offset[0], k * width))
    for end, order in ((-down, 1), (down, -1)):
        flat = FlatSurface(
            _triple(end),
            (1.0, 0.0, 0.0),
            (0.0, 0.0, float(order)),
            _sheet(2.02 * shape.radius, 2.02 * shape.radius).polygon,
        )
        yield replace(flat, outline="blob", radius=shape.radius * math.cos(math.pi / count))


def _ball(shape: Ball) -> Iterator[FlatSurface]:
    golden = (1 + math.sqrt(5)) / 2
    corners = [
        np.roll([0.0, first, second * golden], shift)
        for shift in range(3)
        for first in (-1, 1)
        for second in (-1, 1)
    ]
    points = np.array(corners) / math.hypot(1, golden)
    edge = min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(points, 2))
    triangles = [
        np.array([a, b, c])
        for a, b, c in itertools.combinations(points, 3)
        if max(np.linalg.norm(a - b), np.linalg.norm(b - c), np.linalg.norm(c - a)) < 1.01 * edge
    ]
    for _ in range(shape.detail):
        triangles = [part for triangle in triangles for part in _quarters(triangle)]
    for number, triangle in enumerate(triangles):
        a, b, c = triangle
        outward = np.dot(np.cross(b - a, c - a), a + b + c) > 0
        face = _face(shape.radius * (triangle if outward else triangle[::-1]), f"triangle {number}")
        shift = (0.37 * number * shape.radius, 0.53 * number * shape.radius)
        yield replace(face, texture_offset=shift)


def _quarters(triangle: Floats) -> Iterator[Floats]:
    """A triangle on the unit sphere as four."""
    a, b, c = triangle
    ab, bc, ca = (middle / np.linalg.norm(middle) for middle in (a + b, b + c, c + a))
    for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)):
        yield np.array(corners)


def _face(corners: Floats, name: str) -> FlatSurface:
    """The surface through corners (n, 3) in order, anticlockwise as seen from where it is seen."""
    origin = corners.mean(axis=0)
    u = corners[1] - corners[0]
    length = np.linalg.norm(u)
    normal = np.cross(u, corners[-1] - corners[0])
    size = np.linalg.norm(normal)
    if not length or size < 1e-9 * length**2:
        raise ValueError(f"mesh: {name} has no area, expected corners that are no line")
    u, normal = u / length, normal / size
    v = np.cross(normal, u)
    offsets = corners - origin
    largest = float(np.abs(offsets).max())
    if np.abs(offsets @ normal).max() > 1e-6 * largest:
        raise ValueError(f"mesh: {name} is not flat, expected corners in one plane")
    polygon = tuple((float(offset @ u), float(offset @ v)) for offset in offsets)
    return FlatSurface(_triple(origin), _unit(u), _unit(v), polygon)


def _triple(vector: Floats) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in vector)
    return x, y, z


def _unit(vector: Floats) -> tuple[float, float, float]:
    return _triple(vector / np.linalg.norm(vector))
