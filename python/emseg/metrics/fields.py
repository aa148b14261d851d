"""Figures of dense fields: depth and flow."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["depth_figures", "flow_figures"]


def depth_figures(
    truth: ArrayLike, prediction: ArrayLike, *, where: ArrayLike | None = None
) -> dict[str, float]:
    """AbsRel, RMSE and the shares within 1.25, 1.25², 1.25³ of the truth, at pixels of known depth.

    Known is a true depth that is finite and above 0; with `where` only there.  A predicted depth that is not
    finite or not above 0 is refused, so that no figure improves by leaving pixels out.

    truth, prediction: any one shape, in one unit; RMSE has that unit.  NaN without pixels.

    Source: Eigen, Puhrsch, Fergus, "Depth map prediction from a single image using a multi-scale deep
    network", NeurIPS 2014.
    """
    truth, prediction = np.asarray(truth, dtype=np.float64), np.asarray(prediction, dtype=np.float64)
    if truth.shape != prediction.shape:
        raise ValueError(f"depths of shapes {truth.shape} and {prediction.shape}; expected one shape")
    known = np.isfinite(truth) & (truth > 0) & _chosen(where, truth.shape)
    true, found = truth[known], prediction[known]
    if not (np.isfinite(found) & (found > 0)).all():
        raise ValueError("a predicted depth that is not above 0; expected one wherever the truth is known")
    ratio = np.maximum(true / found, found / true)
    return {
        "abs_rel": _mean(np.abs(found - true) / true),
        "rmse": _mean((found - true) ** 2) ** 0.5,
        "delta_1": _mean(ratio < 1.25),
        "delta_2": _mean(ratio < 1.25**2),
        "delta_3": _mean(ratio < 1.25**3),
        "pixels": float(len(true)),
    }


def flow_figures(
    truth: ArrayLike, prediction: ArrayLike, *, where: ArrayLike | None = None
) -> dict[str, float]:
    """Mean end-point error in px (EPE), and the share in per cent of errors above 3 px (3PE).

    Over the pixels where the truth is finite; with `where`, such as the pixels with events, only there.

    truth, prediction: (..., 2), px.  NaN without pixels.

    Source: Zhu, Yuan, Chaney, Daniilidis, "EV-FlowNet", RSS 2018, and the benchmark of DSEC.
    """
    truth, prediction = np.asarray(truth, dtype=np.float64), np.asarray(prediction, dtype=np.float64)
    if truth.shape != prediction.shape or truth.shape[-1:] != (2,):
        raise ValueError(f"flows of shapes {truth.shape} and {prediction.shape}; expected (..., 2) of both")
    known = np.isfinite(truth).all(axis=-1) & _chosen(where, truth.shape[:-1])
    error = np.linalg.norm(prediction[known] - truth[known], axis=-1)
    if not np.isfinite(error).all():
        raise ValueError("a predicted flow that is not finite; expected one wherever the truth is known")
    return {"epe": _mean(error), "3pe": 100 * _mean(error > 3), "pixels": float(len(error))}


def _chosen(where: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    if where is None:
        return np.ones(shape, dtype=bool)
    chosen = np.asarray(where, dtype=bool)
    if chosen.shape != shape:
        raise ValueError(f"pixels to score of shape {chosen.shape}; expected {shape}")
    return chosen


def _mean(values: NDArray[np.float64] | NDArray[np.bool_]) -> float:
    return float(values.mean()) if values.size else float("nan")
