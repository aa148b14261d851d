"""Motion models, warps, images of warped events, and the fit of one model by contrast maximisation."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from emseg import _core
from emseg.camera import Camera, shared_undistortion_table
from emseg.events import EventArray

__all__ = ["ContrastMeasure", "MotionKind", "MotionModel", "fit_motion", "iwe", "warp"]

MotionKind = Literal["translation", "rotation", "similarity", "affine", "homography"]
ContrastMeasure = Literal["variance", "mean_square", "gradient_magnitude"]

_KEPT_EVENTS: Final = 100_000  # of a fit whose memory, 12 bytes an event and images, is kept for the next


class _Memory(threading.local):
    """What fits only work in, per thread: taking it from the system anew costs a quarter of a fit."""

    def __init__(self) -> None:
        self.fit = _core.FitWorkspace()


_memory = _Memory()

_DOF: Final[dict[str, int]] = {"translation": 2, "rotation": 3, "similarity": 4, "affine": 6, "homography": 8}


@dataclass(frozen=True, eq=False)
class MotionModel:
    """A parametric motion: it brings an event at (x, y), dt seconds after t_ref, to its place at t_ref.

    With c the image centre ((width - 1)/2, (height - 1)/2) and v in px/s:

    ===========  ======================  ==========================================================
    kind         params                  warp
    ===========  ======================  ==========================================================
    translation  vx vy                   x' = x - dt v
    rotation     wx wy wz (rad/s)        f' = exp(-dt [w]x) f on bearing vectors f of the camera
    similarity   vx vy s θ (1/s, rad/s)  x' = x - dt (v + ((1+s) R(θ) - I)(x - c))
    affine       vx vy a11 a12 a21 a22   x' = x - dt (v + A (x - c)), A in 1/s
    homography   affine's, g h (1/s)     x' = x - dt (v + A (x - c) + (x - c) (g, h)·(x - c)/f0)
    ===========  ======================  ==========================================================

    f0 = max(width, height).  Positions are undistorted where a camera is given.  A rotation's w is the
    angular velocity of the scene about the camera; that of a camera turning before a still scene is -w.

    Attributes:
        kind: One of the names above.
        params: float64 (dof,), read-only.
        label: The label of a segmentation that moves so, or None.

    Raises:
        ValueError: an unknown kind, a wrong number of parameters, or one that is not finite.
    """

    kind: MotionKind
    params: npt.NDArray[np.float64]
    label: int | None = None

    def __init__(
        self,
        kind: MotionKind,
        params: Sequence[float] | npt.ArrayLike | None = None,
        label: int | None = None,
    ) -> None:
        if kind not in _DOF:
            known = ", ".join(get_args(MotionKind))
            raise ValueError(f"unknown motion model {kind!r}, expected one of {known}")
        values = np.zeros(_DOF[kind]) if params is None else np.array(params, dtype=np.float64)
        if values.shape != (_DOF[kind],):
            raise ValueError(f"a {kind} has {_DOF[kind]} parameters, got an array of shape {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"the parameters of a {kind} must be finite, got {values.tolist()}")
        values.setflags(write=False)
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "params", values)
        object.__setattr__(self, "label", label)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MotionModel):
            return NotImplemented
        return (self.kind, self.label) == (other.kind, other.label) and np.array_equal(
            self.params, other.params
        )

    def __hash__(self) -> int:
        return hash((self.kind, self.label, self.params.tobytes()))

    def native(self) -> tuple[str, list[float]]:
        """Kind and parameters, as the native engine takes them."""
        return self.kind, self.params.tolist()


def middle_time(events: EventArray) -> int:
    """Middle of the events' time span, µs; 0 without events."""
    return int(events.t[0]) + (int(events.t[-1]) - int(events.t[0])) // 2 if len(events) else 0


def warp_frame(events: EventArray, camera: Camera | None) -> _core.WarpFrame:
    """What warps of these events are relative to.

    Raises:
        ValueError: the camera's size is not the events'.
    """
    if camera is None:
        return _core.WarpFrame(events.width, events.height)
    if (camera.width, camera.height) != (events.width, events.height):
        raise ValueError(
            f"the camera is {camera.width}x{camera.height}, the events' sensor {events.width}x{events.height}"
        )
    return _core.WarpFrame(camera.to_native())


def points(
    events: EventArray, t_ref: int, camera: Camera | None
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Undistorted x and y (px) and time from t_ref (s) of every event, three float32 (n,)."""
    dt = ((events.t - t_ref) * 1e-6).astype(np.float32)
    if camera is None:
        return events.x.astype(np.float32), events.y.astype(np.float32), dt
    table_x, table_y = shared_undistortion_table(camera)
    return table_x[events.y, events.x], table_y[events.y, events.x], dt


def warp(
    events: EventArray, model: MotionModel, t_ref: int | None = None, *, camera: Camera | None = None
) -> npt.NDArray[np.float32]:
    """Bring every event to its place at t_ref.

    Args:
        events: The events, n of them.
        model: Their motion.
        t_ref: Time to warp to, µs; the middle of the events' time span if None.
        camera: Undistorts the events first, and gives rotations their intrinsics.

    Returns:
        Warped x and y, px, float32 (n, 2).

    Raises:
        ValueError: the camera's size is not the events'.
    """
    frame = warp_frame(events, camera)
    x, y, dt = points(events, middle_time(events) if t_ref is None else int(t_ref), camera)
    return _core.warp(x, y, dt, *model.native(), frame)


def warp_some(
    events: EventArray,
    positions: npt.NDArray[np.int64],
    model: MotionModel,
    t_ref: int,
    *,
    camera: Camera | None = None,
) -> npt.NDArray[np.float32]:
    """As `warp`, of the events at some positions, rising or not: float32 (n, 2)."""
    return _core.warp_events(
        events.x,
        events.y,
        events.t,
        positions,
        int(t_ref),
        *model.native(),
        warp_frame(events, camera),
        None if camera is None else shared_undistortion_table(camera),
    )


def undistorted(
    places: npt.NDArray[np.float64], events: EventArray, camera: Camera | None
) -> npt.NDArray[np.float64]:
    """Places on a sensor (n, 2), px, as the camera's model has them: those of the nearest pixels."""
    if camera is None:
        return places
    column, row = np.clip(np.rint(places), 0, (events.width - 1, events.height - 1)).astype(np.intp).T
    tables = shared_undistortion_table(camera)
    return np.column_stack([table[row, column] for table in tables]).astype(np.float64)


def iwe(
    events: EventArray,
    model: MotionModel,
    t_ref: int | None = None,
    sigma: float = 1.0,
    *,
    camera: Camera | None = None,
) -> npt.NDArray[np.float32]:
    """Image of warped events: each event votes with weight 1, shared bilinearly among four pixels.

    Args:
        events: The events.
        model: Their motion.
        t_ref: Time to warp to, µs; the middle of the events' time span if None.
        sigma: Standard deviation of a Gaussian blur, px; 0 for none.
        camera: Undistorts the events first, and gives rotations their intrinsics.

    Returns:
        float32 (height, width); votes outside the sensor are dropped.

    Raises:
        ValueError: sigma outside 0..100, or the camera's size is not the events'.
    """
    frame = warp_frame(events, camera)
    x, y, dt = points(events, middle_time(events) if t_ref is None else int(t_ref), camera)
    return _core.iwe(x, y, dt, *model.native(), frame, events.width, events.height, float(sigma))


def fit_motion(
    events: EventArray,
    kind: MotionKind = "affine",
    *,
    t_ref: int | None = None,
    camera: Camera | None = None,
    sigma: float = 1.0,
    measure: ContrastMeasure = "variance",
    max_speed: float = 5000.0,
    max_scale_rate: float = 5.0,
    max_angle_rate: float = 15.0,
    threads: int = 0,
) -> tuple[MotionModel, float]:
    """The motion that makes the events' image sharpest: contrast maximisation of one model.

    A coarse-to-fine search over velocities, of the whole image and of its parts, gives starts that BFGS with
    the exact gradient refines.

    Args:
        events: The events, taken to move as one.
        kind: Motion model.
        t_ref: Time to warp to, µs; the middle of the events' time span if None.
        camera: Undistorts the events first, and gives rotations their intrinsics.
        sigma: Blur of the image, px.
        measure: What to maximise over the sensor: variance, mean square, or mean squared gradient.
        max_speed: Largest |vx| and |vy|, px/s.
        max_scale_rate: Largest |s|, 1/s; with max_angle_rate also the limit of affine coefficients, and
            the guard against event collapse (Shiba et al., 2022).
        max_angle_rate: Largest |θ|, rad/s.
        threads: 0 takes one per core; the result is the same for any number.

    Returns:
        The model, and the contrast it reaches.

    Raises:
        ValueError: a setting out of range, or the camera's size is not the events'.

    Source: Gallego, Rebecq, Scaramuzza, "A Unifying Contrast Maximization Framework", CVPR 2018.
    """
    frame = warp_frame(events, camera)
    bounds = {"max_speed": max_speed, "max_scale_rate": max_scale_rate, "max_angle_rate": max_angle_rate}
    for name, bound in bounds.items():
        if not 0 <= bound < np.inf or (name == "max_speed" and bound == 0):
            raise ValueError(f"{name} is {bound}, expected a finite number above 0")
    MotionModel(kind)
    x, y, dt = points(events, middle_time(events) if t_ref is None else int(t_ref), camera)
    params, contrast, _ = _core.fit_motion(
        x,
        y,
        dt,
        events.p,
        kind,
        frame,
        events.width,
        events.height,
        sigma=float(sigma),
        measure=measure,
        max_speed=max_speed,
        max_scale_rate=max_scale_rate,
        max_angle_rate=max_angle_rate,
        threads=threads,
        workspace=_memory.fit if len(x) <= _KEPT_EVENTS else None,
    )
    return MotionModel(kind, params), contrast
