"""The energy of a labelling, in integers.

    (1)  E(L, M) = sum_k round(lambda_D D(e_k, M_L(k)))
                   + lambda_P sum_(i,j) in N [L_i != L_j]
                   + lambda_M |labels used|

Sources: Zhou et al., TNNLS 2021 (data and Potts terms); Delong, Osokin, Isack, Boykov, IJCV 2012
(label costs).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emseg.reference.graph import EventGraph
from emseg.reference.iwe import bilinear_lookup, iwe
from emseg.reference.warp import MotionModel, warp
from emseg.reference.window import Window

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MAX_COST = 255.0  # of one event, before lambda_D
LOG_FLOOR = 0.05  # share of G_ref below which the logarithm flattens: what passes by chance
LOG_QUANTILE = 0.95  # of the events' best sharpness: what costs nothing


def warped_image_values(model: MotionModel, window: Window, *, sigma: float = 1.0) -> tuple[Floats, float]:
    """G(e, m) (n,): the image of all events warped by m, looked up where m takes each; and its peak.

    The image covers the canvas: see `ImageFrame.canvas`.
    """
    canvas = window.frame.canvas
    image = iwe(model, window, sigma=sigma, region=canvas)
    return bilinear_lookup(image, warp(model, window) - [canvas.x0, canvas.y0]), float(image.max())


def published_data_term(values: Floats, reference: float) -> Floats:
    """(2)  D(e, m) = 255 (1 - g), g = min(1, G(e, m) / G_ref), (n, models)."""
    return MAX_COST * (1 - _share(values, reference))


def logarithmic_data_term(values: Floats, reference: float) -> Floats:
    """(3)  D(e, m) = 255 log((1 + f) / (g + f)) / log((1 + f) / f), f = 0.05, g as in (2), (n, models)."""
    drop = np.log((1 + LOG_FLOOR) / (_share(values, reference) + LOG_FLOOR))
    return np.asarray(MAX_COST * drop / np.log((1 + LOG_FLOOR) / LOG_FLOOR), dtype=np.float64)


def _share(values: Floats, reference: float) -> Floats:
    # Where no model's image holds an event, none of them costs anything.
    return np.minimum(1.0, values / reference) if reference > 0 else np.ones_like(values)


DATA_TERMS = {"published": published_data_term, "logarithmic": logarithmic_data_term}


def reference_sharpness(values: Floats, peaks: Sequence[float], *, data_term: str) -> float:
    """G_ref of models with G (n, models) and peaks (models,).

    "published": the largest pixel of any model's image.  "logarithmic": the 95 % quantile over the events of
    the best that any model gives each, so that no hot pixel sets the scale.
    """
    if data_term == "published":
        return max(peaks)
    return float(np.quantile(values.max(axis=1), LOG_QUANTILE))


def unary_costs(
    models: Sequence[MotionModel],
    window: Window,
    *,
    data_term: str = "published",
    lambda_data: float = 1.0,
    sigma: float = 1.0,
    reference: float | None = None,
) -> Integers:
    """round(lambda_D D(e_k, m)), int64 (n, models).  `reference` is G_ref, by default these models' own."""
    return np.rint(
        data_costs(
            models, window, data_term=data_term, lambda_data=lambda_data, sigma=sigma, reference=reference
        )
    ).astype(np.int64)


def data_costs(
    models: Sequence[MotionModel],
    window: Window,
    *,
    data_term: str = "published",
    lambda_data: float = 1.0,
    sigma: float = 1.0,
    reference: float | None = None,
) -> Floats:
    """lambda_D D(e_k, m) before it is rounded, (n, models).  The arguments are those of `unary_costs`."""
    if data_term not in DATA_TERMS:
        raise ValueError(f"data term {data_term!r}; expected 'published' or 'logarithmic'")
    columns, peaks = zip(*[warped_image_values(model, window, sigma=sigma) for model in models], strict=True)
    values = np.stack(columns, axis=1)
    if reference is None:
        reference = reference_sharpness(values, peaks, data_term=data_term)
    return lambda_data * DATA_TERMS[data_term](values, reference)


def labeling_energy(
    labels: ArrayLike, unary: Integers, graph: EventGraph, *, lambda_smooth: int, label_cost: Integers
) -> int:
    """Equation (1) for labels (n,), unary (n, models) and the cost of using each label (models,)."""
    labels = np.asarray(labels)
    i, j = graph.edges.T
    data = unary[np.arange(len(labels)), labels].sum()
    potts = lambda_smooth * np.count_nonzero(labels[i] != labels[j])
    return int(data) + int(potts) + int(label_cost[np.unique(labels)].sum())
