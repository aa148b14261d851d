"""
The native core of emseg; the public surface is the emseg package.
"""

from __future__ import annotations

import collections.abc
import typing

import numpy
import numpy.typing

__all__: list[str] = [
    "BackgroundActivityFilter",
    "Camera",
    "ContrastWorkspace",
    "DistortionModel",
    "EventStreamDecoder",
    "EventStreamKind",
    "EvtDecoder",
    "EvtEncoding",
    "FitWorkspace",
    "IweWorkspace",
    "OutlineKind",
    "Path",
    "Scene",
    "Segmentation",
    "Segmenter",
    "SegmenterOptions",
    "SensorOptions",
    "SimulationOptions",
    "TextureKind",
    "WarpFrame",
    "band_expansion",
    "check_events",
    "connected_components",
    "contrast",
    "decode_libcaer_packet",
    "delaunay_edges",
    "delaunay_edges_cgal",
    "event_graph",
    "event_slices",
    "events_beyond",
    "expansion",
    "fit_motion",
    "image_velocities",
    "image_velocity",
    "inner_box",
    "iwe",
    "labeling_energy",
    "max_flow",
    "outer_box",
    "positions_of_values",
    "share_gone",
    "simd_level",
    "simd_levels",
    "split_apart",
    "spread_of_tiles",
    "structure_tensors",
    "take_events",
    "version",
    "warp",
    "warp_events",
    "windows_by_count",
    "windows_by_duration",
    "winners_of_tiles",
]

class DistortionModel:
    """
    Members:

      none

      radtan

      equidistant
    """

    __members__: typing.ClassVar[dict[str, DistortionModel]]
    equidistant: typing.ClassVar[DistortionModel]
    none: typing.ClassVar[DistortionModel]
    radtan: typing.ClassVar[DistortionModel]
    @typing.overload
    def __eq__(self, other: DistortionModel) -> bool: ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool: ...
    def __getstate__(self) -> int: ...
    def __hash__(self) -> int: ...
    def __index__(self) -> int: ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    @typing.overload
    def __ne__(self, other: DistortionModel) -> bool: ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool: ...
    def __repr__(self) -> str: ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __str__(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...

class Camera:
    """
    Intrinsics and lens distortion; emseg.Camera is its public face.
    """
    def __init__(
        self,
        width: typing.SupportsInt | typing.SupportsIndex,
        height: typing.SupportsInt | typing.SupportsIndex,
        *,
        fx: typing.SupportsFloat | typing.SupportsIndex,
        fy: typing.SupportsFloat | typing.SupportsIndex,
        cx: typing.SupportsFloat | typing.SupportsIndex,
        cy: typing.SupportsFloat | typing.SupportsIndex,
        model: DistortionModel,
        distortion: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(5)"
        ],
    ) -> None:
        """
        Raise ValueError where the numbers make no camera.
        """
    def distort_pixel(
        self, x: typing.SupportsFloat | typing.SupportsIndex, y: typing.SupportsFloat | typing.SupportsIndex
    ) -> tuple[float, float]: ...
    def undistort_pixel(
        self, x: typing.SupportsFloat | typing.SupportsIndex, y: typing.SupportsFloat | typing.SupportsIndex
    ) -> tuple[float, float]: ...
    def undistortion_table(
        self,
    ) -> tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float32]]:
        """
        Undistorted x and y of every pixel, two float32 arrays (height, width).
        """

class BackgroundActivityFilter:
    """
    Keeps events with a neighbour not long before them.
    """
    def __init__(
        self,
        width: typing.SupportsInt | typing.SupportsIndex,
        height: typing.SupportsInt | typing.SupportsIndex,
        duration_us: typing.SupportsInt | typing.SupportsIndex,
    ) -> None: ...
    def keep(
        self,
        x: numpy.typing.NDArray[numpy.uint16],
        y: numpy.typing.NDArray[numpy.uint16],
        t: numpy.typing.NDArray[numpy.int64],
        p: numpy.typing.NDArray[numpy.uint8],
    ) -> numpy.typing.NDArray[numpy.uint8]:
        """
        1 for each event of the next chunk that is to stay, else 0, uint8 (n,).
        """

class EvtEncoding:
    """
    How a Prophesee stream is encoded.

    Members:

      evt2

      evt21

      evt21_swapped

      evt3
    """

    __members__: typing.ClassVar[dict[str, EvtEncoding]]
    evt2: typing.ClassVar[EvtEncoding]
    evt21: typing.ClassVar[EvtEncoding]
    evt21_swapped: typing.ClassVar[EvtEncoding]
    evt3: typing.ClassVar[EvtEncoding]
    @typing.overload
    def __eq__(self, other: EvtEncoding) -> bool: ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool: ...
    def __getstate__(self) -> int: ...
    def __hash__(self) -> int: ...
    def __index__(self) -> int: ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    @typing.overload
    def __ne__(self, other: EvtEncoding) -> bool: ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool: ...
    def __repr__(self) -> str: ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __str__(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...

class EvtDecoder:
    """
    Decodes a Prophesee byte stream piece by piece.
    """
    def __init__(self, encoding: EvtEncoding) -> None: ...
    def decode(
        self, bytes: numpy.typing.NDArray[numpy.uint8]
    ) -> tuple[
        numpy.typing.NDArray[numpy.uint16],
        numpy.typing.NDArray[numpy.uint16],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.uint8],
    ]:
        """
        Columns x, y, t (us), p of the events in the next bytes, uint8 (n,).
        """
    @property
    def origin(self) -> int:
        """
        Where the maker's own tools let time begin, us.
        """
    @property
    def pending(self) -> int:
        """
        Bytes of a word whose rest is still to come.
        """

class EventStreamKind:
    """
    What an Event Stream file holds.

    Members:

      dvs

      atis
    """

    __members__: typing.ClassVar[dict[str, EventStreamKind]]
    atis: typing.ClassVar[EventStreamKind]
    dvs: typing.ClassVar[EventStreamKind]
    @typing.overload
    def __eq__(self, other: EventStreamKind) -> bool: ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool: ...
    def __getstate__(self) -> int: ...
    def __hash__(self) -> int: ...
    def __index__(self) -> int: ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    @typing.overload
    def __ne__(self, other: EventStreamKind) -> bool: ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool: ...
    def __repr__(self) -> str: ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __str__(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...

class EventStreamDecoder:
    """
    Decodes an Event Stream piece by piece.
    """
    def __init__(self, kind: EventStreamKind) -> None: ...
    def decode(
        self, bytes: numpy.typing.NDArray[numpy.uint8]
    ) -> tuple[
        numpy.typing.NDArray[numpy.uint16],
        numpy.typing.NDArray[numpy.uint16],
        numpy.typing.NDArray[numpy.int64],
        numpy.typing.NDArray[numpy.uint8],
    ]:
        """
        Columns x, y, t (us), p of the events in the next bytes, uint8 (n,).
        """
    @property
    def pending(self) -> int:
        """
        Bytes of an event whose rest is still to come.
        """

class WarpFrame:
    """
    What warps are relative to: image centre, normalising length, intrinsics.
    """
    @typing.overload
    def __init__(
        self,
        width: typing.SupportsInt | typing.SupportsIndex,
        height: typing.SupportsInt | typing.SupportsIndex,
    ) -> None: ...
    @typing.overload
    def __init__(self, camera: Camera) -> None: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def f0(self) -> float: ...

class IweWorkspace:
    """
    Memory of `iwe`, for one call at a time.
    """
    def __init__(self) -> None: ...

class ContrastWorkspace:
    """
    Memory of `contrast`, for one call at a time.
    """
    def __init__(self) -> None: ...

class FitWorkspace:
    """
    Memory of `fit_motion`, for one call at a time.
    """
    def __init__(self) -> None: ...

class SegmenterOptions:
    """
    Settings of the engine; emseg.Config is their public face.
    """
    def __init__(
        self,
        *,
        data_term: str = "logarithmic",
        lambda_data: typing.SupportsFloat | typing.SupportsIndex = 1.0,
        lambda_smooth: typing.SupportsFloat | typing.SupportsIndex = 24.0,
        lambda_label: typing.SupportsFloat | typing.SupportsIndex | None = None,
        lambda_speed: typing.SupportsFloat | typing.SupportsIndex = 15.0,
        lambda_edge: typing.SupportsFloat | typing.SupportsIndex = 50.0,
        polarity: str = "opposed",
        footprint: str = "scattered",
        flicker: str = "left_out",
        bracket_row: typing.SupportsInt | typing.SupportsIndex = 6,
        bracket_col: typing.SupportsInt | typing.SupportsIndex = 6,
        affine_trans2d_max: typing.SupportsFloat | typing.SupportsIndex = 5000.0,
        affine_scale_max: typing.SupportsFloat | typing.SupportsIndex = 0.5,
        affine_theta_max: typing.SupportsFloat | typing.SupportsIndex = 1.5,
        kinds: collections.abc.Sequence[str] = ["translation", "similarity"],
        num_iter_segmentation: typing.SupportsInt | typing.SupportsIndex = 5,
        num_iter_labeling: typing.SupportsInt | typing.SupportsIndex = 2,
        labelling: str = "bands",
        sigma: typing.SupportsFloat | typing.SupportsIndex = 0.7,
        max_events: typing.SupportsInt | typing.SupportsIndex | None = 60000,
        mark_noise: bool = True,
        threads: typing.SupportsInt | typing.SupportsIndex = 0,
    ) -> None:
        """
        Raise ValueError that names the first setting out of range.
        """
    @property
    def affine_scale_max(self) -> float: ...
    @property
    def affine_theta_max(self) -> float: ...
    @property
    def affine_trans2d_max(self) -> float: ...
    @property
    def bracket_col(self) -> int: ...
    @property
    def bracket_row(self) -> int: ...
    @property
    def data_term(self) -> str: ...
    @property
    def flicker(self) -> str: ...
    @property
    def footprint(self) -> str: ...
    @property
    def kinds(self) -> list[str]: ...
    @property
    def labelling(self) -> str: ...
    @property
    def lambda_data(self) -> float: ...
    @property
    def lambda_edge(self) -> float: ...
    @property
    def lambda_label(self) -> float | None: ...
    @property
    def lambda_smooth(self) -> float: ...
    @property
    def lambda_speed(self) -> float: ...
    @property
    def mark_noise(self) -> bool: ...
    @property
    def max_events(self) -> int | None: ...
    @property
    def num_iter_labeling(self) -> int: ...
    @property
    def num_iter_segmentation(self) -> int: ...
    @property
    def polarity(self) -> str: ...
    @property
    def sigma(self) -> float: ...
    @property
    def threads(self) -> int: ...

class Segmentation:
    """
    What the engine makes of one window.
    """
    @property
    def energy(self) -> int: ...
    @property
    def energy_trace(self) -> list[int]: ...
    @property
    def labels(self) -> numpy.typing.NDArray[numpy.int32]: ...
    @property
    def models(self) -> list[tuple[str, list[float]]]: ...
    @property
    def reference_sharpness(self) -> float: ...
    @property
    def t_ref(self) -> int: ...
    @property
    def thinned(self) -> int: ...
    @property
    def timings(self) -> list[tuple[str, float]]: ...

class Segmenter:
    """
    The engine for one sensor: keeps tables, threads and memory between windows.
    """
    def __init__(
        self,
        width: typing.SupportsInt | typing.SupportsIndex,
        height: typing.SupportsInt | typing.SupportsIndex,
        options: SegmenterOptions,
        camera: Camera | None = None,
        undistortion: tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float32]]
        | None = None,
    ) -> None:
        """
        The camera's undistortion table, where it is made already, saves making it.
        """
    def motion_losses(
        self,
        x: numpy.typing.NDArray[numpy.uint16],
        y: numpy.typing.NDArray[numpy.uint16],
        t: numpy.typing.NDArray[numpy.int64],
        p: numpy.typing.NDArray[numpy.uint8],
        t_ref: typing.SupportsInt | typing.SupportsIndex,
        window: typing.SupportsFloat | typing.SupportsIndex,
        own: tuple[str, collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]],
        other: tuple[str, collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]],
        offsets: collections.abc.Sequence[
            tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex]
        ],
    ) -> list[float]:
        """
        Nats an event that the other motion, moved by each offset (px over the window), loses against the own.
        """
    def segment(
        self,
        x: numpy.typing.NDArray[numpy.uint16],
        y: numpy.typing.NDArray[numpy.uint16],
        t: numpy.typing.NDArray[numpy.int64],
        p: numpy.typing.NDArray[numpy.uint8],
        t_ref: typing.SupportsInt | typing.SupportsIndex | None = None,
        pool: collections.abc.Sequence[
            tuple[str, collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]]
        ] = [],
        candidates: collections.abc.Sequence[
            tuple[str, collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]]
        ] = [],
        tracked: collections.abc.Sequence[
            tuple[
                tuple[str, collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]],
                numpy.typing.NDArray[numpy.float32],
                typing.SupportsFloat | typing.SupportsIndex,
            ]
        ] = [],
    ) -> Segmentation:
        """
        Segment one window.  Models are (kind, parameters); an empty pool is searched for.  Tracked objects are (model, places, px, when they were there, s after t_ref).
        """

class TextureKind:
    """
    Members:

      plain

      leaves

      blocks

      checker

      stripes

      clouds
    """

    __members__: typing.ClassVar[dict[str, TextureKind]]
    blocks: typing.ClassVar[TextureKind]
    checker: typing.ClassVar[TextureKind]
    clouds: typing.ClassVar[TextureKind]
    leaves: typing.ClassVar[TextureKind]
    plain: typing.ClassVar[TextureKind]
    stripes: typing.ClassVar[TextureKind]
    @typing.overload
    def __eq__(self, other: TextureKind) -> bool: ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool: ...
    def __getstate__(self) -> int: ...
    def __hash__(self) -> int: ...
    def __index__(self) -> int: ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    @typing.overload
    def __ne__(self, other: TextureKind) -> bool: ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool: ...
    def __repr__(self) -> str: ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __str__(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...

class OutlineKind:
    """
    Members:

      polygon

      blob

      net
    """

    __members__: typing.ClassVar[dict[str, OutlineKind]]
    blob: typing.ClassVar[OutlineKind]
    net: typing.ClassVar[OutlineKind]
    polygon: typing.ClassVar[OutlineKind]
    @typing.overload
    def __eq__(self, other: OutlineKind) -> bool: ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool: ...
    def __getstate__(self) -> int: ...
    def __hash__(self) -> int: ...
    def __index__(self) -> int: ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    @typing.overload
    def __ne__(self, other: OutlineKind) -> bool: ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool: ...
    def __repr__(self) -> str: ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    def __str__(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...

class SensorOptions:
    """
    Settings of the simulated sensor.
    """
    def __init__(self) -> None: ...
    @property
    def cutoff(self) -> float: ...
    @cutoff.setter
    def cutoff(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def dark_intensity(self) -> float: ...
    @dark_intensity.setter
    def dark_intensity(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def hot_fraction(self) -> float: ...
    @hot_fraction.setter
    def hot_fraction(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def hot_rate(self) -> float: ...
    @hot_rate.setter
    def hot_rate(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def leak(self) -> float: ...
    @leak.setter
    def leak(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def leak_sigma(self) -> float: ...
    @leak_sigma.setter
    def leak_sigma(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def refractory(self) -> float: ...
    @refractory.setter
    def refractory(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def seed(self) -> int: ...
    @seed.setter
    def seed(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> None: ...
    @property
    def shot_noise(self) -> float: ...
    @shot_noise.setter
    def shot_noise(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def shot_noise_bright(self) -> float: ...
    @shot_noise_bright.setter
    def shot_noise_bright(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def threshold_off(self) -> float: ...
    @threshold_off.setter
    def threshold_off(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def threshold_on(self) -> float: ...
    @threshold_on.setter
    def threshold_on(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def threshold_sigma(self) -> float: ...
    @threshold_sigma.setter
    def threshold_sigma(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...

class SimulationOptions:
    """
    Settings of a simulation.
    """
    def __init__(self) -> None: ...
    @property
    def duration(self) -> float: ...
    @duration.setter
    def duration(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def largest_motion(self) -> float: ...
    @largest_motion.setter
    def largest_motion(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def largest_step(self) -> float: ...
    @largest_step.setter
    def largest_step(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def latency_jitter(self) -> float: ...
    @latency_jitter.setter
    def latency_jitter(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def readout_interval(self) -> float: ...
    @readout_interval.setter
    def readout_interval(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def smallest_step(self) -> float: ...
    @smallest_step.setter
    def smallest_step(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None: ...
    @property
    def threads(self) -> int: ...
    @threads.setter
    def threads(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> None: ...

class Path:
    """
    A pose through time, cubic between equidistant samples.
    """
    def __init__(
        self,
        samples: numpy.typing.NDArray[numpy.float64],
        interval: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None:
        """
        Samples float64 (n, 7) of x, y, z, qw, qx, qy, qz from time 0 on, `interval` seconds apart.
        """
    def poses(self, seconds: numpy.typing.NDArray[numpy.float64]) -> numpy.typing.NDArray[numpy.float64]:
        """
        Poses at the given times, float64 (n, 4, 4).
        """

class Scene:
    """
    A scene as the renderer takes it.
    """
    def __init__(self, camera: Camera, T_world_camera: Path) -> None: ...
    def add_body(self, T_world_body: Path, label: typing.SupportsInt | typing.SupportsIndex) -> int:
        """
        Returns its index.
        """
    def add_light(
        self, gain: numpy.typing.NDArray[numpy.float32], interval: typing.SupportsFloat | typing.SupportsIndex
    ) -> int:
        """
        Returns its index.
        """
    def add_surface(
        self,
        *,
        body: typing.SupportsInt | typing.SupportsIndex,
        origin: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"
        ],
        axis_u: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"
        ],
        axis_v: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"
        ],
        polygon: collections.abc.Sequence[
            typing.Annotated[
                collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(2)"
            ]
        ],
        outline: OutlineKind,
        radius: typing.SupportsFloat | typing.SupportsIndex,
        harmonics: typing.Annotated[
            collections.abc.Sequence[
                typing.Annotated[
                    collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(2)"
                ]
            ],
            "FixedSize(4)",
        ],
        pitch: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(2)"
        ],
        bar: typing.SupportsFloat | typing.SupportsIndex,
        texture: typing.SupportsInt | typing.SupportsIndex,
        texels_per_metre: typing.SupportsFloat | typing.SupportsIndex,
        texture_offset: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(2)"
        ],
        light: typing.SupportsInt | typing.SupportsIndex,
        two_sided: bool,
    ) -> int:
        """
        Returns its index.
        """
    def add_texture(
        self,
        *,
        kind: TextureKind,
        grain: typing.SupportsFloat | typing.SupportsIndex,
        density: typing.SupportsFloat | typing.SupportsIndex,
        low: typing.SupportsFloat | typing.SupportsIndex,
        high: typing.SupportsFloat | typing.SupportsIndex,
        size: typing.SupportsInt | typing.SupportsIndex,
        seed: typing.SupportsInt | typing.SupportsIndex,
    ) -> int:
        """
        Returns its index.
        """
    def set_light(
        self,
        *,
        sun: typing.Annotated[
            collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], "FixedSize(3)"
        ],
        ambient: typing.SupportsFloat | typing.SupportsIndex,
        sky: typing.SupportsFloat | typing.SupportsIndex,
    ) -> None: ...
    def simulate(self, sensor: SensorOptions, options: SimulationOptions) -> dict[str, numpy.ndarray]:
        """
        Events as a dict of columns x, y, t (us), p and owner (label of the surface, -1 noise).
        """
    def truth(
        self,
        seconds: numpy.typing.NDArray[numpy.float64],
        interval: typing.SupportsFloat | typing.SupportsIndex,
        threads: typing.SupportsInt | typing.SupportsIndex = 0,
    ) -> dict[str, numpy.ndarray]:
        """
        Images (n, height, width) of what is seen at the given times: intensity, label, depth (m) and the motion in px over the next interval (s).
        """

def band_expansion(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    unary: numpy.typing.NDArray[numpy.int32],
    smooth_cost: typing.SupportsInt | typing.SupportsIndex,
    label_cost: numpy.typing.NDArray[numpy.int64],
    initial: numpy.typing.NDArray[numpy.int32],
) -> tuple[numpy.typing.NDArray[numpy.int32], int]:
    """
    Labels of a window from coarse to fine, and their energy; unary is (labels, events).
    """

def check_events(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
) -> None:
    """
    Raise ValueError at the first event out of order, off the sensor or with a wrong polarity.
    """

def connected_components(occupied: numpy.typing.NDArray[numpy.bool]) -> numpy.typing.NDArray[numpy.int32]:
    """
    Component of every occupied cell, int32 (rows, columns): diagonal neighbours are joined, the one whose first cell comes first is 0; -1 elsewhere.
    """

def contrast(
    x: numpy.typing.NDArray[numpy.float32],
    y: numpy.typing.NDArray[numpy.float32],
    dt: numpy.typing.NDArray[numpy.float32],
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    sigma: typing.SupportsFloat | typing.SupportsIndex = 1.0,
    measure: str = "variance",
    workspace: ContrastWorkspace | None = None,
) -> tuple[float, numpy.typing.NDArray[numpy.float64]]:
    """
    Contrast of the IWE over the sensor and its gradient by the parameters, float64 (dof,).
    """

def decode_libcaer_packet(
    bytes: numpy.typing.NDArray[numpy.uint8],
) -> tuple[
    numpy.typing.NDArray[numpy.uint16],
    numpy.typing.NDArray[numpy.uint16],
    numpy.typing.NDArray[numpy.int64],
    numpy.typing.NDArray[numpy.uint8],
]:
    """
    Columns x, y, t (us since the packet's time base), p of a packet `libcaer_cmp`.
    """

def delaunay_edges(pixels: numpy.typing.NDArray[numpy.int32]) -> numpy.typing.NDArray[numpy.int32]:
    """
    Edges int32 (m, 2) of a Delaunay triangulation of distinct pixels int32 (n, 2) given as x, y.
    """

def delaunay_edges_cgal(pixels: numpy.typing.NDArray[numpy.int32]) -> numpy.typing.NDArray[numpy.int32]:
    """
    The same by CGAL: the oracle and the pace to beat.
    """

def event_graph(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int32]]:
    """
    Space-time graph in compressed rows: indptr int64 (n + 1,), indices int32 (edges,), each edge once.
    """

def event_slices(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    times: numpy.typing.NDArray[numpy.int64],
    width_us: typing.SupportsInt | typing.SupportsIndex,
    shrink: typing.SupportsInt | typing.SupportsIndex,
) -> numpy.typing.NDArray[numpy.uint8]:
    """
    Images of rises, mean time and falls around each time, uint8 (n, 3, height / shrink, width / shrink).
    """

def events_beyond(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    own: numpy.typing.NDArray[numpy.int64],
    along_x: typing.SupportsFloat | typing.SupportsIndex,
    along_y: typing.SupportsFloat | typing.SupportsIndex,
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
) -> float:
    """
    Events of its own sign that an event of a part meets where its motion would bring it if it went on.
    """

@typing.overload
def expansion(
    label_count: typing.SupportsInt | typing.SupportsIndex,
    unary: numpy.typing.NDArray[numpy.int32],
    indptr: numpy.typing.NDArray[numpy.int64],
    indices: numpy.typing.NDArray[numpy.int32],
    weight: numpy.typing.NDArray[numpy.int32],
    label_cost: numpy.typing.NDArray[numpy.int64],
    initial: numpy.typing.NDArray[numpy.int32],
    max_sweeps: typing.SupportsInt | typing.SupportsIndex,
) -> tuple[numpy.typing.NDArray[numpy.int32], int, numpy.typing.NDArray[numpy.int64]]:
    """
    Labels, energy, and the energy before the first sweep and after each; an empty initial starts from the
    cheapest labels.
    """

@typing.overload
def expansion(
    label_count: typing.SupportsInt | typing.SupportsIndex,
    unary: numpy.typing.NDArray[numpy.int64],
    indptr: numpy.typing.NDArray[numpy.int64],
    indices: numpy.typing.NDArray[numpy.int32],
    weight: numpy.typing.NDArray[numpy.int64],
    label_cost: numpy.typing.NDArray[numpy.int64],
    initial: numpy.typing.NDArray[numpy.int32],
    max_sweeps: typing.SupportsInt | typing.SupportsIndex,
) -> tuple[numpy.typing.NDArray[numpy.int32], int, numpy.typing.NDArray[numpy.int64]]:
    """
    Labels, energy, and the energy before the first sweep and after each; an empty initial starts from the
    cheapest labels.
    """

def fit_motion(
    x: numpy.typing.NDArray[numpy.float32],
    y: numpy.typing.NDArray[numpy.float32],
    dt: numpy.typing.NDArray[numpy.float32],
    p: numpy.typing.NDArray[numpy.uint8],
    kind: str,
    frame: WarpFrame,
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    sigma: typing.SupportsFloat | typing.SupportsIndex,
    measure: str,
    max_speed: typing.SupportsFloat | typing.SupportsIndex,
    max_scale_rate: typing.SupportsFloat | typing.SupportsIndex,
    max_angle_rate: typing.SupportsFloat | typing.SupportsIndex,
    threads: typing.SupportsInt | typing.SupportsIndex,
    workspace: FitWorkspace | None = None,
) -> tuple[numpy.typing.NDArray[numpy.float64], float, int]:
    """
    Model of highest contrast: parameters (dof,), contrast, number of evaluations with gradient. A workspace keeps its memory for the next call.
    """

def image_velocities(
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
    places: numpy.typing.NDArray[numpy.float64],
) -> numpy.typing.NDArray[numpy.float64]:
    """
    As image_velocity, of places (n, 2): float64 (n, 2).
    """

def image_velocity(
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
    x: typing.SupportsFloat | typing.SupportsIndex,
    y: typing.SupportsFloat | typing.SupportsIndex,
) -> tuple[float, float]:
    """
    Velocity, px/s, of what lies at an undistorted place, px.
    """

def inner_box(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    own: numpy.typing.NDArray[numpy.int64],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
) -> tuple[float, float, float, float]:
    """
    Left, top, right, bottom of some events' pixels, without the outermost fiftieth on every side.
    """

def iwe(
    x: numpy.typing.NDArray[numpy.float32],
    y: numpy.typing.NDArray[numpy.float32],
    dt: numpy.typing.NDArray[numpy.float32],
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    sigma: typing.SupportsFloat | typing.SupportsIndex,
    workspace: IweWorkspace | None = None,
) -> numpy.typing.NDArray[numpy.float32]:
    """
    Image of warped events, float32 (height, width). A workspace keeps its memory for the next call.
    """

@typing.overload
def labeling_energy(
    label_count: typing.SupportsInt | typing.SupportsIndex,
    unary: numpy.typing.NDArray[numpy.int32],
    indptr: numpy.typing.NDArray[numpy.int64],
    indices: numpy.typing.NDArray[numpy.int32],
    weight: numpy.typing.NDArray[numpy.int32],
    label_cost: numpy.typing.NDArray[numpy.int64],
    labels: numpy.typing.NDArray[numpy.int32],
) -> int:
    """
    Data, Potts and label costs of a labelling.
    """

@typing.overload
def labeling_energy(
    label_count: typing.SupportsInt | typing.SupportsIndex,
    unary: numpy.typing.NDArray[numpy.int64],
    indptr: numpy.typing.NDArray[numpy.int64],
    indices: numpy.typing.NDArray[numpy.int32],
    weight: numpy.typing.NDArray[numpy.int64],
    label_cost: numpy.typing.NDArray[numpy.int64],
    labels: numpy.typing.NDArray[numpy.int32],
) -> int:
    """
    Data, Potts and label costs of a labelling.
    """

def max_flow(
    tail: numpy.typing.NDArray[numpy.int32],
    head: numpy.typing.NDArray[numpy.int32],
    capacity: numpy.typing.NDArray[numpy.int64],
    reverse: numpy.typing.NDArray[numpy.int64],
    source: numpy.typing.NDArray[numpy.int64],
    sink: numpy.typing.NDArray[numpy.int64],
) -> tuple[int, numpy.typing.NDArray[numpy.uint8]]:
    """
    Value of a maximum flow, and 1 for every node on the sink's side of the minimum cut.
    """

def outer_box(places: numpy.typing.NDArray[numpy.float32]) -> tuple[float, float, float, float]:
    """
    Left, top, right, bottom of places (n, 2), without the outermost hundredth on every side.
    """

def positions_of_values(
    values: numpy.typing.NDArray[numpy.int32], count: typing.SupportsInt | typing.SupportsIndex
) -> list[numpy.typing.NDArray[numpy.int64]]:
    """
    Where each of the values 0 .. count-1 stands, int64, rising.
    """

def share_gone(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    own: numpy.typing.NDArray[numpy.int64],
    along_x: typing.SupportsFloat | typing.SupportsIndex,
    along_y: typing.SupportsFloat | typing.SupportsIndex,
) -> float:
    """
    How far some events went, as a share of the displacement, px, that their motion says.
    """

def simd_level() -> str:
    """
    Level of instructions in use: the processor's highest, or a lower one that EMSEG_SIMD names.
    """

def simd_levels() -> list[str]:
    """
    Levels that this processor runs, ascending.
    """

def split_apart(
    places: numpy.typing.NDArray[numpy.float32], gap: typing.SupportsInt | typing.SupportsIndex
) -> numpy.typing.NDArray[numpy.int32]:
    """
    Part of every place (n, 2), int32 (n,): parts lie more than about `gap` px apart, the largest is 0; -1 for crumbs.
    """

def spread_of_tiles(held: numpy.typing.NDArray[numpy.bool]) -> float:
    """
    How much of the view tiles span by their second moments: 1 for all of it.
    """

def structure_tensors(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    side: typing.SupportsInt | typing.SupportsIndex,
) -> numpy.typing.NDArray[numpy.float64]:
    """
    Structure tensors xx, xy, yy of square tiles, float64 (rows, columns, 3), of signed images of events.
    """

def take_events(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    p: numpy.typing.NDArray[numpy.uint8],
    positions: numpy.typing.NDArray[numpy.int64],
) -> tuple[
    numpy.typing.NDArray[numpy.uint16],
    numpy.typing.NDArray[numpy.uint16],
    numpy.typing.NDArray[numpy.int64],
    numpy.typing.NDArray[numpy.uint8],
]:
    """
    Columns x, y, t and p of the events at rising positions. Raise IndexError or ValueError at the first wrong one.
    """

def warp(
    x: numpy.typing.NDArray[numpy.float32],
    y: numpy.typing.NDArray[numpy.float32],
    dt: numpy.typing.NDArray[numpy.float32],
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
) -> numpy.typing.NDArray[numpy.float32]:
    """
    Warped positions, float32 (n, 2).
    """

def warp_events(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    own: numpy.typing.NDArray[numpy.int64],
    t_ref: typing.SupportsInt | typing.SupportsIndex,
    kind: str,
    params: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex],
    frame: WarpFrame,
    undistorted: tuple[numpy.typing.NDArray[numpy.float32], numpy.typing.NDArray[numpy.float32]]
    | None = None,
) -> numpy.typing.NDArray[numpy.float32]:
    """
    Warped places of the events at the positions `own`, float32 (n, 2).
    """

def windows_by_count(
    event_count: typing.SupportsInt | typing.SupportsIndex, count: typing.SupportsInt | typing.SupportsIndex
) -> numpy.typing.NDArray[numpy.int64]:
    """
    Bounds int64 (k, 2) of successive windows of `count` events; the last holds the rest.
    """

def windows_by_duration(
    t: numpy.typing.NDArray[numpy.int64], duration_us: typing.SupportsInt | typing.SupportsIndex
) -> numpy.typing.NDArray[numpy.int64]:
    """
    Bounds int64 (k, 2) of the windows [t0 + k d, t0 + (k+1) d) that hold events.
    """

def winners_of_tiles(
    x: numpy.typing.NDArray[numpy.uint16],
    y: numpy.typing.NDArray[numpy.uint16],
    t: numpy.typing.NDArray[numpy.int64],
    groups: collections.abc.Sequence[numpy.typing.NDArray[numpy.int64]],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
    side: typing.SupportsInt | typing.SupportsIndex,
) -> numpy.typing.NDArray[numpy.int32]:
    """
    Which group has most events in each tile, int32 (rows, columns); -1 where none has more than two.
    """

version: str = "0.1.0"
