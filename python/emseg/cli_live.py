"""The commands that deal with streams: `emseg live` and `emseg record`."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from emseg import cli_recordings as recordings
from emseg.cli_options import CameraFile, ConfigFile, Preset, read_config

__all__ = ["live", "record"]

DONE: Final = 0
FAILED: Final = 1

_REPORT_S: Final = 1.0


class Listed(StrEnum):
    """Which events JSON lines list."""

    none = "none"
    moving = "moving"
    all = "all"


Source = Annotated[
    str,
    typer.Argument(
        metavar="SOURCE", help="camera, camera:SERIAL, tcp://HOST:PORT of dv-processing, or a recording."
    ),
]
Pace = Annotated[
    float | None, typer.Option("--pace", help="Seconds of a recording to play in a second; default: 1.")
]
Seconds = Annotated[float | None, typer.Option("--seconds", min=0.0, help="End after so long, s.")]


def live(
    source: Source,
    pace: Pace = None,
    json: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write a line of JSON a window; -: here.")
    ] = None,
    events: Annotated[Listed, typer.Option("--events", help="Events that these lines list.")] = Listed.none,
    publish: Annotated[
        str | None,
        typer.Option("--publish", metavar="[HOST:]PORT", help="Send dv-processing streams from PORT on."),
    ] = None,
    config_file: ConfigFile = None,
    preset: Preset = None,
    camera: CameraFile = None,
    seconds: Seconds = None,
    span: recordings.Span = None,
    crop: recordings.CropOption = None,
    keep_going: recordings.KeepGoing = False,
    size: recordings.Size = None,
    stream: recordings.Stream = None,
    columns: recordings.Columns = None,
    time_unit: recordings.Unit = None,
) -> None:
    """Segment a stream while it comes in, until it ends or Ctrl-C.

    Where it brings more than the machine can do, events are left out evenly, and it is said how many.
    """
    from emseg.live.segmenter import LiveSegmenter
    from emseg.reading import Reading

    options = recordings.open_options(keep_going, size, stream, columns, time_unit)
    reading = Reading(**options, span=recordings.parse_span(span), crop=recordings.parse_crop(crop))
    config = read_config(config_file, preset)
    address = _parse_address(publish)
    with _failures(), contextlib.ExitStack() as stack:
        opened = _open(source, pace, reading)
        calibration = _camera(camera, reading, opened.size)
        sinks = _sinks(stack, json, events, address, opened.size)
        segmenter = LiveSegmenter(opened, camera=calibration, config=config)
        report = _Report(segmenter.figures)
        with _stopped_by_signals(opened, seconds):
            for window in segmenter.run():
                for sink in sinks:
                    sink.write(window)
                report.update(window)
        typer.echo(report.summary(), err=json == Path("-"))


def record(
    source: Source,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The .aedat4 file to write.")],
    pace: Pace = None,
    seconds: Seconds = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE if it is there.")] = False,
) -> None:
    """Keep a stream as aedat4, until it ends or Ctrl-C."""
    from emseg.live.recording import record as write
    from emseg.reading import Reading

    if out.suffix.lower() != ".aedat4":
        raise typer.BadParameter(f"{out} does not end in .aedat4", param_hint="--out")
    if out.exists() and not (overwrite and out.is_file()):
        raise typer.BadParameter(f"{out} exists; --overwrite replaces it", param_hint="--out")
    if not out.parent.is_dir():
        raise typer.BadParameter(f"{out.parent} is no folder", param_hint="--out")
    with _failures():
        opened = _open(source, pace, Reading())
        with _stopped_by_signals(opened, seconds):
            count = write(opened, out)
    typer.echo(f"done: {out}: {count:,} events, {opened.size[0]}x{opened.size[1]}")


def _open(source: str, pace: float | None, reading: Any) -> Any:
    from emseg.io import ReadError
    from emseg.live.sources import open_source

    try:
        return open_source(source, pace=pace, reading=reading)
    except ReadError:
        raise
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="SOURCE") from None


def _camera(path: Path | None, reading: Any, size: tuple[int, int]) -> Any:
    if path is None:
        return None
    from emseg.camera import Camera

    if reading.crop is not None:
        raise typer.BadParameter("expected --camera or --crop, not both", param_hint="--camera")
    try:
        return Camera.from_file(path, width=size[0], height=size[1])
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error), param_hint="--camera") from None


def _parse_address(text: str | None) -> tuple[str, int] | None:
    if text is None:
        return None
    host, _, port = text.rpartition(":")
    if not port.isdigit() or not 1 <= int(port) <= 65533:
        problem = f"address is {text!r}, expected PORT or HOST:PORT, with two more ports behind it"
        raise typer.BadParameter(problem, param_hint="--publish")
    return host or "127.0.0.1", int(port)


def _sinks(
    stack: contextlib.ExitStack,
    json: Path | None,
    events: Listed,
    address: tuple[str, int] | None,
    size: tuple[int, int],
) -> list[Any]:
    from emseg.live.sinks import DvStreams, JsonLines

    sinks: list[Any] = []
    if json is not None:
        file = sys.stdout if json == Path("-") else stack.enter_context(json.open("w", encoding="utf-8"))
        sinks.append(JsonLines(file, events=events.value))
    if address is not None:
        sinks.append(DvStreams(*address, size=size))
    return sinks


@contextlib.contextmanager
def _failures() -> Iterator[None]:
    """Turn what cannot be read or written into a line and an exit status."""
    from emseg.io import ReadError

    try:
        yield
    except (ReadError, OSError) as error:
        typer.echo(f"failed: {error}", err=True)
        raise typer.Exit(FAILED) from None


@contextlib.contextmanager
def _stopped_by_signals(source: Any, seconds: float | None) -> Iterator[None]:
    """Ctrl-C, SIGTERM and the time limit end the stream; what has come is done to its end."""
    before = {
        number: signal.signal(number, lambda *_: source.stop()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    timer = None if seconds is None else threading.Timer(seconds, source.stop)
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


class _Report:
    """Says every second, and at the end, how the stream is kept up with."""

    def __init__(self, figures: Any) -> None:
        self._figures = figures
        self._said = time.monotonic()
        self._before = (0, 0, 0, 0, 0.0)

    def update(self, window: Any) -> None:
        """Say it if it is time to."""
        if time.monotonic() - self._said < _REPORT_S:
            return
        figures, before = self._figures, self._before
        now = (figures.windows, figures.labelled, figures.thinned, figures.skipped, figures.span_s)
        windows, labelled, thinned, skipped, span = (a - b for a, b in zip(now, before, strict=True))
        self._said, self._before = time.monotonic(), now
        events = labelled + thinned + skipped
        typer.echo(
            f"{figures.span_s:8.1f} s  {events / max(span, 1e-6) / 1e6:6.3f} Mev/s  {windows:4} windows  "
            f"latency p50 {1e3 * figures.latency_s(0.5, windows=windows):.0f} ms, "
            f"p95 {1e3 * figures.latency_s(0.95, windows=windows):.0f} ms  "
            f"thinned {thinned / max(events, 1):.1%}, skipped {skipped / max(events, 1):.1%}  "
            f"{len(window.segmentation.boxes)} moving",
            err=True,
        )

    def summary(self) -> str:
        """All of it in a line."""
        figures = self._figures
        return (
            f"done: {figures.received:,} events in {figures.span_s:.1f} s of stream, "
            f"{figures.rate / 1e6:.3f} Mev/s, {figures.windows} windows; "
            f"{figures.labelled:,} labelled, {figures.thinned:,} thinned, {figures.skipped:,} skipped; "
            f"latency p50 {1e3 * figures.latency_s(0.5):.0f} ms, p95 {1e3 * figures.latency_s(0.95):.0f} ms"
        )
