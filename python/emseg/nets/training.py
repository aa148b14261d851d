"""Training: Lightning does the loop, this says what is optimised and what is kept."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback, EarlyStopping, LearningRateMonitor, ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from torch import Tensor
from torch.utils.data import DataLoader

from emseg.batch import source_commit
from emseg.nets.build import NetworkPair, build_networks
from emseg.nets.checkpoints import TrainedNetworks, save_networks
from emseg.nets.figures import Prediction, ValidationFigures
from emseg.nets.losses import Batch, Losses, total_loss
from emseg.nets.outputs import PoseOutput
from emseg.nets.settings import RunSettings
from emseg.nets.slices import SizedBatches, SliceDataset

__all__ = ["BEST", "LAST", "EpochLines", "SegmentationModule", "TrainingResult", "train"]

log = logging.getLogger(__name__)

BEST = "best.safetensors"
LAST = "last.ckpt"
RUN = "run.json"
METRICS = "metrics.csv"


class SegmentationModule(L.LightningModule):
    """A network pair with its loss, the same for training and validation."""

    def __init__(self, networks: NetworkPair, settings: RunSettings) -> None:
        super().__init__()
        self.networks = networks
        self.settings = settings
        self.figures = ValidationFigures()
        self.best_figures: dict[str, float] = {}

    def losses(self, batch: Batch) -> tuple[Losses, list[Tensor], PoseOutput]:
        """The losses at the scales that the settings want, whatever the mode."""
        settings = self.settings
        disparities, output = self.networks(batch.target, batch.references, settings.network.scales)
        with torch.autocast(
            self.device.type, enabled=False
        ):  # networks may work in half precision, not these
            disparities = [disparity.float() for disparity in disparities]
            maps = [each.float() for each in output.maps]
            output = PoseOutput(output.poses.float(), output.components.float(), maps)
            losses = total_loss(disparities, output, batch, settings.network, settings.loss)
        return losses, disparities, output

    def training_step(self, batch: Batch, index: int) -> Tensor:
        """One step; parts of the loss are logged as means of the epoch."""
        losses, _, _ = self.losses(batch)
        self._log("train", losses, len(batch.target))
        return losses.total

    def validation_step(self, batch: Batch, index: int) -> None:
        """The same loss, and the figures."""
        losses, disparities, output = self.losses(batch)
        self._log("validation", losses, len(batch.target))
        self.figures.update(Prediction(self.networks, disparities, output, batch), batch)

    def on_validation_epoch_end(self) -> None:
        """Log the figures of all of validation."""
        self.best_figures = self.figures.compute()
        self.log_dict({f"validation/{name}": value for name, value in self.best_figures.items()})
        self.figures.reset()

    def _log(self, stage: str, losses: Losses, count: int) -> None:
        values = {f"{stage}/{name}": value.detach() for name, value in losses._asdict().items()}
        self.log_dict(values, on_step=False, on_epoch=True, batch_size=count)

    def configure_optimizers(self) -> Any:
        """Adam, its rate falling to zero as a cosine, step by step."""
        trained = [parameter for parameter in self.networks.parameters() if parameter.requires_grad]
        optimiser = torch.optim.Adam(trained, lr=self.settings.training.learning_rate)
        steps = max(1, int(self.trainer.estimated_stepping_batches))
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, T_max=steps)
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


class EpochLines(Callback):
    """A line an epoch, for who waits."""

    def __init__(self, echo: Callable[[str], Any]) -> None:
        self.echo = echo

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Say how far it is."""
        if trainer.state.fn != "fit":
            return
        metrics = trainer.callback_metrics
        parts = [f"epoch {trainer.current_epoch + 1} of {trainer.max_epochs}"]
        for name in ("validation/total", "validation/mask/iou"):
            if name in metrics:
                parts.append(f"{name} {float(metrics[name]):.4f}")
        self.echo(", ".join(parts))


@dataclass(frozen=True)
class TrainingResult:
    """What a run has come to.

    Attributes:
        best: The file of the best networks.
        validation_loss: Theirs.
        figures: Their figures of validation, by name.
        seconds: Of training, this time.
    """

    best: Path
    validation_loss: float
    figures: Mapping[str, float]
    seconds: float


def train(
    settings: RunSettings,
    training: SliceDataset,
    validation: SliceDataset,
    out: Path,
    *,
    resume: bool = False,
    resnet_weights: Mapping[str, Tensor] | None = None,
    callbacks: tuple[Callback, ...] = (),
    about: Mapping[str, Any] | None = None,
    max_time: Mapping[str, int] | None = None,
    workers: int = 0,
) -> TrainingResult:
    """Train a pair and keep the best by total validation loss.

    Writes best.safetensors, last.ckpt (to resume from), run.json, metrics.csv and curves for TensorBoard.

    Args:
        settings: All of the run.
        training: Targets to learn from.
        validation: Of other sequences.
        out: Folder.
        resume: Go on from last.ckpt where there is one.
        resnet_weights: See :func:`emseg.nets.build.build_networks`.
        callbacks: Further ones of Lightning.
        about: Kept with the networks: where the data came from, say.
        max_time: After which training stops, as {"minutes": 25}.
        workers: Processes that make batches.
    """
    chosen = settings.training
    L.seed_everything(chosen.seed, workers=True, verbose=False)
    networks = build_networks(settings.network, seed=chosen.seed, resnet_weights=resnet_weights)
    module = SegmentationModule(networks, settings)
    out.mkdir(parents=True, exist_ok=True)
    (out / "settings.yaml").write_text(settings.to_yaml(), encoding="utf-8")
    keeper = ModelCheckpoint(
        out, "best", monitor="validation/total", save_last=True, enable_version_counter=False
    )
    rate = LearningRateMonitor("epoch")
    stopping = [EarlyStopping("validation/total", patience=chosen.patience)] if chosen.patience else []
    cuda = torch.cuda.is_available()
    half = chosen.precision == "bfloat16" or (chosen.precision == "auto" and cuda)
    if resume:
        _set_aside(out / METRICS)
    trainer = L.Trainer(
        accelerator="cuda" if cuda else "cpu",
        devices=1,
        precision="bf16-mixed" if half else "32-true",
        max_epochs=chosen.epochs,
        max_time=dict(max_time) if max_time else None,
        logger=[TensorBoardLogger(out, "", "tensorboard"), CSVLogger(out, "", "")],
        callbacks=[keeper, rate, *stopping, *callbacks],
        num_sanity_val_steps=0,
        log_every_n_steps=1,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    loaders = _loaders(training, validation, chosen.batch_size, workers)
    last = out / LAST
    start, cpu_start = time.perf_counter(), time.process_time()
    trainer.fit(module, *loaders, ckpt_path=last if resume and last.exists() else None, weights_only=True)
    seconds, cpu_seconds = time.perf_counter() - start, time.process_time() - cpu_start
    if not keeper.best_model_path:
        raise ValueError(f"{out}: training ended before its first validation")
    kept = torch.load(keeper.best_model_path, map_location="cpu", weights_only=True)
    module.load_state_dict(kept["state_dict"])
    trainer.validate(module, loaders[1], verbose=False)
    loss = float(keeper.best_model_score or float("nan"))
    facts = {
        **(about or {}),
        "commit": source_commit(),
        "seed": chosen.seed,
        "epoch": int(kept["epoch"]),
        "epochs": trainer.current_epoch,
        "seconds": round(seconds, 1),
        "cpu_seconds": round(cpu_seconds, 1),
        "validation_loss": loss,
        "validation": module.best_figures,
        "training_targets": len(training),
        "validation_targets": len(validation),
        "torch": torch.__version__,
        "device": torch.cuda.get_device_name() if cuda else "cpu",
    }
    threshold = module.best_figures.get("mask/threshold", 0.5)
    save_networks(out / BEST, TrainedNetworks(networks, settings, threshold, facts))
    content = {"settings": settings.model_dump(mode="json"), "threshold": threshold, **facts}
    (out / RUN).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return TrainingResult(out / BEST, loss, module.best_figures, seconds)


def _set_aside(curves: Path) -> None:
    """Keep the curves of the run that is taken up: Lightning begins the file anew."""
    if curves.exists():
        earlier = len(list(curves.parent.glob(f"{curves.stem}_*{curves.suffix}")))
        curves.rename(curves.with_stem(f"{curves.stem}_{earlier + 1}"))


def _loaders(
    training: SliceDataset, validation: SliceDataset, batch_size: int, workers: int
) -> tuple[DataLoader[Batch], DataLoader[Batch]]:
    options: dict[str, Any] = {"num_workers": workers, "persistent_workers": workers > 0}
    return (
        DataLoader(training, batch_sampler=SizedBatches(training, batch_size, order="random"), **options),
        DataLoader(validation, batch_sampler=SizedBatches(validation, batch_size, order="given"), **options),
    )
