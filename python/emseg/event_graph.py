"""The space-time graph that joins every event to its neighbours in space and time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from emseg import _core


class Events(Protocol):
    """What the graph needs to know of events; an `EventArray` has it."""

    @property
    def x(self) -> NDArray[np.uint16]: ...  # noqa: D102
    @property
    def y(self) -> NDArray[np.uint16]: ...  # noqa: D102
    @property
    def t(self) -> NDArray[np.int64]: ...  # noqa: D102
    @property
    def p(self) -> NDArray[np.uint8]: ...  # noqa: D102
    @property
    def width(self) -> int: ...  # noqa: D102
    @property
    def height(self) -> int: ...  # noqa: D102


class EventGraph(NamedTuple):
    """An undirected graph over n events in compressed rows.

    Each edge {i, j} is stored once, in the row of its smaller end, and rows are sorted:
    `indices[indptr[i]:indptr[i + 1]]` are the neighbours j > i of event i.
    """

    indptr: NDArray[np.int64]
    """Starts of the rows, (n + 1,)."""
    indices: NDArray[np.int32]
    """Larger ends of the edges, (edges,)."""


def event_graph(events: Events) -> EventGraph:
    """Build the space-time graph of a window.

    The pixels that hold events are triangulated (Delaunay).  Each event is joined to its predecessor and
    its successor at its own pixel and, at each of the N neighbouring pixels, to the last event before it
    and the first after it: up to 2 + 2N neighbours.  Before and after go by position in the array.

    Args:
        events: columns x, y (uint16, px), t (int64, µs), p (uint8) of one length, and the sensor's width
            and height in px.

    Raises:
        ValueError: columns differ in length, or an event lies outside the sensor.

    Source: Zhou et al., "Event-based Motion Segmentation with Spatio-Temporal Graph Cuts", TNNLS 2021, III-B.
    """
    return EventGraph(*_core.event_graph(events.x, events.y, events.t, events.p, events.width, events.height))
