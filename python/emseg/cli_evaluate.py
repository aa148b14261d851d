"""The command `emseg evaluate`: our figures on a public data set beside the published ones."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from tqdm import tqdm

from emseg.config import Config
from emseg.yaml_files import ConfigError

__all__ = ["evaluate"]

DONE: Final = 0
SOME_FAILED: Final = 1
INTERRUPTED: Final = 130


def evaluate(
    dataset: Annotated[
        str | None, typer.Argument(metavar="[DATASET]", help="Which; --list lists them.")
    ] = None,
    root: Annotated[Path | None, typer.Option("--root", metavar="DIR", help="Where it lies.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Write JSON, CSV and an HTML page there."),
    ] = None,
    config_file: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="Settings, YAML.")
    ] = None,
    preset: Annotated[
        str | None, typer.Option("--preset", help="Published settings; `emseg config --list`.")
    ] = None,
    recordings: Annotated[
        list[str] | None, typer.Option("--recording", help="Only those whose name begins so; repeatable.")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.001, help="Only the first seconds of each recording.")
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the known data sets instead.")] = False,
) -> None:
    """Segment a data set, and print our figures beside the published ones, protocol by protocol."""
    from emseg.datasets import DatasetError, known_datasets, open_dataset
    from emseg.evaluation.report import text_table, write_reports
    from emseg.evaluation.run import evaluate_dataset

    if listing:
        for entry in known_datasets().values():
            typer.echo(f"{entry.name:12} {entry.title}\n{'':12} {entry.source}")
        return
    if dataset is None or root is None:
        raise typer.BadParameter(
            "expected a data set and where it lies; --list lists them", param_hint="--root"
        )
    config, settings_name = _settings(config_file, preset)
    try:
        opened = open_dataset(dataset, root)
    except DatasetError as error:
        wrong = "--root" if dataset in known_datasets() else "DATASET"
        raise typer.BadParameter(str(error), param_hint=wrong) from None
    if recordings and not any(name.startswith(tuple(recordings)) for name in opened.names):
        listed = ", ".join(opened.names)
        raise typer.BadParameter(f"no recording of that name, there are: {listed}", param_hint="--recording")
    bar = _Bar()
    try:
        found = evaluate_dataset(
            opened,
            config,
            settings_name=settings_name,
            recordings=recordings or (),
            seconds=seconds,
            progress=bar.update,
        )
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None
    finally:
        bar.clear()
    number = len(found.recordings)
    cpu_s = sum(recording["cpu_s"] for recording in found.recordings)
    typer.echo(
        f"{dataset}, {number} recording{'' if number == 1 else 's'}, settings {settings_name}: "
        f"{cpu_s:.1f} CPU s, peak memory {found.about['peak_mb']} MB\n"
    )
    typer.echo(text_table(found.rows))
    if out is not None:
        files = write_reports(out, found.about, found.rows, found.recordings, found.views)
        typer.echo("\n" + "\n".join(f"written: {path}" for path in files))
    for line in found.failed:
        typer.echo(f"failed: {' '.join(line.split())}", err=True)
    raise typer.Exit(SOME_FAILED if found.failed else DONE)


def _settings(path: Path | None, preset: str | None) -> tuple[Config, str]:
    if path is not None and preset is not None:
        raise typer.BadParameter("expected --config or --preset, not both")
    try:
        if preset is not None:
            return Config.preset(preset), preset
        return (Config.from_yaml(path), path.name) if path is not None else (Config(), "auto")
    except ConfigError as error:
        raise typer.BadParameter(str(error), param_hint="--preset" if preset else "--config") from None


class _Bar:
    """A progress bar over a recording's events, on a terminal; nothing elsewhere."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._name = ""

    def update(self, name: str, done: int, of: int) -> None:
        """Show that `done` of a recording's `of` events are done."""
        if not sys.stderr.isatty():
            return
        if self._name != name:
            self.clear()
            self._name = name
            self._bar = tqdm(total=of, desc=name, unit=" events", unit_scale=True, leave=False)
        self._bar.update(done - self._bar.n)

    def clear(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
        self._bar, self._name = None, ""
