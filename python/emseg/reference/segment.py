"""The whole method: models and labels in turn.

Source: Zhou, Gallego, Lu, Liu, Shen, TNNLS 2021; equation numbers are those of `energy`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from emseg.reference.energy import labeling_energy, unary_costs
from emseg.reference.expansion import expansion
from emseg.reference.fit import FitOptions, refine
from emseg.reference.graph import EventGraph, build_event_graph
from emseg.reference.pool import model_pool
from emseg.reference.search import SearchOptions
from emseg.reference.warp import MotionModel
from emseg.reference.window import Window

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class SegmentOptions:
    """Weights and limits.  The defaults are the published code's but for the search."""

    fit: FitOptions = field(default_factory=FitOptions)
    bracket_row: int = 6  # finest subdivision of the image plane (BracketRow)
    data_term: str = "published"  # or "logarithmic"
    lambda_data: float = 1.0
    lambda_smooth: int = 30  # per cut edge
    lambda_label: int = 8000  # per used label
    num_iter_segmentation: int = 5  # alternations at most
    num_iter_labeling: int = 2  # expansion sweeps in each

    @classmethod
    def published(cls, search: SearchOptions | None = None) -> SegmentOptions:
        """The published data term and search: minutes to hours a window."""
        search = replace(search or SearchOptions(), method="published")
        return cls(fit=FitOptions(search=search), data_term="published")


@dataclass(frozen=True)
class Segmentation:
    """labels int64 (n,) index models; energy_trace starts at the initial labels and never rises."""

    labels: Integers
    models: list[MotionModel]
    energy: int
    energy_trace: list[int]
    timings: dict[str, float]  # CPU seconds by stage


def segment(
    window: Window, options: SegmentOptions | None = None, *, pool: Sequence[MotionModel] | None = None
) -> Segmentation:
    """Segment a window; a pool given is used in place of a searched one.

    Unused models stay in the pool, so labels index `Segmentation.models` throughout.
    Raises ValueError for an empty window or pool.
    """
    options = options or SegmentOptions()
    if len(window) == 0:
        raise ValueError("a window without events; expected at least one")
    timings = dict.fromkeys(("graph", "pool", "labels", "models"), 0.0)

    with _Stopwatch(timings, "graph"):
        graph = build_event_graph(window.pixel)
    with _Stopwatch(timings, "pool"):
        if pool is None:
            pool = model_pool(window, bracket_row=options.bracket_row, fit=options.fit)
        models = list(pool)
    if not models:
        raise ValueError("an empty model pool; expected at least one model")
    problem = _Problem(window, graph, options)

    unary = problem.unary(models)
    labels = np.full(len(window), unary.sum(axis=0).argmin())  # the one motion that explains the window best
    energy = problem.energy(labels, unary)
    trace = [energy]
    for _ in range(options.num_iter_segmentation):
        # L <- argmin_L E(L, M): alpha-expansion on (1)
        with _Stopwatch(timings, "labels"):
            labels = problem.relabel(labels, unary)
        # M <- argmin_M E(L, M): contrast maximisation on each label's events
        with _Stopwatch(timings, "models"):
            models, unary = problem.refit(labels, models, unary)
        energy = problem.energy(labels, unary)
        trace.append(energy)
        if trace[-1] == trace[-2]:
            break
    return Segmentation(labels, models, energy, trace, timings)


@dataclass(frozen=True)
class _Problem:
    """What stays fixed while labels and models alternate."""

    window: Window
    graph: EventGraph
    options: SegmentOptions

    def unary(self, models: list[MotionModel]) -> Integers:
        options = self.options
        return unary_costs(
            models,
            self.window,
            data_term=options.data_term,
            lambda_data=options.lambda_data,
            sigma=options.fit.sigma,
        )

    def label_cost(self, unary: Integers) -> Integers:
        return np.full(unary.shape[1], self.options.lambda_label, dtype=np.int64)

    def energy(self, labels: Integers, unary: Integers) -> int:
        return labeling_energy(
            labels,
            unary,
            self.graph,
            lambda_smooth=self.options.lambda_smooth,
            label_cost=self.label_cost(unary),
        )

    def relabel(self, labels: Integers, unary: Integers) -> Integers:
        return expansion(
            unary,
            self.graph,
            lambda_smooth=self.options.lambda_smooth,
            label_cost=self.label_cost(unary),
            initial=labels,
            max_sweeps=self.options.num_iter_labeling,
        ).labels

    def refit(
        self, labels: Integers, models: list[MotionModel], unary: Integers
    ) -> tuple[list[MotionModel], Integers]:
        """Refit each used model on its own events; keep a refit only if it lowers the energy.

        Contrast and (1) are different functions: a sharper image need not be a cheaper labelling, above all
        where one model's peak sets the scale of every data term.
        """
        energy = self.energy(labels, unary)
        for label in np.unique(labels):
            refitted, _ = refine(models[label], self.window.select(labels == label), self.options.fit)
            trial_models = [*models[:label], refitted, *models[label + 1 :]]
            trial_unary = self.unary(trial_models)
            trial_energy = self.energy(labels, trial_unary)
            if trial_energy < energy:
                models, unary, energy = trial_models, trial_unary, trial_energy
        return models, unary


class _Stopwatch:
    """Adds the CPU seconds of its block to one stage's total."""

    def __init__(self, timings: dict[str, float], stage: str) -> None:
        self._timings, self._stage = timings, stage

    def __enter__(self) -> None:
        self._start = time.process_time()

    def __exit__(self, *_: object) -> None:
        self._timings[self._stage] += time.process_time() - self._start
