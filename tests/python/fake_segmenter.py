"""A segmenter that is quick and always right about its own rule, for tests of what is around the real one."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from emseg.events import EventArray
from emseg.render import BOX_DTYPE


@dataclass
class FakeModel:
    kind: str
    params: Any
    label: int


@dataclass
class FakeSegmentation:
    events: EventArray
    start: int
    stop: int
    models: list[FakeModel] = field(
        default_factory=lambda: [FakeModel("translation", np.array([k, 2.0 * k]), k) for k in (0, 1, 2)]
    )
    energy: float = 12.5
    energy_trace: tuple[float, ...] = (20.0, 12.5)
    thinned: int = 100
    timings: dict[str, float] = field(default_factory=lambda: {"graph": 0.25, "labels": 0.5})

    @property
    def t_ref(self) -> int:
        return int(self.events.t[len(self.events) // 2])

    @property
    def labels(self) -> Any:
        """1 in the left upper quarter, 2 in the right lower one, noise in the lowest row, else background."""
        x, y = self.events.x, self.events.y
        labels = np.zeros(len(self.events), np.int32)
        labels[(x < self.events.width // 2) & (y < self.events.height // 2)] = 1
        labels[(x >= self.events.width // 2) & (y >= self.events.height // 2)] = 2
        labels[y == self.events.height - 1] = -1
        return labels

    @property
    def boxes(self) -> Any:
        width, height = self.events.width / 2, self.events.height / 2
        return np.array([(1, 0, 0, width, height), (2, width, height, width, height)], BOX_DTYPE)

    def iwe(self, label: int | None = None) -> Any:
        image = np.zeros((self.events.height, self.events.width), np.float32)
        chosen = slice(None) if label is None else self.labels == label
        np.add.at(image, (self.events.y[chosen], self.events.x[chosen]), 1)
        return image


def whole(chunks: Iterable[EventArray]) -> EventArray:
    nothing = EventArray([], [], [], [], width=64, height=48)
    return EventArray.concatenate(list(chunks) or [nothing])


class FakeSegmenter:
    window = 500

    def __init__(self, *, width: int, height: int, camera: Any, config: Any) -> None:
        assert (camera.width, camera.height) == (width, height) if camera is not None else True
        self.config = config

    def run(self, chunks: Iterable[EventArray]) -> Iterator[FakeSegmentation]:
        events = whole(chunks)
        for start in range(0, len(events), self.window):
            stop = min(start + self.window, len(events))
            yield FakeSegmentation(events[start:stop], start, stop)


class DyingSegmenter(FakeSegmenter):
    """Takes the process with it where the recording has an odd number of events."""

    def run(self, chunks: Iterable[EventArray]) -> Iterator[FakeSegmentation]:
        events = whole(chunks)
        if len(events) % 2:
            os._exit(9)
        return super().run([events])


class RaisingSegmenter(FakeSegmenter):
    def run(self, chunks: Iterable[EventArray]) -> Iterator[FakeSegmentation]:
        raise RuntimeError("two\nlines")


class SlowSegmenter(FakeSegmenter):
    """Takes its time, so that something can happen in the midst of a run."""

    seconds = 0.2

    def run(self, chunks: Iterable[EventArray]) -> Iterator[FakeSegmentation]:
        for found in super().run(chunks):
            time.sleep(self.seconds)
            yield found
