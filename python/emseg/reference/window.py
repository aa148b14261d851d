"""A window of events, ready to be warped: positions in pixels, times in seconds from the reference time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emseg.reference.camera import Camera, undistortion_table


@dataclass(frozen=True)
class Region:
    """The pixels x0 .. x0 + width - 1, y0 .. y0 + height - 1 of the image plane."""

    x0: int
    y0: int
    width: int
    height: int


@dataclass(frozen=True)
class ImageFrame:
    """The image plane that events are warped in: its size, its camera, and the point that models turn about.

    Without a camera one of focal length max(width, height), centred on the image, is assumed; it matters to
    rotations only.  `centre` is the image's centre; the published code uses pixel (0, 0).
    """

    width: int
    height: int
    camera: Camera | None = None
    centre: tuple[float, float] | None = None

    @property
    def pivot(self) -> NDArray[np.float64]:
        """The fixed point c of similarity, affine and homography, px, shape (2,)."""
        return np.array(self.centre or ((self.width - 1) / 2, (self.height - 1) / 2))

    @property
    def focal_scale(self) -> float:
        """f0 = max(width, height), px: the unit of normalised coordinates where no camera is needed."""
        return float(max(self.width, self.height))

    @property
    def pinhole(self) -> Camera:
        """The camera, or the assumed one."""
        centre = ((self.width - 1) / 2, (self.height - 1) / 2)
        return self.camera or Camera(self.focal_scale, self.focal_scale, *centre)

    @property
    def sensor(self) -> Region:
        """The pixels of the sensor."""
        return Region(0, 0, self.width, self.height)

    @cached_property
    def image_plane(self) -> Region:
        """The smallest region that holds every undistorted pixel; the sensor where nothing is distorted."""
        if self.camera is None or not any(self.camera.distortion):
            return self.sensor
        places = undistortion_table(self.camera, self.width, self.height)
        x0, y0 = (int(low) for low in np.floor(places.min(axis=(0, 1))))
        x1, y1 = (int(high) for high in np.ceil(places.max(axis=(0, 1))))
        return Region(x0, y0, x1 - x0 + 1, y1 - y0 + 1)

    @property
    def canvas(self) -> Region:
        """How far warped events are followed: the image plane and half as much again on every side.

        So an event that leaves the sensor keeps its vote, and finds its neighbours' votes.
        """
        plane = self.image_plane
        across, down = plane.width // 2, plane.height // 2
        return Region(plane.x0 - across, plane.y0 - down, plane.width + 2 * across, plane.height + 2 * down)


@dataclass(frozen=True)
class Window:
    """Events of one window, in time order.

    position: undistorted place, px, (n, 2).  pixel: place on the sensor, (n, 2).
    dt: seconds since t_ref, (n,).
    """

    position: NDArray[np.float64]
    pixel: NDArray[np.int64]
    dt: NDArray[np.float64]
    frame: ImageFrame

    def __len__(self) -> int:
        return len(self.dt)

    @property
    def duration(self) -> float:
        """Seconds between the first and the last event."""
        return float(self.dt[-1] - self.dt[0]) if len(self) else 0.0

    def select(self, mask: NDArray[np.bool_]) -> Window:
        """The events where mask (n,) is true, in the same order, with the same t_ref."""
        return Window(self.position[mask], self.pixel[mask], self.dt[mask], self.frame)


def make_window(
    x: ArrayLike,
    y: ArrayLike,
    t: ArrayLike,
    *,
    width: int,
    height: int,
    camera: Camera | None = None,
    t_ref: float | None = None,
    centre: tuple[float, float] | None = None,
) -> Window:
    """A window from event columns (n,): x, y in px, t in µs and never falling.

    t_ref in µs, by default the middle between the first and the last event.
    Raises ValueError where times fall or a pixel lies outside the sensor.
    """
    pixel = np.stack([np.asarray(x, dtype=np.int64), np.asarray(y, dtype=np.int64)], axis=-1)
    microseconds = np.asarray(t, dtype=np.float64)
    falls = np.flatnonzero(np.diff(microseconds) < 0)
    if len(falls):
        raise ValueError(f"t falls after event {falls[0]}; expected time order")
    if ((pixel < 0) | (pixel >= [width, height])).any():
        raise ValueError(f"a pixel lies outside the {width} x {height} sensor")
    position = pixel.astype(np.float64)
    if camera is not None and any(camera.distortion):
        position = undistortion_table(camera, width, height)[pixel[:, 1], pixel[:, 0]].astype(np.float64)
    if t_ref is None:
        t_ref = float(microseconds[0] + microseconds[-1]) / 2 if len(microseconds) else 0.0
    return Window(position, pixel, (microseconds - t_ref) * 1e-6, ImageFrame(width, height, camera, centre))
