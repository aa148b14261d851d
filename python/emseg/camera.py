"""Calibrated cameras: intrinsics, lens distortion, undistortion tables and calibration files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from emseg import _core

if TYPE_CHECKING:
    from pathlib import Path

DistortionModel = Literal["radtan", "equidistant"]

_TEXT_FIELDS = "fx fy cx cy k1 k2 p1 p2 k3"


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with lens distortion; pixel centres lie at integer coordinates.

    Attributes:
        width, height: sensor size, px.
        fx, fy: focal lengths, px.
        cx, cy: principal point, px.
        distortion: nothing; radtan `k1 k2 p1 p2 [k3]` (Brown-Conrady, as OpenCV's first five
            coefficients); or equidistant `k1 k2 k3 k4` (Kannala-Brandt, as OpenCV's fisheye module).
        model: None reads coefficients as radtan.

    Raises:
        ValueError: a number is not finite, a size or focal length is not positive, the coefficients do not
            fit the model, or the distortion has no inverse somewhere on the sensor (it folds, or sees
            90 degrees or more off the axis).
    """

    width: int
    height: int
    _: KW_ONLY
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: DistortionModel | None = None

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer):
                raise ValueError(f"camera: {name} is {value!r}, expected a whole number of pixels")
            object.__setattr__(self, name, int(value))
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, _number(name, getattr(self, name)))
        coefficients = tuple(_number("distortion coefficient", value) for value in self.distortion)
        object.__setattr__(self, "distortion", coefficients)
        if self.model is None and coefficients:
            object.__setattr__(self, "model", "radtan")
        counts = {None: (0,), "radtan": (0, 4, 5), "equidistant": (4,)}
        if self.model not in counts:
            raise ValueError(
                f"camera: distortion model is {self.model!r}, expected one of {get_args(DistortionModel)}"
            )
        if len(coefficients) not in counts[self.model]:
            expected = " or ".join(map(str, counts[self.model]))
            raise ValueError(
                f"camera: {len(coefficients)} distortion coefficients, expected {expected} for {self.model}"
            )
        self.to_native()

    @property
    def K(self) -> NDArray[np.float64]:
        """The intrinsic matrix, float64 (3, 3): pixels from rays of unit depth."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)

    def undistortion_table(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Undistorted x and y of every pixel, two float32 arrays (height, width).

        Positions are pixels of a camera with the same intrinsics and no distortion; they may lie outside
        the sensor.
        """
        return self.to_native().undistortion_table()

    def to_native(self) -> _core.Camera:
        """The same camera for the native core, which checks it."""
        return _native(self)

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        *,
        width: int | None = None,
        height: int | None = None,
        name: str | None = None,
    ) -> Camera:
        """Read a calibration: YAML (`.yaml`, `.yml`) or text.

        YAML holds the names of this class; or it is ROS's (`camera_matrix`, as camera_calibration and
        CameraInfo have it), or kalibr's (`cam0` with `intrinsics`, also as DSEC nests it).  Text holds
        `fx fy cx cy k1 k2 p1 p2 k3` on one line, as the calibrations of the Event Camera Dataset do, and no
        size.

        Args:
            path: the file.
            width, height: sensor size, px; needed where the file has none.
            name: which camera of a file of several, such as "cam1"; None: the first.

        Raises:
            OSError: the file cannot be read.
            ValueError: it holds no camera; the message names the file.
        """
        from pathlib import Path  # slow to import, as yaml is

        path = Path(path)
        is_yaml = path.suffix.lower() in (".yaml", ".yml")
        values = _read_yaml(path, name) if is_yaml else _read_text(path)
        for side, value in (("width", width), ("height", height)):
            if value is None:
                continue
            if values.setdefault(side, value) != value:
                raise ValueError(f"{path}: {side} is {values[side]}, but {value} was asked for")
        missing = [key for key in ("width", "height", "fx", "fy", "cx", "cy") if key not in values]
        if missing:
            raise ValueError(f"{path}: {', '.join(missing)} missing")
        try:
            return cls(**values)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from error


@lru_cache(maxsize=16)
def _native(camera: Camera) -> _core.Camera:
    """A camera for the native core, made and checked once; it cannot be changed."""
    return _core.Camera(
        camera.width,
        camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        model=getattr(_core.DistortionModel, camera.model or "none"),
        distortion=[*camera.distortion, *[0.0] * (5 - len(camera.distortion))],
    )


@lru_cache(maxsize=4)
def shared_undistortion_table(camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """As `Camera.undistortion_table`, made once for all who read it."""
    table = camera.undistortion_table()
    for places in table:
        places.setflags(write=False)
    return table


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise ValueError(f"camera: {name} is {value!r}, expected a number")
    return float(value)


def _read_yaml(path: Path, name: str | None) -> dict[str, Any]:
    import yaml  # slow to import, and cameras rarely come from files

    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(document, Mapping):
        raise ValueError(f"{path}: expected a mapping of camera fields, found {type(document).__name__}")
    cameras = _kalibr_cameras(document)
    if cameras:
        chosen = next(iter(cameras)) if name is None else name
        if chosen not in cameras:
            raise ValueError(f"{path}: no camera {chosen!r}, expected one of: {', '.join(cameras)}")
        return _read_kalibr(path, chosen, cameras[chosen])
    if name is not None:
        raise ValueError(f"{path}: no camera {name!r}: the file holds one, without a name")
    if isinstance(document.get("camera_matrix"), Mapping):
        return _read_ros(path, document)
    known = {field.name for field in fields(Camera)}
    unknown = sorted(str(key) for key in document if key not in known)
    if unknown:
        raise ValueError(f"{path}: unknown camera fields {', '.join(unknown)}")
    if not isinstance(document.get("distortion", []), list):
        raise ValueError(f"{path}: distortion is {document['distortion']!r}, expected a list of numbers")
    return dict(document)


# The models of ROS and kalibr, by our names.
_MODELS: dict[str, DistortionModel | None] = {
    "plumb_bob": "radtan",
    "radtan": "radtan",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "none": None,
    "": None,
}


def _distorted(path: Path, model: object, coefficients: list[float]) -> dict[str, Any]:
    name = str(model if model is not None else "none").lower()
    if name not in _MODELS:
        known = ", ".join(key for key in _MODELS if key)
        raise ValueError(f"{path}: distortion_model is {model!r}, expected one of: {known}")
    if _MODELS[name] is None:
        return {"distortion": (), "model": None}
    return {"distortion": tuple(coefficients), "model": _MODELS[name]}


def _numbers(path: Path, key: str, value: object, counts: tuple[int, ...]) -> list[float]:
    expected = " or ".join(map(str, counts))
    if not isinstance(value, list) or (counts and len(value) not in counts):
        raise ValueError(f"{path}: {key} is {value!r}, expected a list of {expected} numbers")
    try:
        # YAML takes 1e-05, as Python writes it, for text: its floats have a point.
        return [_number(key, float(number) if isinstance(number, str) else number) for number in value]
    except ValueError:
        raise ValueError(f"{path}: {key} is {value!r}, expected numbers") from None


def _read_ros(path: Path, document: Mapping[str, Any]) -> dict[str, Any]:
    """ROS's camera_info: a 3x3 matrix by rows, and coefficients."""
    k = _numbers(path, "camera_matrix.data", document["camera_matrix"].get("data"), (9,))
    if k[1] != 0:
        raise ValueError(f"{path}: camera_matrix.data has skew {k[1]:g}, expected 0")
    coefficients = document.get("distortion_coefficients", {"data": []})
    data = coefficients.get("data") if isinstance(coefficients, Mapping) else coefficients
    distortion = _numbers(path, "distortion_coefficients.data", data, (0, 4, 5))
    values: dict[str, Any] = {"fx": k[0], "fy": k[4], "cx": k[2], "cy": k[5]}
    for side in ("width", "height"):
        if f"image_{side}" in document:
            values[side] = document[f"image_{side}"]
    model = document.get("distortion_model", "plumb_bob" if distortion else "none")
    return values | _distorted(path, model, distortion)


def _kalibr_cameras(document: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras of a kalibr camchain, or of DSEC's `cam_to_cam.yaml`, which nests them."""
    nested = document.get("intrinsics")
    chain = nested if isinstance(nested, Mapping) else document
    return {
        str(key): value
        for key, value in chain.items()
        if isinstance(value, Mapping)
        and isinstance(value.get("intrinsics", value.get("camera_matrix")), list)
    }


def _read_kalibr(path: Path, name: str, camera: Mapping[str, Any]) -> dict[str, Any]:
    if camera.get("camera_model", "pinhole") != "pinhole":
        raise ValueError(f"{path}: {name}: camera_model is {camera['camera_model']!r}, expected 'pinhole'")
    key = "intrinsics" if "intrinsics" in camera else "camera_matrix"
    fx, fy, cx, cy = _numbers(path, f"{name}.{key}", camera[key], (4,))
    values: dict[str, Any] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    if "resolution" in camera:
        sides = _numbers(path, f"{name}.resolution", camera["resolution"], (2,))
        values["width"], values["height"] = (int(side) if side == int(side) else side for side in sides)
    coefficients = camera.get("distortion_coeffs", [])
    distortion = _numbers(path, f"{name}.distortion_coeffs", coefficients, (0, 4, 5))
    return values | _distorted(path, camera.get("distortion_model"), distortion)


def _read_text(path: Path) -> dict[str, Any]:
    try:
        numbers = [float(word) for word in path.read_text(encoding="utf-8").split()]
    except ValueError as error:
        raise ValueError(f"{path}: expected the numbers '{_TEXT_FIELDS}': {error}") from error
    if len(numbers) not in (4, 8, 9):
        raise ValueError(
            f"{path}: {len(numbers)} numbers, not '{_TEXT_FIELDS}' (k3 or all coefficients may be absent)"
        )
    values: dict[str, Any] = dict(zip(("fx", "fy", "cx", "cy"), numbers, strict=False))
    values["distortion"] = tuple(numbers[4:])
    return values
