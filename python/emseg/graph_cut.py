"""Minimum cuts and labelling by alpha-expansion: the Python verbs of the native solvers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emseg import _core

__all__ = ["expansion", "labeling_energy", "max_flow"]

_INT32_MAX = 2**31 - 1
_INT64_MAX = 2**63 - 1
_LARGEST_SUM = 2**62  # as in the core
# Rounded sums stay below 2**51 units, so that energies and flows are exact as Python floats too.
_FIXED_POINT_BITS = 51
_MAX_EXPONENT = 1000  # of a scale; 2.0**1024 is no float


def max_flow(
    n: int,
    edges: ArrayLike,
    capacity: ArrayLike,
    reverse: ArrayLike,
    source: ArrayLike,
    sink: ArrayLike,
) -> tuple[int | float, NDArray[np.bool_]]:
    """Value of a maximum flow, and the minimum cut with the fewest nodes on the sink's side.

    Args:
        n: number of nodes.
        edges: (m, 2) integers; edge e joins nodes ``edges[e, 0]`` and ``edges[e, 1]``.
        capacity: (m,) or scalar, along the edges, >= 0.
        reverse: (m,) or scalar, against the edges, >= 0.
        source: (n,) capacities from the source to every node; or the number of the node that is the source.
        sink: (n,) capacities from every node to the sink; or the number of the node that is the sink.

    Returns:
        ``(flow, cut)``. ``cut`` is (n,) bool, True on the sink's side: where the sink can be reached through
        residual arcs. Integer capacities give an exact ``int``. Float capacities are rounded to multiples of
        the smallest power of two of which they sum to less than 2**51 units, and give a ``float``.

    Raises:
        ValueError: shapes that do not fit, nodes out of range, negative, infinite or NaN capacities, sums
            beyond 2**62.

    Source: Goldberg et al., "Maximum Flows by Incremental Breadth-First Search", ESA 2011.
    """
    if n < 0:
        raise ValueError(f"n is {n}, expected at least 0 nodes")
    pairs = _integers("edges", edges, np.int32)
    if pairs.size == 0:
        pairs = pairs.reshape(0, 2)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ValueError(f"edges have shape {pairs.shape}, expected (m, 2)")
    m = len(pairs)
    terminal_nodes = [isinstance(terminal, (int, np.integer)) for terminal in (source, sink)]
    if terminal_nodes[0] != terminal_nodes[1]:
        raise ValueError(
            "source and sink differ in kind, expected two node numbers or two arrays of capacities"
        )

    along = _broadcast("capacity", _numbers("capacity", capacity), (m,))
    against = _broadcast("reverse", _numbers("reverse", reverse), (m,))
    if all(terminal_nodes):
        ends = _terminal_nodes(n, source, sink)
        from_source, to_sink = np.zeros(n, np.int64), np.zeros(n, np.int64)
    else:
        ends = None
        from_source = _of_shape("source", _numbers("source", source), (n,))
        to_sink = _of_shape("sink", _numbers("sink", sink), (n,))
    total = _total(along) + _total(against) + _total(from_source) + _total(to_sink)
    if total > _LARGEST_SUM and all(
        part.dtype.kind == "i" for part in (along, against, from_source, to_sink)
    ):
        raise ValueError(f"capacities sum to {total:.3g}, expected at most 2**62")
    parts = (along, against, from_source, to_sink)
    exponent = _exponent(parts, total)
    along, against, from_source, to_sink = (_quantised(part, exponent) for part in parts)
    if ends is not None:
        for terminal, node in ((from_source, ends[0]), (to_sink, ends[1])):
            touching = (pairs == node).any(axis=1)  # no flow passes a terminal that its edges cannot carry
            terminal[node] = along[touching].sum() + against[touching].sum()

    flow, sink_side = _core.max_flow(
        np.ascontiguousarray(pairs[:, 0]),
        np.ascontiguousarray(pairs[:, 1]),
        *(np.ascontiguousarray(part, np.int64) for part in (along, against, from_source, to_sink)),
    )
    return _in_units(flow, exponent), sink_side.view(np.bool_)


def expansion(
    unary: ArrayLike,
    indptr: ArrayLike,
    indices: ArrayLike,
    weight: ArrayLike,
    label_cost: ArrayLike,
    init: ArrayLike | None = None,
    *,
    max_sweeps: int = 100,
) -> tuple[NDArray[np.int32], int | float]:
    """Labels of low energy by alpha-expansion: data costs, Potts costs and label costs.

    The energy of labels L is ``sum_k unary[k, L[k]]``, plus ``weight[e]`` for every stored entry e of the
    compressed rows whose two sites have different labels, plus ``label_cost[l]`` for every label l in use.
    Every expansion is optimal, label costs included, and the energy never rises. From 1000 sites on,
    labels of groups of neighbours are found first, and are where the sites start if they are better.

    Args:
        unary: (n, labels) data costs; may be negative.
        indptr: (n + 1,) row starts of the graph's compressed rows.
        indices: (m,) neighbours; every entry is one edge, in either direction; self loops cost nothing.
        weight: (m,) or scalar, >= 0.
        label_cost: (labels,) or scalar, >= 0.
        init: (n,) labels to start from; by default each site's cheapest.
        max_sweeps: sweeps over all labels at most; the search ends as soon as no label brings anything.

    Returns:
        ``(labels, energy)``: (n,) int32, and the energy. With integers all is exact in 64 bits and ``energy``
        is an ``int``. If any input is of floats, all costs are rounded to multiples of 2**-k, with the
        largest k for which the absolute costs of the whole problem sum to less than 2**51 such units;
        ``energy`` is then a ``float``, the exact energy of the rounded costs.

    Raises:
        ValueError: shapes, labels or rows that do not fit; negative weights or label costs; infinite or NaN
            costs; integer costs whose sums could leave 64 bits.

    Sources: Boykov, Veksler, Zabih, PAMI 2001; Delong, Osokin, Isack, Boykov, IJCV 2012.
    """
    problem, exponent = _problem(unary, indptr, indices, weight, label_cost)
    initial = np.zeros(0, np.int32) if init is None else _labels("init", init, len(problem[2]) - 1)
    solve: Callable[..., Any] = _core.expansion  # 32 or 64 bits, by the type of the costs
    labels, energy, _ = solve(*problem, initial, min(max_sweeps, _INT32_MAX))
    return labels, _in_units(energy, exponent)


def labeling_energy(
    unary: ArrayLike,
    indptr: ArrayLike,
    indices: ArrayLike,
    weight: ArrayLike,
    label_cost: ArrayLike,
    labels: ArrayLike,
) -> int | float:
    """Energy of (n,) ``labels``; the other arguments, the type and the errors are :func:`expansion`'s."""
    problem, exponent = _problem(unary, indptr, indices, weight, label_cost)
    evaluate: Callable[..., int] = _core.labeling_energy
    energy = evaluate(*problem, _labels("labels", labels, len(problem[2]) - 1))
    return _in_units(energy, exponent)


def _problem(
    unary: ArrayLike, indptr: ArrayLike, indices: ArrayLike, weight: ArrayLike, label_cost: ArrayLike
) -> tuple[tuple[Any, ...], int | None]:
    """The core's description of a problem, and the exponent of its fixed point, None for integers."""
    data = _numbers("unary", unary)
    if data.ndim != 2 or data.shape[1] == 0:
        raise ValueError(f"unary has shape {data.shape}, expected (sites, labels) with at least one label")
    rows = _vector("indptr", _integers("indptr", indptr, np.int64))
    if len(rows) != len(data) + 1:
        raise ValueError(
            f"indptr has {len(rows)} entries, expected {len(data) + 1}, one more than unary has rows"
        )
    neighbours = _vector("indices", _integers("indices", indices, np.int32))
    weights = _vector("weight", np.atleast_1d(_numbers("weight", weight)))
    costs = _vector("label_cost", np.atleast_1d(_numbers("label_cost", label_cost)))

    exponent = None
    if any(part.dtype.kind == "f" for part in (data, weights, costs)):
        total = _total(data)
        total += _total(weights) * (len(neighbours) if len(weights) == 1 else 1)
        total += _total(costs) * (data.shape[1] if len(costs) == 1 else 1)
        exponent = _exponent((data, weights, costs), total)
    data, weights, costs = (_quantised(part, exponent) for part in (data, weights, costs))
    dtype = np.int32 if _fits_int32(data) and _fits_int32(weights) else np.int64
    problem = (
        data.shape[1],
        np.ascontiguousarray(data, dtype),
        rows,
        neighbours,
        np.ascontiguousarray(weights, dtype),
        np.ascontiguousarray(costs, np.int64),
    )
    return problem, exponent


def _labels(name: str, labels: ArrayLike, n: int) -> NDArray[np.int32]:
    checked = _integers(name, labels, np.int32)
    if checked.shape != (n,):
        raise ValueError(f"{name} has shape {checked.shape}, expected ({n},), one label per site")
    return checked


def _terminal_nodes(n: int, source: Any, sink: Any) -> tuple[int, int]:
    for name, node in (("source", source), ("sink", sink)):
        if not 0 <= node < n:
            raise ValueError(f"{name} is node {node}, expected 0..{n - 1}")
    if source == sink:
        raise ValueError(f"source and sink are the same node {source}, expected two different nodes")
    return int(source), int(sink)


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    """Contiguous int32, int64 or float64; finite."""
    array = np.asarray(values)
    if array.dtype == np.bool_ or array.dtype.kind in "iu":
        if array.dtype == np.uint64 and array.size and int(array.max()) > _INT64_MAX:
            raise ValueError(f"{name} holds {array.max()}, expected at most 2**63 - 1")
        return array if array.dtype in (np.int32, np.int64) else array.astype(np.int64)
    if array.size == 0:
        return array.astype(np.int64)
    if array.dtype.kind != "f":
        raise ValueError(f"{name} is of type {array.dtype}, expected integers or floats")
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        place = np.unravel_index(int(np.argmin(np.isfinite(array))), array.shape)
        raise ValueError(f"{name}{list(map(int, place))} is {array[place]}, expected a finite number")
    return array


def _integers(name: str, values: ArrayLike, dtype: type[np.signedinteger[Any]]) -> NDArray[Any]:
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"{name} is of type {array.dtype}, expected integers")
    if array.size and array.dtype != dtype:
        least, most = int(array.min()), int(array.max())
        bounds = np.iinfo(dtype)
        if least < bounds.min or most > bounds.max:
            raise ValueError(
                f"{name} holds {least if least < bounds.min else most}, out of {bounds.dtype}'s range"
            )
    return np.ascontiguousarray(array, dtype)


def _vector(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim != 1:
        raise ValueError(f"{name} has shape {array.shape}, expected one dimension")
    return array


def _of_shape(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    return array


def _broadcast(name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.full(shape, array[()]) if array.ndim == 0 else _of_shape(name, array, shape)


def _total(array: NDArray[Any]) -> float:
    """Sum of absolute values in floating point, to choose a scale; the core checks integers exactly."""
    return float(np.abs(array, dtype=np.float64).sum())


def _exponent(parts: tuple[NDArray[Any], ...], total: float) -> int | None:
    """k of the fixed point 2**-k if any part is of floats, else None."""
    if all(part.dtype.kind == "i" for part in parts):
        return None
    if not math.isfinite(total):
        raise ValueError("the sum of all costs is beyond the range of floats, expected a finite sum")
    if total == 0:
        return 0
    return max(-_MAX_EXPONENT, min(_MAX_EXPONENT, _FIXED_POINT_BITS - math.frexp(total)[1]))


def _quantised(array: NDArray[Any], exponent: int | None) -> NDArray[Any]:
    """Integers as they are, or all values in units of 2**-exponent as int64."""
    if exponent is None:
        return array
    return np.rint(np.ldexp(array.astype(np.float64), exponent)).astype(np.int64)


def _fits_int32(array: NDArray[Any]) -> bool:
    if array.dtype == np.int32 or array.size == 0:
        return True
    return int(array.min()) >= -_INT32_MAX - 1 and int(array.max()) <= _INT32_MAX


def _in_units(value: int, exponent: int | None) -> int | float:
    return int(value) if exponent is None else math.ldexp(value, -exponent)
