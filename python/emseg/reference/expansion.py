"""Alpha-expansion with label costs: each move is one minimum cut, found by PyMaxflow.

Sources: Boykov, Veksler, Zabih, PAMI 2001 (expansion moves); Kolmogorov, Zabih, PAMI 2004 (which energies a
cut minimises); Delong, Osokin, Isack, Boykov, IJCV 2012 (label costs through one hub node a label).
"""

from __future__ import annotations

from dataclasses import dataclass

import maxflow
import numpy as np
from numpy.typing import ArrayLike, NDArray

from emseg.reference.energy import labeling_energy
from emseg.reference.graph import EventGraph

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class ExpansionResult:
    """Labels (n,), their energy, and the energy before the first sweep and after each."""

    labels: Integers
    energy: int
    energy_trace: list[int]


def expansion(
    unary: Integers,
    graph: EventGraph,
    *,
    lambda_smooth: int,
    label_cost: ArrayLike,
    initial: ArrayLike | None = None,
    max_sweeps: int = 2,
) -> ExpansionResult:
    """Sweeps over all labels until one changes nothing; the energy never rises.

    unary int (n, labels); label_cost int (labels,).  Without initial labels (n,) each site
    takes its cheapest.
    """
    cost = np.asarray(label_cost, dtype=np.int64)
    labels = unary.argmin(axis=1) if initial is None else np.array(initial, dtype=np.int64)
    energy = labeling_energy(labels, unary, graph, lambda_smooth=lambda_smooth, label_cost=cost)
    trace = [energy]
    for _ in range(max_sweeps):
        for alpha in range(unary.shape[1]):
            proposal = expansion_move(
                labels, alpha, unary, graph, lambda_smooth=lambda_smooth, label_cost=cost
            )
            proposed = labeling_energy(proposal, unary, graph, lambda_smooth=lambda_smooth, label_cost=cost)
            # The move's cut counts alpha's own cost as paid; it is due only where alpha is new.  All moves
            # but the empty one pay it, so the best of them is the cut's, and comparing with the empty one
            # settles it.
            if proposed < energy:
                labels, energy = proposal, proposed
        trace.append(energy)
        if trace[-1] == trace[-2]:
            break
    return ExpansionResult(labels, energy, trace)


def expansion_move(
    labels: Integers,
    alpha: int,
    unary: Integers,
    graph: EventGraph,
    *,
    lambda_smooth: int,
    label_cost: Integers,
) -> Integers:
    """Labels (n,) of least energy among those where each site keeps its label or takes alpha.

    Alpha's own cost is left out: see `expansion`.
    Node k is on the sink's side of the cut if site k takes alpha.
    """
    movable = np.flatnonzero(labels != alpha)
    if len(movable) == 0:
        return labels.copy()
    node = np.full(len(labels), -1)
    node[movable] = np.arange(len(movable))

    keep = unary[movable, labels[movable]]  # paid by a site on the source's side: arc site -> sink
    take = unary[movable, alpha]  # paid by a site on the sink's side: arc source -> site

    # Potts edges.  An edge to a fixed alpha site costs the other end lambda_P if it keeps its label.  Between
    # two movable sites: equal labels pay if one leaves; different labels pay unless both take alpha, which is
    # lambda_P (1 - x_i x_j) = lambda_P (1 - x_i) + lambda_P x_i (1 - x_j).
    i, j = graph.edges.T
    fixed_i, fixed_j = node[i] < 0, node[j] < 0
    np.add.at(keep, node[i[fixed_j & ~fixed_i]], lambda_smooth)
    np.add.at(keep, node[j[fixed_i & ~fixed_j]], lambda_smooth)
    both = ~fixed_i & ~fixed_j
    i, j = i[both], j[both]
    equal = labels[i] == labels[j]
    np.add.at(keep, node[i[~equal]], lambda_smooth)

    hubs = [beta for beta in np.unique(labels[movable]) if label_cost[beta] > 0]
    network = maxflow.GraphInt(len(movable) + len(hubs), len(i) + len(movable))
    sites = network.add_nodes(len(movable))
    network.add_grid_tedges(sites, take, keep)
    forward = np.where(equal, lambda_smooth, 0)  # i keeps, j takes: arc i -> j
    network.add_edges(node[i], node[j], forward, np.full(len(i), lambda_smooth))

    # Label beta's cost is saved only if all its sites take alpha: its hub, on the sink's side, saves it, and
    # no site of beta may then stay on the source's side.  An arc of the cost itself is enough to forbid that.
    for beta in hubs:
        (hub,) = network.add_nodes(1)
        network.add_tedge(hub, 0, int(label_cost[beta]))
        members = node[np.flatnonzero(labels == beta)]
        capacity = np.full(len(members), int(label_cost[beta]))
        network.add_edges(members, np.full(len(members), hub), capacity, np.zeros_like(capacity))

    network.maxflow()
    moved = labels.copy()
    moved[movable[network.get_grid_segments(sites)]] = alpha
    return moved
