"""The command line: `emseg segment`, `config`, `demo`, `render`, `view`, `simulate`; others join in here.

Exit status: 0 done, 1 some inputs failed (each named, the others done), 2 bad usage.
"""

from __future__ import annotations

import importlib.util
import logging
import signal
import sys
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NoReturn

import typer
from tqdm import tqdm

import emseg
from emseg import cli_recordings as recordings
from emseg.cli_evaluate import evaluate
from emseg.cli_live import live, record
from emseg.cli_nets import compare, nets_app
from emseg.cli_options import CameraFile, ConfigFile, Preset, read_config
from emseg.config import Config

__all__ = ["app", "main"]

DONE: Final = 0
SOME_FAILED: Final = 1
INTERRUPTED: Final = 130

NO_ENCODER: Final = "no video encoder is installed: pip install 'emseg[viz]'"

app = typer.Typer(
    name="emseg",
    help="Motion segmentation with event cameras.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

ResultFolder = Annotated[Path, typer.Argument(metavar="RESULT", help="A folder that `emseg segment` wrote.")]
RecordingOfResult = Annotated[
    Path | None, typer.Option("--source", metavar="FILE", help="The recording, if it has moved.")
]


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(emseg.__version__)
        raise typer.Exit


@app.callback()
def _common(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say more of what is done.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    level = logging.DEBUG if verbose else logging.WARNING
    logging.basicConfig(level=level, format="emseg: %(message)s", stream=sys.stderr, force=True)
    for noisy in ("matplotlib", "PIL"):
        logging.getLogger(noisy).setLevel(logging.WARNING)


@app.command()
def segment(
    inputs: Annotated[list[Path], typer.Argument(metavar="IN...", help="Recordings, or folders of them.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the results.")],
    config_file: ConfigFile = None,
    preset: Preset = None,
    camera: CameraFile = None,
    video: Annotated[bool, typer.Option("--video", help="Write segmentation.mp4 too.")] = False,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Recordings at a time.")] = 1,
    executor: Annotated[
        str, typer.Option("--executor", help="local, dask://HOST:PORT, slurm or slurm://PARTITION.")
    ] = "local",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace results that are there.")] = False,
    span: recordings.Span = None,
    crop: recordings.CropOption = None,
    keep_going: recordings.KeepGoing = False,
    size: recordings.Size = None,
    stream: recordings.Stream = None,
    columns: recordings.Columns = None,
    time_unit: recordings.Unit = None,
) -> None:
    """Segment recordings into DIR/<name>/.

    What is done already is skipped, so that an interrupted run goes on where it stopped.
    """
    from emseg.batch import find_inputs
    from emseg.reading import Reading

    config = read_config(config_file, preset)
    options = recordings.open_options(keep_going, size, stream, columns, time_unit)
    reading = Reading(**options, span=recordings.parse_span(span), crop=recordings.parse_crop(crop))
    _check_camera(camera)
    if video and not _has_video_encoder():
        raise typer.BadParameter(NO_ENCODER, param_hint="--video")
    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file, expected a folder", param_hint="--out")
    sources = list(dict.fromkeys(find_inputs(inputs)))
    if not sources:
        listed = ", ".join(str(path) for path in inputs)
        raise typer.BadParameter(f"no recordings in {listed}", param_hint="IN...")
    status = _segment_all(
        sources,
        out,
        config,
        executor=executor,
        processes=jobs,
        reading=reading,
        camera=camera,
        video="yes" if video else "no",
        existing="replace" if overwrite else "keep",
    )
    raise typer.Exit(status)


def _segment_all(
    sources: list[Path],
    out: Path,
    config: Config,
    *,
    executor: str = "local",
    processes: int = 1,
    **options: Any,
) -> int:
    """Do a job for each recording, `options` being further ones of :class:`emseg.batch.Job`: exit status."""
    from emseg import batch
    from emseg.executors import ExecutorError, make_executor

    bar = _Bar()
    try:
        doer = make_executor(executor, processes=processes, folder=out, progress=bar.update)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--executor") from None
    todo = [
        batch.Job(source, out / name, config, segmenter=batch.SEGMENTER, **options)
        for source, name in zip(sources, batch.name_inputs(sources), strict=True)
    ]
    failed = []
    try:
        for outcome in doer.run(todo):
            bar.clear()
            if outcome.status == "failed":
                failed.append(outcome.job.source)
            typer.echo(f"{outcome.status}: {outcome.message}", err=outcome.status == "failed")
    except ExecutorError as error:
        typer.echo(f"failed: {error}", err=True)
        return SOME_FAILED
    except KeyboardInterrupt:
        bar.clear()
        typer.echo("interrupted; finished results stay, no half ones are left", err=True)
        return INTERRUPTED
    if failed:
        named = "".join(f"\n  {source}" for source in failed)
        typer.echo(f"{len(failed)} of {len(todo)} failed:{named}", err=True)
    return SOME_FAILED if failed else DONE


class _Bar:
    """The progress through a recording's events, on a terminal; nothing elsewhere."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._source: Path | None = None

    def update(self, job: Any, done: int) -> None:
        """Show that `done` of a job's events are done; how many there are is known when all are read."""
        if not sys.stderr.isatty():
            return
        if self._source != job.source:
            self.clear()
            self._source = job.source
            self._bar = tqdm(desc=job.source.name, unit=" events", unit_scale=True, leave=False)
        self._bar.update(done - self._bar.n)

    def clear(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
        self._bar = self._source = None


app.command()(recordings.info)
app.command()(recordings.convert)
app.command()(live)
app.command()(record)
app.command()(evaluate)
app.add_typer(nets_app)
app.command()(compare)


@app.command()
def config(
    preset: Preset = None,
    listing: Annotated[bool, typer.Option("--list", help="List the presets instead.")] = False,
) -> None:
    """Print the settings as YAML.

    Each with its meaning, unit, range and source: the defaults, or those of a preset.
    """
    if listing:
        typer.echo("\n".join(Config.presets()))
    else:
        typer.echo(read_config(None, preset).to_yaml(), nl=False)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the results.")] = Path(
        "emseg-demo"
    ),
) -> None:
    """Segment the bundled recordings, with videos."""
    from emseg.datasets import bundled

    video = _has_video_encoder()
    if not video:
        typer.echo(f"no videos: {NO_ENCODER}", err=True)
    status = _segment_all(list(bundled().values()), out, Config(), video="yes" if video else "no")
    if status == DONE:
        typer.echo("look at:")
        for path in sorted([*out.glob("*/*.png"), *out.glob("*/*.mp4")]):
            typer.echo(f"  {path}")
    raise typer.Exit(status)


@app.command()
def render(result: ResultFolder, source: RecordingOfResult = None) -> None:
    """Make the video of a result folder (again)."""
    from emseg.batch import render_video
    from emseg.video import VideoError

    try:
        target = render_video(result, source)
    except (ValueError, VideoError, OSError) as error:
        typer.echo(f"failed: {error}", err=True)
        raise typer.Exit(SOME_FAILED) from None
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None
    typer.echo(f"done: {target}")


@app.command()
def view(result: ResultFolder, source: RecordingOfResult = None) -> None:
    """Show a result folder in a window, to play and to step through."""
    from emseg.batch import read_result
    from emseg.video import film
    from emseg.viewer import ViewerError, open_window

    try:
        open_window(film(*read_result(result, source)), f"emseg: {result}")
    except (ValueError, ViewerError, OSError) as error:
        typer.echo(f"failed: {error}", err=True)
        if isinstance(error, ViewerError):
            typer.echo(f"`emseg render {result}` makes a video instead", err=True)
        raise typer.Exit(SOME_FAILED) from None


@app.command()
def simulate(
    scene: Annotated[
        str | None, typer.Argument(metavar="[SCENE]", help="A scene: a YAML file, or a name of the suite.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="Where it goes.")] = None,
    layout: Annotated[
        Literal["npz", "evimo2", "evimo", "evimo-txt"],
        typer.Option("--format", help="npz, or a layout of EV-IMO; docs/simulation.md describes them."),
    ] = "npz",
    suite: Annotated[
        Path | None, typer.Option("--suite", metavar="DIR", help="Make the scene suite into a folder.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of a scene of the suite by name.")] = 0,
    seeds: Annotated[str, typer.Option("--seeds", metavar="A:B", help="Its seeds, A to B-1.")] = "0:1",
    scenes: Annotated[str, typer.Option("--scenes", help="Names of its scenes, by commas; all.")] = "",
    duration: Annotated[
        float, typer.Option("--duration", min=0.01, max=60, help="Length of recordings of the suite, s.")
    ] = 0.5,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Recordings at a time.")] = 1,
) -> None:
    """Simulate a scene, or the scene suite, with exact truth.

    The suite goes to DIR/<split>/<scene>_<seed>.npz and is listed in DIR/manifest.json; what is there already
    is not made again.
    """
    from emseg.simulation.command import simulate_scene, simulate_suite

    if (scene is None) == (suite is None):
        raise typer.BadParameter("expected a scene or --suite, one of them", param_hint="SCENE")
    try:
        if suite is not None:
            names = [name.strip() for name in scenes.split(",") if name.strip()]
            failed = simulate_suite(suite, seeds, names, duration, jobs, typer.echo)
        else:
            assert scene is not None
            if out is None:
                raise typer.BadParameter("expected where the recording goes", param_hint="--out")
            failed = simulate_scene(scene, seed, duration, out, layout, typer.echo)
    except KeyboardInterrupt:
        typer.echo("interrupted; finished recordings stay, no half ones are left", err=True)
        raise typer.Exit(INTERRUPTED) from None
    raise typer.Exit(SOME_FAILED if failed else DONE)


def _check_camera(path: Path | None) -> None:
    """Refuse a calibration that no recording could go with."""
    if path is None:
        return
    from emseg.camera import Camera

    try:
        Camera.from_file(path)
    except (ValueError, OSError) as error:
        try:  # it may lack nothing but the sensor's size, which the recordings will tell
            Camera.from_file(path, width=1, height=1)
        except (ValueError, OSError):
            problem = f"{path}: {error.strerror}" if isinstance(error, OSError) else str(error)
            raise typer.BadParameter(problem, param_hint="--camera") from None


def _has_video_encoder() -> bool:
    return any(importlib.util.find_spec(name) for name in ("imageio_ffmpeg", "cv2"))


def main() -> NoReturn:
    """The entry point of the `emseg` command."""
    from emseg.executors import exit_on_signal

    signal.signal(signal.SIGTERM, exit_on_signal)
    app()
    raise AssertionError("typer exits by itself")
