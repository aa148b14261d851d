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
LOG_SCALE = 60.0  # cost of a drop of the warped image by a factor e
LOG_FLOOR = 0.15  # events per pixel below which the logarithm flattens
LOG_QUANTILE = 0.95  # of the events' best values: the value that costs nothing


def warped_image_values(model: MotionModel, window: Window, *, sigma: float = 1.0) -> tuple[Floats, float]:
    """G(e, m) (n,): the image of all events warped by m, looked up where m takes each; and its peak."""
    image = iwe(model, window, sigma=sigma)
    return bilinear_lookup(image, warp(model, window)), float(image.max())


def published_data_term(values: Floats, peak: float) -> Floats:
    """(2)  D(e, m) = 255 (1 - IWE_m(x') / IWE_max), (n, models); peak = IWE_max, of all models' images."""
    return MAX_COST * (1 - values / peak) if peak > 0 else np.full_like(values, MAX_COST)


def logarithmic_data_term(values: Floats) -> Floats:
    """(3)  D(e, m) = 60 log((G_ref + .15) / (G + .15)) clipped to 0 .. 255, (n, models).

    G_ref is the 95 % quantile over the events of their best value, so that no hot pixel sets the scale.
    """
    reference = float(np.quantile(values.max(axis=1), LOG_QUANTILE))
    cost = LOG_SCALE * np.log((reference + LOG_FLOOR) / (values + LOG_FLOOR))
    return np.clip(cost, 0.0, MAX_COST)


def unary_costs(
    models: Sequence[MotionModel],
    window: Window,
    *,
    data_term: str = "published",
    lambda_data: float = 1.0,
    sigma: float = 1.0,
) -> Integers:
    """round(lambda_D D(e_k, m)), int64 (n, models)."""
    columns, peaks = zip(*[warped_image_values(model, window, sigma=sigma) for model in models], strict=True)
    values = np.stack(columns, axis=1)
    if data_term == "published":
        cost = published_data_term(values, max(peaks))
    elif data_term == "logarithmic":
        cost = logarithmic_data_term(values)
    else:
        raise ValueError(f"data term {data_term!r}; expected 'published' or 'logarithmic'")
    return np.rint(lambda_data * cost).astype(np.int64)


def labeling_energy(
    labels: ArrayLike, unary: Integers, graph: EventGraph, *, lambda_smooth: int, label_cost: Integers
) -> int:
    """Equation (1) for labels (n,), unary (n, models) and the cost of using each label (models,)."""
    labels = np.asarray(labels)
    i, j = graph.edges.T
    data = unary[np.arange(len(labels)), labels].sum()
    potts = lambda_smooth * np.count_nonzero(labels[i] != labels[j])
    return int(data) + int(potts) + int(label_cost[np.unique(labels)].sum())
