"""Which part of a recording is read, and how: what a user may say about a file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, Self

from emseg.events import EventArray
from emseg.filters import Crop, crop_events
from emseg.io import ReadError, open_recording
from emseg.io.recording import Damage

__all__ = ["OpenPart", "Reading"]


@dataclass(frozen=True)
class OpenPart:
    """A part of a recording that is open.

    Attributes:
        sensor: Width and height of the recording's sensor, px.
        size: Width and height of the part, px.
        chunks: Its events in order, which can be walked once.
    """

    sensor: tuple[int, int]
    size: tuple[int, int]
    chunks: Iterator[EventArray]


@dataclass(frozen=True)
class Reading:
    """What is read of a recording.

    Attributes:
        width, height, stream, columns, time_unit, damage: See :func:`emseg.io.open_recording`.
        span: Seconds from the first event, from (inclusive) and to (exclusive); None: all.
        crop: A part of the sensor; None: all of it.
    """

    width: int | None = None
    height: int | None = None
    stream: str | None = None
    columns: str | None = None
    time_unit: Literal["s", "us"] | None = None
    damage: Damage = "refuse"
    span: tuple[float, float] | None = None
    crop: Crop | None = None

    @contextmanager
    def open(self, path: Path) -> Iterator[OpenPart]:
        """The part of a recording.

        Raises:
            ReadError: where it cannot be read, or the crop lies outside its sensor.
        """
        options = {name: getattr(self, name) for name in _OPTIONS}
        with open_recording(path, **options) as recording:
            sensor = size = recording.size
            chunks = recording.chunks(span=self.span)
            if self.crop is not None:
                try:
                    self.crop.check_inside(*sensor)
                except ValueError as error:
                    raise ReadError(path, str(error)) from None
                size = self.crop.width, self.crop.height
                chunks = crop_events(chunks, self.crop)
            yield OpenPart(sensor, size, chunks)

    def read(self, path: Path) -> EventArray:
        """The part's events, all at once."""
        with self.open(path) as part:
            nothing = EventArray([], [], [], [], width=part.size[0], height=part.size[1])
            return EventArray.concatenate([nothing, *part.chunks])

    def to_json(self) -> dict[str, Any]:
        """As JSON can hold it; an open end of the span as None."""
        fields = asdict(self)
        if self.span is not None:
            fields["span"] = [self.span[0], None if self.span[1] == float("inf") else self.span[1]]
        return fields

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> Self:
        """What :meth:`to_json` gave.

        Raises:
            TypeError, ValueError: it did not.
        """
        span, crop = fields["span"], fields["crop"]
        return cls(
            **{name: fields[name] for name in _OPTIONS},
            span=None if span is None else (float(span[0]), float("inf" if span[1] is None else span[1])),
            crop=None if crop is None else Crop(**crop),
        )


_OPTIONS = ("width", "height", "stream", "columns", "time_unit", "damage")
