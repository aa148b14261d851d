"""The commands that deal with recordings as such: `emseg info` and `emseg convert`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from emseg.events import EventArray

__all__ = [
    "Columns",
    "CropOption",
    "KeepGoing",
    "Size",
    "Span",
    "Stream",
    "Unit",
    "convert",
    "info",
    "open_options",
    "parse_crop",
    "parse_span",
]

DONE: Final = 0
FAILED: Final = 1


class TimeUnit(StrEnum):
    """Unit of times in a file."""

    s = "s"
    us = "us"


class Filter(StrEnum):
    """What can be left out of a recording."""

    noise = "noise"
    hot = "hot"


KeepGoing = Annotated[
    bool, typer.Option("--keep-going", help="Keep what can be read of damaged files, and say what is lost.")
]
Size = Annotated[
    str | None, typer.Option("--size", metavar="WxH", help="Size of the sensor, px, if the file lacks it.")
]
Stream = Annotated[
    str | None, typer.Option("--stream", help="Event stream (topic, group, …) where there are several.")
]
Columns = Annotated[
    str | None, typer.Option("--columns", metavar="txyp", help="Order of the columns of text without header.")
]
Unit = Annotated[TimeUnit | None, typer.Option("--time-unit", help="Unit of times that do not tell theirs.")]
Span = Annotated[str | None, typer.Option("--span", metavar="FROM:TO", help="Seconds from the first event.")]
CropOption = Annotated[
    str | None, typer.Option("--crop", metavar="X,Y,W,H", help="Only a part of the sensor, px.")
]


def open_options(
    keep_going: bool, size: str | None, stream: str | None, columns: str | None, unit: TimeUnit | None
) -> dict[str, Any]:
    """Keyword arguments of :func:`emseg.io.open_recording`."""
    from emseg.io import ReadOptions

    sides = _parse_size(size)
    time_unit: Literal["s", "us"] | None = None if unit is None else unit.value
    try:
        ReadOptions(columns=columns, time_unit=time_unit)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--columns") from None
    return {
        "width": sides[0] if sides else None,
        "height": sides[1] if sides else None,
        "stream": stream,
        "columns": columns,
        "time_unit": time_unit,
        "damage": "keep" if keep_going else "refuse",
    }


def _parse_size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    sides = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(1 <= side <= 65536 for side in sides):
        raise typer.BadParameter(f"size is {text!r}, expected such as 346x260", param_hint="--size")
    return sides


def parse_span(text: str | None) -> tuple[float, float] | None:
    """Seconds from and to, of which either may be left out: 0.5:2, :2, 0.5:."""
    if text is None:
        return None
    from emseg.io.recording import check_span

    try:
        start, _, stop = text.partition(":") if ":" in text else ("x", "", "")
        span = float(start or 0), float(stop or "inf")
        check_span(span)
    except ValueError:
        problem = f"span is {text!r}, expected seconds from the first event such as 0.5:2 or 0.5:"
        raise typer.BadParameter(problem, param_hint="--span") from None
    return span


def parse_crop(text: str | None) -> Any:
    """A part of the sensor: X,Y,WIDTH,HEIGHT in px."""
    if text is None:
        return None
    from emseg.filters import Crop

    match = re.fullmatch(r"(\d{1,5}),(\d{1,5}),(\d{1,5}),(\d{1,5})", text.replace(" ", ""))
    try:
        if match is None:
            raise ValueError(f"crop is {text!r}, expected X,Y,WIDTH,HEIGHT in px")
        return Crop(*(int(number) for number in match.groups()))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--crop") from None


def info(
    inputs: Annotated[list[Path], typer.Argument(metavar="IN...", help="Recordings.")],
    keep_going: KeepGoing = False,
    size: Size = None,
    stream: Stream = None,
    columns: Columns = None,
    time_unit: Unit = None,
) -> None:
    """Say what recordings hold: format, sensor, events, frames, inertial measurements."""
    from emseg.io import ReadError, open_recording

    options = open_options(keep_going, size, stream, columns, time_unit)
    failed = 0
    for path in inputs:
        try:
            with open_recording(path, **options) as recording:
                lines = _summary(recording)
        except ReadError as error:
            failed += 1
            typer.echo(f"failed: {error}", err=True)
            continue
        typer.echo("\n".join([str(path), *(f"  {key:9} {value}" for key, value in lines.items())]))
    raise typer.Exit(FAILED if failed else DONE)


def _summary(recording: Any) -> dict[str, str]:
    """What there is to say of a recording, walked once; by what it is about."""
    width, height = recording.size
    lines = {"format": recording.format, "sensor": f"{width}x{height}"}
    if len(recording.streams) > 1:
        lines["streams"] = ", ".join(recording.streams)
    count, rises, first, last = 0, 0, 0, 0
    for events in recording.chunks():
        first = first if count else int(events.t[0])
        last = int(events.t[-1])
        count += len(events)
        rises += int(events.p.sum())
    lines["events"] = f"{count:,}"
    if count:
        seconds = (last - first) / 1e6
        lines |= {
            "first": f"{first} µs",
            "last": f"{last} µs",
            "duration": f"{seconds:.6f} s",
            "rate": f"{count / seconds / 1e6:.3f} Mev/s" if seconds else "-",
            "rises": f"{100 * rises / count:.1f} %",
        }
    frames, of = 0, ""
    for frame in recording.frames():
        frames += 1
        of = f"{frame.image.shape[1]}x{frame.image.shape[0]}"
    if frames:
        lines["frames"] = f"{frames:,} of {of}"
    if samples := len(recording.imu()):
        lines["imu"] = f"{samples:,} samples"
    return lines


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A recording.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The file to write: .aedat4, .npz, .h5, .txt or .csv.")
    ],
    span: Span = None,
    crop: CropOption = None,
    filters: Annotated[
        list[Filter] | None,
        typer.Option("--filter", help="Leave out noise (lone events) or hot pixels; repeatable."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it is there.")] = False,
    keep_going: KeepGoing = False,
    size: Size = None,
    stream: Stream = None,
    columns: Columns = None,
    time_unit: Unit = None,
) -> None:
    """Write a recording's events in another format, whole or in part."""
    from emseg.io import ReadError
    from emseg.io.writing import SUFFIXES

    form = SUFFIXES.get(target.suffix.lower())
    if form is None:
        problem = f"{target} has no known suffix, expected one of: {', '.join(SUFFIXES)}"
        raise typer.BadParameter(problem, param_hint="OUT")
    if target.exists() and (not overwrite or not target.is_file() or target.samefile(source)):
        reason = (
            "exists; --overwrite replaces it" if target.is_file() and not overwrite else "cannot be replaced"
        )
        raise typer.BadParameter(f"{target} {reason}", param_hint="OUT")
    if not target.parent.is_dir():
        raise typer.BadParameter(f"{target.parent} is no folder", param_hint="OUT")
    part = parse_crop(crop)
    options = open_options(keep_going, size, stream, columns, time_unit)
    try:
        line = _convert(source, target, form, options, parse_span(span), part, set(filters or ()))
    except ReadError as error:
        typer.echo(f"failed: {error}", err=True)
        raise typer.Exit(FAILED) from None
    except OSError as error:
        typer.echo(f"failed: {target}: {error.strerror or error}", err=True)
        raise typer.Exit(FAILED) from None
    typer.echo(f"done: {line}")


def _convert(
    source: Path,
    target: Path,
    form: str,
    options: dict[str, Any],
    span: tuple[float, float] | None,
    crop: Any,
    filters: set[Filter],
) -> str:
    from emseg import filters as stages
    from emseg.io import ReadError, open_recording
    from emseg.io.writing import write_events

    with open_recording(source, **options) as recording:
        size = recording.size
        if crop is not None:
            try:
                crop.check_inside(*size)
            except ValueError as error:
                raise ReadError(source, str(error)) from None
            size = crop.width, crop.height

        def part() -> Iterable[EventArray]:
            chunks: Iterator[EventArray] = recording.chunks(span=span)
            return chunks if crop is None else stages.crop_events(chunks, crop)

        events = part()
        if Filter.hot in filters:
            hot = stages.hot_pixels(stages.count_events(part()))
            events = stages.drop_pixels(events, hot)
        if Filter.noise in filters:
            events = stages.drop_noise(events)
        count = write_events(target, events, size=size, form=form)
    return f"{target}: {count:,} events, {size[0]}x{size[1]}"
