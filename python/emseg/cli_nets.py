"""The commands about networks: `emseg nets train|evaluate|predict|tune|export`, and `emseg compare`."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from emseg.yaml_files import ConfigError

if TYPE_CHECKING:
    from emseg.nets.settings import RunSettings

__all__ = ["compare", "nets_app"]

FAILED: Final = 1
INTERRUPTED: Final = 130

NEEDED: Final = ("torch", "lightning", "torchmetrics", "kornia", "tensorboard", "safetensors")

nets_app = typer.Typer(
    name="nets",
    help="Networks that estimate depth and motion: docs/networks.md.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Data = Annotated[Path, typer.Argument(metavar="DATA", help="Folder that `emseg simulate --suite` wrote.")]
Out = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the results.")]
Checkpoint = Annotated[
    Path, typer.Option("--checkpoint", metavar="FILE", help="A best.safetensors of `emseg nets train`.")
]
SplitOption = Annotated[
    Literal["train", "validation", "test", "all"],
    typer.Option("--split", help="Which recordings of DATA; all: those of the folder itself."),
]
ConfigFile = Annotated[Path | None, typer.Option("--config", metavar="FILE", help="Settings, YAML.")]
Preset = Annotated[str | None, typer.Option("--preset", help="A run of the thesis, such as thesis/ecn-1.")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="One setting, such as training.epochs=5; repeatable."),
]
Threads = Annotated[int, typer.Option("--threads", min=0, help="Threads of PyTorch; 0: its own choice.")]
Labels = Annotated[
    Literal["truth", "engine"],
    typer.Option("--labels", help="Learn from the truth, or from the engine's labels and nothing else."),
]
Weights = Annotated[
    Path | None,
    typer.Option("--resnet18-weights", metavar="FILE", help="torchvision's checkpoint, for redn."),
]


def _prepare(threads: int = 0, *, also: tuple[str, ...] = ()) -> None:
    """Say what is missing before anything else; set the number of threads."""
    missing = [name for name in (*NEEDED, *also) if importlib.util.find_spec(name) is None]
    if missing:
        typer.echo(f"failed: {missing[0]} is not installed: pip install 'emseg[nets]'", err=True)
        raise typer.Exit(FAILED)
    if threads:
        import torch

        torch.set_num_threads(threads)


def _settings(path: Path | None, preset: str | None, overrides: list[str] | None) -> RunSettings:
    import yaml

    from emseg.nets import presets
    from emseg.nets.settings import RunSettings

    if path is not None and preset is not None:
        raise typer.BadParameter("expected --config or --preset, not both")
    try:
        if preset is not None:
            settings = presets.preset(preset)
        else:
            settings = RunSettings.from_yaml(path) if path is not None else RunSettings()
        values = settings.model_dump(exclude_unset=path is None and preset is None)
        for override in overrides or []:
            key, sign, text = override.partition("=")
            if not sign:
                raise ConfigError(f"--set {override}: expected KEY=VALUE")
            place: dict[str, Any] = values
            *groups, name = key.split(".")
            for group in groups:
                place = place.setdefault(group, {})
            place[name] = yaml.safe_load(text)
        return RunSettings.from_mapping(values, "--set" if overrides else str(path or preset or "settings"))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def _report(action: Any) -> None:
    """Run it; errors that a user can mend become one line."""
    try:
        action()
    except KeyboardInterrupt:
        typer.echo("interrupted; --resume takes a training up again", err=True)
        raise typer.Exit(INTERRUPTED) from None
    except (ValueError, OSError) as error:
        typer.echo(f"failed: {' '.join(str(error).split())}", err=True)
        raise typer.Exit(FAILED) from None


@nets_app.command()
def train(
    data: Data,
    out: Out,
    config: ConfigFile = None,
    preset: Preset = None,
    overrides: Overrides = None,
    labels: Labels = "truth",
    resume: Annotated[bool, typer.Option("--resume", help="Go on from DIR/last.ckpt.")] = False,
    resnet18_weights: Weights = None,
    threads: Threads = 0,
    max_minutes: Annotated[float, typer.Option("--max-minutes", min=0, help="Stop then; 0: never.")] = 0,
) -> None:
    """Train a pair on DATA/train and keep the best on DATA/validation.

    Writes best.safetensors, last.ckpt, run.json, metrics.csv and curves for TensorBoard into DIR.
    """
    _prepare(threads)
    settings = _settings(config, preset, overrides)
    from emseg.nets import commands

    _report(
        lambda: commands.train(
            data,
            out,
            settings,
            labels=labels,
            existing="resume" if resume else "replace",
            resnet18_weights=resnet18_weights,
            max_minutes=max_minutes,
            echo=typer.echo,
        )
    )


@nets_app.command()
def evaluate(
    data: Data,
    checkpoint: Checkpoint,
    split: SplitOption = "test",
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="JSON too.")] = None,
    threads: Threads = 0,
) -> None:
    """Figures of trained networks on recordings with truth: masks, depth, flow."""
    _prepare(threads)
    from emseg.nets import commands

    _report(lambda: commands.evaluate(data, checkpoint, split, out, typer.echo))


@nets_app.command()
def predict(
    recording: Annotated[Path, typer.Argument(metavar="IN", help="A recording of any format.")],
    checkpoint: Checkpoint,
    out: Out,
    camera: Annotated[
        Path | None, typer.Option("--camera", metavar="FILE", help="Calibration, YAML or text.")
    ] = None,
    pictures: Annotated[int, typer.Option("--pictures", min=0, help="How many to draw.")] = 5,
    threads: Threads = 0,
) -> None:
    """Depth, flow and moving masks of a recording, slice by slice, with pictures."""
    _prepare(threads)
    from emseg.nets import commands

    _report(lambda: commands.predict(recording, checkpoint, out, camera, pictures, typer.echo))


@nets_app.command()
def tune(
    data: Data,
    out: Out,
    config: ConfigFile = None,
    preset: Preset = None,
    overrides: Overrides = None,
    trials: Annotated[int, typer.Option("--trials", min=1, help="How many to try.")] = 20,
    threads: Threads = 0,
) -> None:
    """Search learning rate, batch size, growth rate and final map size for the least validation loss."""
    _prepare(threads, also=("optuna",))
    settings = _settings(config, preset, overrides)
    from emseg.nets import commands

    _report(lambda: commands.tune(data, out, settings, trials, typer.echo))


@nets_app.command()
def export(
    checkpoint: Checkpoint,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The TorchScript file.")],
    size: Annotated[str, typer.Option("--size", metavar="WxH", help="Of the images.")] = "346x260",
) -> None:
    """Write the networks as TorchScript, which needs no emseg to run."""
    _prepare()
    from emseg.nets import commands

    _report(lambda: commands.export(checkpoint, out, size, typer.echo))


def compare(
    data: Data,
    out: Out,
    checkpoints: Annotated[
        list[Path] | None, typer.Option("--checkpoint", metavar="FILE", help="Networks; repeatable.")
    ] = None,
    split: SplitOption = "test",
    pictures: Annotated[int, typer.Option("--pictures", min=0, help="How many to draw.")] = 6,
) -> None:
    """The engine and networks on the same held-out recordings: table, pictures, and the thesis' claims."""
    _prepare(1)
    from emseg.nets import commands

    _report(lambda: commands.compare(data, out, checkpoints or [], split, pictures, typer.echo))
