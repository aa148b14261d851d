"""Video: which frames show a segmented recording, and the files that hold them."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, overload

import numpy as np
import numpy.typing as npt

from emseg.events import EventArray
from emseg.render import BOX_DTYPE, Picture, fitting_scale, label_picture, polarity_picture, side_by_side
from emseg.writers import SequenceResult

__all__ = ["Film", "VideoError", "VideoWriter", "film"]

_log = logging.getLogger(__name__)

_FRAMES_PER_S: Final = 30
_SHORTEST_S: Final = 4.0  # shorter recordings are slowed down to this
_SHORTEST_STEP_US: Final = 500
_LONGEST_EXPOSURE_US: Final = 100_000
_LONGER_SIDE: Final = 1280  # px, of both pictures together
_FILLING: Final = 0.04  # events a pixel that a frame should show at least


class VideoError(RuntimeError):
    """A video cannot be written."""


@dataclass(frozen=True)
class Film:
    """The frames that show a recording.

    Attributes:
        frames: The frames in order, RGB uint8 (h, w, 3); each is drawn when it is asked for.
        frames_per_s: Rate at which to show them.
        slowdown: How many times slower than life that is.
    """

    frames: Sequence[Picture]
    frames_per_s: int
    slowdown: float


def film(events: EventArray, result: SequenceResult) -> Film:
    """Events by polarity beside the same events by label, at life's pace or slowed down where that is short.

    A frame shows the events of some time before it (longer where events are few), and boxes that move
    evenly between the windows' reference times.
    """
    if len(events) != len(result.labels):
        raise ValueError(f"{len(events)} events and {len(result.labels)} labels, expected as many")
    duration = max(1, events.duration)
    step = float(np.clip(duration / (_FRAMES_PER_S * _SHORTEST_S), _SHORTEST_STEP_US, 1e6 / _FRAMES_PER_S))
    count = max(1, round(duration / step))
    slowdown = 1e6 / _FRAMES_PER_S / step
    frames = _Frames(events, result, step=step, count=count, slowdown=slowdown)
    return Film(frames, _FRAMES_PER_S, slowdown)


class _Frames(Sequence[Picture]):
    """The frames of a film, each drawn when it is asked for."""

    def __init__(
        self, events: EventArray, result: SequenceResult, *, step: float, count: int, slowdown: float
    ) -> None:
        self._events, self._result = events, result
        self._step, self._count = step, count if len(events) else 1
        enough = _FILLING * events.width * events.height * max(1, events.duration) / max(1, len(events))
        self._exposure = float(np.clip(enough, step, max(step, _LONGEST_EXPOSURE_US)))
        self._scale = fitting_scale(2 * events.width, events.height, longer_side=_LONGER_SIDE)
        self._pace = f"   {slowdown:.3g}× slower" if slowdown > 1.01 else ""

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Picture: ...
    @overload
    def __getitem__(self, index: slice) -> list[Picture]: ...
    def __getitem__(self, index: int | slice) -> Picture | list[Picture]:
        numbers = range(self._count)[index]
        return [self._draw(k) for k in numbers] if isinstance(numbers, range) else self._draw(numbers)

    def _draw(self, k: int) -> Picture:
        events = self._events
        if not len(events):
            blank = polarity_picture(events, caption="no events")
            return side_by_side(blank, blank)
        first = int(events.t[0])
        t_stop = first + round((k + 1) * self._step)
        last = events.duration + first + 1 if k == self._count - 1 else t_stop
        start, stop = np.searchsorted(events.t, [t_stop - round(self._exposure), last])
        shown = events[start:stop]
        boxes = _boxes_at(events, self._result, t_stop - round(self._step / 2))
        seconds = f"t = {(t_stop - first) / 1e6:.3f} s"
        return side_by_side(
            polarity_picture(
                shown, scale=self._scale, caption=f"{seconds}   {len(shown)} events{self._pace}"
            ),
            label_picture(
                shown,
                self._result.labels[start:stop],
                boxes=boxes,
                scale=self._scale,
                caption=f"{seconds}   {len(boxes)} moving",
            ),
        )


def _boxes_at(events: EventArray, result: SequenceResult, t: int) -> npt.NDArray[Any]:
    """The boxes of the window that a time lies in, moved along their tracks to that time."""
    event = int(np.searchsorted(events.t, t, side="right")) - 1
    window = int(np.searchsorted(result.start, event, side="right")) - 1
    if window < 0 or event >= result.stop[window]:
        return np.empty(0, BOX_DTYPE)
    present = result.tracks[result.tracks["window"] == window]
    boxes = np.empty(len(present), BOX_DTYPE)
    for box, row in zip(boxes, present, strict=True):
        path = result.tracks[result.tracks["track"] == row["track"]]
        # Only the windows beside this one: a track may have been lost in between.
        path = path[np.abs(path["window"] - window) <= 1]
        box["track"] = row["track"]
        for name in ("x", "y", "w", "h"):
            box[name] = np.interp(t, path["t_us"], path[name])
    return boxes


class VideoWriter:
    """A video file: H.264 by imageio-ffmpeg, else MPEG-4 by OpenCV with a warning.

    Use as a context manager.  Odd sides are filled up by a pixel, as the encoding wants them even.

    Args:
        path: The file, .mp4.
        frames_per_s: Rate at which the frames are shown.

    Raises:
        VideoError: where neither encoder is installed, or it fails.
    """

    def __init__(self, path: str | Path, *, frames_per_s: int) -> None:
        self.path, self._frames_per_s = Path(path), frames_per_s
        self._size: tuple[int, int] | None = None
        self._h264: Generator[None, Any, None] | None = None
        self._mpeg4: Any = None

    def write(self, frame: Picture) -> None:
        """Add a frame, RGB uint8 (h, w, 3), of the first one's size."""
        frame = np.pad(frame, ((0, frame.shape[0] % 2), (0, frame.shape[1] % 2), (0, 0)), mode="edge")
        size = frame.shape[1], frame.shape[0]
        if self._size is None:
            self._open(size)
        if size != self._size:
            raise ValueError(f"frame is {size}, expected {self._size} as the first")
        if self._h264 is not None:
            try:
                self._h264.send(np.ascontiguousarray(frame))
            except OSError as error:
                self._h264 = None
                raise VideoError(f"{self.path}: the encoder failed: {_last_line(error)}") from None
        else:
            self._mpeg4.write(np.ascontiguousarray(frame[..., ::-1]))  # OpenCV takes BGR

    def _open(self, size: tuple[int, int]) -> None:
        self._size = size
        if importlib.util.find_spec("imageio_ffmpeg") is not None:
            import imageio_ffmpeg

            try:
                self._h264 = imageio_ffmpeg.write_frames(
                    str(self.path),
                    size,
                    fps=self._frames_per_s,
                    codec="libx264",
                    pix_fmt_out="yuv420p",
                    macro_block_size=2,
                    quality=None,
                    output_params=["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart"],
                )
                self._h264.send(None)
            except (RuntimeError, OSError) as error:  # no ffmpeg, or one that cannot
                self._h264 = None
                _log.warning("no H.264 video: %s", _last_line(error))
            else:
                return
        if importlib.util.find_spec("cv2") is None:
            raise VideoError("no video encoder: pip install 'emseg[viz]'")
        import cv2

        _log.warning("%s: written as MPEG-4 by OpenCV, which browsers may not play", self.path.name)
        fourcc = cv2.VideoWriter.fourcc(*"mp4v")
        self._mpeg4 = cv2.VideoWriter(str(self.path), fourcc, float(self._frames_per_s), size)
        if not self._mpeg4.isOpened():
            raise VideoError(f"{self.path}: OpenCV cannot write it")

    def close(self) -> None:
        """Finish the file."""
        if self._h264 is not None:
            self._h264.close()
            self._h264 = None
        if self._mpeg4 is not None:
            self._mpeg4.release()
            self._mpeg4 = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _last_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[-1].strip() if lines else type(error).__name__
