"""The eight runs of the thesis by name, and what it reports of them."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from emseg.nets.settings import Architecture, LossSettings, NetworkSettings, RunSettings, TrainingSettings

__all__ = ["PRESETS", "REPORTED", "Reported", "preset"]


@dataclass(frozen=True)
class Reported:
    """What the thesis says of a run, on EV-IMO.

    Attributes:
        training_loss, validation_loss: As printed there; None where it gives none.
        remark: Where it gives words instead.
    """

    training_loss: float | None
    validation_loss: float | None
    remark: str = ""


def _run(
    architecture: Architecture, learning_rate: float, epochs: int, batch_size: int, growth: int, final: int
) -> RunSettings:
    return RunSettings(
        network=NetworkSettings(architecture=architecture, growth_rate=growth, final_map_size=final),
        loss=LossSettings(),
        training=TrainingSettings(learning_rate=learning_rate, epochs=epochs, batch_size=batch_size),
    )


PRESETS: Final = MappingProxyType(
    {
        "thesis/ecn-1": _run("ecn", 5e-5, 100, 15, 8, 4),
        "thesis/ecn-2": _run("ecn", 1e-3, 30, 32, 4, 8),
        "thesis/ecn-3": _run("ecn", 1e-5, 500, 32, 4, 8),
        "thesis/edn-1": _run("edn", 5e-4, 30, 32, 4, 8),
        "thesis/edn-2": _run("edn", 5e-5, 30, 15, 8, 4),
        "thesis/edn-3": _run("edn", 1e-5, 30, 20, 8, 4),
        "thesis/redn-1": _run("redn", 1e-2, 50, 32, 4, 8),
        "thesis/redn-2": _run("redn", 1e-5, 50, 25, 8, 4),
    }
)
"""Settings of the thesis' runs."""

REPORTED: Final = MappingProxyType(
    {
        "thesis/ecn-1": Reported(0.25, 0.13, "its best"),
        "thesis/ecn-2": Reported(0.27, 0.20),
        "thesis/ecn-3": Reported(0.39, 0.16),
        "thesis/edn-1": Reported(0.35, 0.13),
        "thesis/edn-2": Reported(None, None, "blank output"),
        "thesis/edn-3": Reported(0.23, 0.12),
        "thesis/redn-1": Reported(0.24, 0.12),
        "thesis/redn-2": Reported(None, None, "higher"),
    }
)
"""Losses that the thesis reports of them."""


def preset(name: str) -> RunSettings:
    """The settings of a preset.

    Raises:
        ValueError: no such preset.
    """
    if name not in PRESETS:
        raise ValueError(f"unknown preset '{name}', expected one of {', '.join(PRESETS)}")
    return PRESETS[name]
