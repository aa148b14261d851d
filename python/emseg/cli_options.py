"""Options that several commands share: settings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from emseg.config import Config
from emseg.yaml_files import ConfigError

__all__ = ["CameraFile", "ConfigFile", "Preset", "read_config"]

CameraFile = Annotated[
    Path | None, typer.Option("--camera", metavar="FILE", help="Calibration, YAML or text.")
]
ConfigFile = Annotated[Path | None, typer.Option("--config", metavar="FILE", help="Settings, YAML.")]
Preset = Annotated[str | None, typer.Option("--preset", help="Published settings; `emseg config --list`.")]


def read_config(path: Path | None, preset: str | None) -> Config:
    """The settings of a file, of a preset, or the defaults.

    Raises:
        typer.BadParameter: both are given, or either is wrong.
    """
    if path is not None and preset is not None:
        raise typer.BadParameter("expected --config or --preset, not both")
    try:
        if preset is not None:
            return Config.preset(preset)
        return Config.from_yaml(path) if path is not None else Config()
    except ConfigError as error:
        raise typer.BadParameter(str(error), param_hint="--preset" if preset else "--config") from None
