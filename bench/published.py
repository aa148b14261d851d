"""The published energy of any solution, by the NumPy reference: what makes codes comparable.

    E(L, M) = sum_k 255 (1 - IWE_L(k) / IWE_max) + 30 |cut edges| + 8000 |labels used|

All solutions of a window are scored on one graph and with one IWE_max, the largest over all their models, so
that none gains by its scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.windows import BenchWindow, Published
from emseg import Segmentation, event_graph
from emseg import reference as numpy_reference
from emseg.reference.energy import published_data_term, warped_image_values

LAMBDA_SMOOTH, LAMBDA_LABEL = 30, 8000  # the settings of figures.json


@dataclass(frozen=True)
class Solution:
    """Labels (n,) that index models, below 0 for none, and the window in whose frame the models are meant."""

    labels: NDArray[np.int64]
    models: list[numpy_reference.MotionModel]
    window: numpy_reference.Window


def reference_window(
    window: BenchWindow, *, t_ref: float | None = None, centre: tuple[float, float] | None = None
) -> numpy_reference.Window:
    """The window as the NumPy reference takes it."""
    events, camera = window.events, window.camera
    lens = None
    if camera is not None:
        lens = numpy_reference.Camera(
            camera.fx, camera.fy, camera.cx, camera.cy, distortion=camera.distortion
        )
    return numpy_reference.make_window(
        events.x,
        events.y,
        events.t,
        width=events.width,
        height=events.height,
        camera=lens,
        t_ref=t_ref,
        centre=centre,
    )


def our_solution(window: BenchWindow, found: Segmentation) -> Solution:
    """The engine's."""
    models = [numpy_reference.MotionModel(model.kind, tuple(model.params.tolist())) for model in found.models]
    return Solution(found.labels.astype(np.int64), models, reference_window(window, t_ref=found.t_ref))


def published_solution(window: BenchWindow, published: Published) -> Solution:
    """The published code's: similarities about pixel (0, 0), t_ref at the first event.

    Its labels are numbered by size, not as its pool: each takes the model of the pool that fits its events
    best.
    """
    pool = [numpy_reference.MotionModel("similarity", tuple(params)) for params in published.pool.tolist()]
    frame = reference_window(window, t_ref=float(window.events.t[0]), centre=(0.0, 0.0))
    sharpness = np.stack([warped_image_values(model, frame)[0] for model in pool])
    own = [published.labels == label for label in range(published.labels.max() + 1)]
    models = [pool[sharpness[:, events].sum(axis=1).argmax()] for events in own]
    return Solution(published.labels, models, frame)


def published_energies(window: BenchWindow, solutions: Sequence[Solution]) -> list[int]:
    """Energy of each solution.  An event without a label takes the used one of least data cost."""
    graph = numpy_reference.EventGraph(*(column.astype(np.int64) for column in event_graph(window.events)))
    used = [np.unique(solution.labels[solution.labels >= 0]) for solution in solutions]
    values = []
    peaks: list[float] = []
    for solution, labels in zip(solutions, used, strict=True):
        columns = [warped_image_values(solution.models[label], solution.window) for label in labels]
        values.append(np.stack([column for column, _ in columns], axis=1))
        peaks.extend(peak for _, peak in columns)
    energies = []
    for solution, labels, sharpness in zip(solutions, used, values, strict=True):
        unary = np.rint(published_data_term(sharpness, max(peaks))).astype(np.int64)
        index = np.where(solution.labels >= 0, np.searchsorted(labels, solution.labels), unary.argmin(axis=1))
        cost = np.full(len(labels), LAMBDA_LABEL)
        energies.append(
            numpy_reference.labeling_energy(index, unary, graph, lambda_smooth=LAMBDA_SMOOTH, label_cost=cost)
        )
    return energies
