"""The space-time graph: which events are neighbours.

Source: Zhou, Gallego, Lu, Liu, Shen, "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts",
TNNLS 2021.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class EventGraph:
    """Undirected graph in compressed rows: each edge stands once, in the row of its smaller end, sorted."""

    indptr: Integers  # (sites + 1,)
    indices: Integers  # (edges,)

    @property
    def edges(self) -> Integers:
        """Pairs (i, j), i < j, sorted, (edges, 2)."""
        tails = np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))
        return np.column_stack([tails, self.indices])


def graph_of_edges(pairs: Integers, site_count: int) -> EventGraph:
    """Compressed rows of pairs (m, 2) in any order and direction; repeated edges count once."""
    pairs = np.unique(np.sort(pairs.reshape(-1, 2), axis=1), axis=0)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(pairs[:, 0], minlength=site_count))])
    return EventGraph(indptr.astype(np.int64), pairs[:, 1].astype(np.int64))


def delaunay_edges(pixels: Integers) -> Integers:
    """Edges (m, 2) of a Delaunay triangulation of distinct pixels (n, 2), each once.

    Pixels on one line give the path along it; one pixel or none gives no edge.
    """
    count = len(pixels)
    if count < 2:
        return np.empty((0, 2), dtype=np.int64)
    along = pixels - pixels[0]
    farthest = along[np.argmax((along**2).sum(axis=1))]
    if not (along[:, 0] * farthest[1] - along[:, 1] * farthest[0]).any():
        order = np.argsort(along @ farthest)
        return np.column_stack([order[:-1], order[1:]])
    triangles = Delaunay(pixels).simplices
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.asarray(np.unique(np.sort(sides, axis=1), axis=0), dtype=np.int64)


def build_event_graph(pixel: Integers) -> EventGraph:
    """The graph over events at pixels (n, 2), given in time order.

    Each event is joined to its predecessor and successor at its own pixel and, for every Delaunay neighbour
    of that pixel, to the last event before it and the first after it there.  Before and after go by the
    events' order, which is time with ties broken by position in the array.
    """
    active, pixel_of_event = np.unique(pixel, axis=0, return_inverse=True)
    by_pixel = np.argsort(pixel_of_event.ravel(), kind="stable")
    bounds = np.cumsum(np.bincount(pixel_of_event.ravel(), minlength=len(active)))[:-1]
    events_at = np.split(by_pixel, bounds)  # in time order at every active pixel

    pairs = [np.column_stack([events[:-1], events[1:]]) for events in events_at]
    for a, b in delaunay_edges(active):
        pairs.append(_temporal_neighbours(events_at[a], events_at[b]))
        pairs.append(_temporal_neighbours(events_at[b], events_at[a]))
    joined = np.concatenate(pairs) if pairs else np.empty((0, 2), dtype=np.int64)
    return graph_of_edges(joined, len(pixel))


def _temporal_neighbours(events: Integers, others: Integers) -> Integers:
    """Each event (n,) beside the last of the others before it and the first after it; both sorted."""
    first_after = np.searchsorted(others, events)
    has_after = first_after < len(others)
    has_before = first_after > 0
    return np.concatenate(
        [
            np.column_stack([events[has_after], others[first_after[has_after]]]),
            np.column_stack([events[has_before], others[first_after[has_before] - 1]]),
        ]
    )
