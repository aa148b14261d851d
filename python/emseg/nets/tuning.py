"""Search of hyper-parameters with Optuna; what is sought is the least total validation loss."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lightning as L
import optuna
from lightning.pytorch.callbacks import Callback

from emseg.nets.settings import RunSettings
from emseg.nets.slices import SliceDataset
from emseg.nets.training import train

__all__ = ["search", "suggested"]

Datasets = Callable[[RunSettings], tuple[SliceDataset, SliceDataset]]

BATCH_SIZES = (4, 8, 16, 32)
GROWTH_RATES = (4, 8, 16)
FINAL_MAP_SIZES = (4, 8)
LEARNING_RATES = (1e-5, 1e-2)


class _Pruner(Callback):
    """Gives a trial up whose losses are worse than others' were after as many epochs."""

    def __init__(self, trial: optuna.Trial) -> None:
        self.trial = trial

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        if trainer.state.fn == "fit":
            self.trial.report(float(trainer.callback_metrics["validation/total"]), trainer.current_epoch)
            if self.trial.should_prune():
                raise optuna.TrialPruned


def suggested(settings: RunSettings, trial: optuna.Trial) -> RunSettings:
    """The settings with what the trial suggests: the thesis' four parameters.

    Weights of the losses stay as they are: they would change what is compared.
    """
    network: dict[str, Any] = {}
    if settings.network.architecture == "ecn":
        network["growth_rate"] = trial.suggest_categorical("growth_rate", GROWTH_RATES)
        network["final_map_size"] = trial.suggest_categorical("final_map_size", FINAL_MAP_SIZES)
    training = {
        "learning_rate": trial.suggest_float("learning_rate", *LEARNING_RATES, log=True),
        "batch_size": trial.suggest_categorical("batch_size", BATCH_SIZES),
    }
    values = settings.model_dump()
    values["network"] |= network
    values["training"] |= training
    return RunSettings.from_mapping(values, f"trial {trial.number}")


def search(
    settings: RunSettings, datasets: Datasets, out: Path, *, trials: int, echo: Callable[[str], Any]
) -> float:
    """Train once a trial; what was tried is kept in out/tune.db, and a search goes on where it stopped.

    Writes out/best.yaml, the settings of the best trial.

    Returns:
        The least validation loss.
    """
    optuna.logging.set_verbosity(logging.WARNING)
    out.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        study_name="emseg",
        storage=f"sqlite:///{out / 'tune.db'}",
        load_if_exists=True,
        sampler=optuna.samplers.TPESampler(seed=settings.training.seed),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=4, n_warmup_steps=2),
    )
    training, validation = datasets(settings)

    def objective(trial: optuna.Trial) -> float:
        chosen = suggested(settings, trial)
        result = train(
            chosen, training, validation, out / f"trial_{trial.number:04d}", callbacks=(_Pruner(trial),)
        )
        echo(f"trial {trial.number}: validation loss {result.validation_loss:.4f}: {trial.params}")
        return result.validation_loss

    study.optimize(objective, n_trials=trials)
    best = suggested(settings, optuna.trial.FixedTrial(study.best_params, study.best_trial.number))  # type: ignore[arg-type]
    (out / "best.yaml").write_text(best.to_yaml(), encoding="utf-8")
    return float(study.best_value)
