"""Figures of tracks: whether an object keeps one identity through a recording."""

from __future__ import annotations

from collections.abc import Iterable

from numpy.typing import ArrayLike

from emseg.metrics.events import MIN_EVENTS, matched_labels

__all__ = ["Identities", "identity_switches"]


class Identities:
    """The tracks that true objects were given, window after window.

    In a window an object of at least min_events events has the moving label that is matched to it one to one
    (see :func:`emseg.metrics.event_object_iou`), if they share at least min_events events.  A switch is a
    track that differs from the object's last one: windows in between in which it has none are no switch by
    themselves, as in CLEAR MOT (Bernardin, Stiefelhagen, 2008).
    """

    def __init__(self, *, min_events: int = MIN_EVENTS) -> None:
        self._min_events = min_events
        self._last: dict[int, int] = {}
        self._switches: dict[int, int] = {}
        self._seen: dict[int, int] = {}
        self._tracked: dict[int, int] = {}

    def add(self, truth: ArrayLike, prediction: ArrayLike) -> None:
        """Take the next window: true motions and track ids per event, (n,)."""
        for true_object, (label, _, shared) in matched_labels(
            truth, prediction, min_events=self._min_events
        ).items():
            self._seen[true_object] = self._seen.get(true_object, 0) + 1
            self._switches.setdefault(true_object, 0)
            if label <= 0 or shared < self._min_events:
                continue
            self._tracked[true_object] = self._tracked.get(true_object, 0) + 1
            if self._last.get(true_object, label) != label:
                self._switches[true_object] += 1
            self._last[true_object] = label

    @property
    def switches(self) -> dict[int, int]:
        """Switches of each object seen."""
        return dict(self._switches)

    @property
    def tracked(self) -> dict[int, float]:
        """Share of the windows with an object in which it has a track."""
        return {number: self._tracked.get(number, 0) / seen for number, seen in self._seen.items()}


def identity_switches(
    windows: Iterable[tuple[ArrayLike, ArrayLike]], *, min_events: int = MIN_EVENTS
) -> dict[int, int]:
    """Switches of each true object over successive windows (truth, prediction); see Identities."""
    identities = Identities(min_events=min_events)
    for truth, prediction in windows:
        identities.add(truth, prediction)
    return identities.switches
