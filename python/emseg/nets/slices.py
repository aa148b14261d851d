"""Event slices as training data: targets, their references and what is known of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor
from torch.utils.data import Dataset, Sampler

from emseg import _core
from emseg.events import EventArray
from emseg.nets.augmentation import augmented
from emseg.nets.losses import UNKNOWN, Batch
from emseg.nets.recordings import LabelledRecording
from emseg.nets.settings import NetworkSettings, SliceSettings, TrainingSettings

__all__ = [
    "SizedBatches",
    "SliceDataset",
    "as_channels",
    "event_slices",
    "reference_steps",
    "relative_poses",
    "shrunk_intrinsics",
]


def event_slices(events: EventArray, times: NDArray[np.int64], settings: SliceSettings) -> NDArray[np.uint8]:
    """Images around each time: 50 × rises, 255 × mean time, 50 × falls, at most 255; uint8 (n, 3, h, w)."""
    return _core.event_slices(
        events.x,
        events.y,
        events.t,
        events.p,
        events.width,
        events.height,
        np.ascontiguousarray(times, np.int64),
        round(1e6 * settings.width),
        settings.shrink(events.width, events.height),
    )


def as_channels(images: NDArray[np.uint8], channels: int) -> Tensor:
    """Images (n, 3, h, w) as networks take them, (n, channels, h, w) of 0 .. 1; one channel: 50 × events."""
    planes = torch.from_numpy(images).float()
    if channels == 1:
        planes = (planes[:, :1] + planes[:, 2:]).clamp(max=255)
    return planes / 255


def shrunk_intrinsics(K: NDArray[np.float64], shrink: int) -> NDArray[np.float64]:
    """K (3, 3) of the images of a sensor whose pixels are taken together, `shrink` each way."""
    small = K.astype(np.float64)
    small[:2, 2] -= (shrink - 1) / 2  # the centre of the first pixel of the image
    small[:2] /= shrink
    return small


def reference_steps(references: int) -> list[int]:
    """Where the references lie, in steps from the target: as many before as after, -2 -1 1 2 for four."""
    before = references // 2
    return [*range(-before, 0), *range(1, references - before + 1)]


def relative_poses(
    T_world_camera: NDArray[np.float64],
    times: NDArray[np.int64],
    target: int,
    references: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Poses (tx, ty, tz, rx, ry, rz) at the references' times, µs, in the frame of a target; (n, 6)."""
    turns = Slerp(times.astype(np.float64), Rotation.from_matrix(T_world_camera[:, :3, :3]))
    back = Rotation.from_matrix(T_world_camera[target, :3, :3]).inv()
    places = np.stack([np.interp(references, times, T_world_camera[:, axis, 3]) for axis in range(3)], axis=1)
    translation = back.apply(places - T_world_camera[target, :3, 3])
    return np.hstack([translation, (back * turns(references.astype(np.float64))).as_rotvec()])


@dataclass(frozen=True, eq=False)
class _Sequence:
    """What is kept of a recording: images at all its times, and the truth at its targets."""

    name: str
    times: NDArray[np.int64]  # of the targets
    images: NDArray[np.uint8]  # (u, 3, h, w)
    places: NDArray[np.int64]  # of each target's images: itself, then its references, (n, 1 + references)
    K: NDArray[np.float64]
    mask: NDArray[np.int16]
    depth: NDArray[np.float16]
    flow: NDArray[np.float16]
    poses: NDArray[np.float32]


class SliceDataset(Dataset[Batch]):
    """Targets of recordings, each a :class:`Batch` without its first axis.

    All slices are made at once and kept as bytes: a second of 346×260 at 40 Hz takes some 25 MB.

    Args:
        recordings: Each is read once, one after the other.
        slices: How they become images.
        network: How many references and channels.
        augmentation: How targets are mirrored and zoomed each time they are asked for; None: not.
        without_mask: What becomes of targets of whose mask nothing is known.

    Raises:
        ValueError: no target at all.
    """

    def __init__(
        self,
        recordings: Iterable[LabelledRecording],
        slices: SliceSettings,
        network: NetworkSettings,
        *,
        augmentation: TrainingSettings | None = None,
        without_mask: Literal["keep", "drop"] = "keep",
    ) -> None:
        self.slices = slices
        self.network = network
        self.augmentation = augmentation
        steps = np.array(reference_steps(network.references))
        self._offsets = torch.tensor(steps * slices.step / slices.width, dtype=torch.float32)
        steps_us = np.rint(1e6 * slices.step * steps).astype(np.int64)
        self._sequences = [
            sequence
            for recording in recordings
            if (sequence := _read(recording, slices, steps_us, without_mask))
        ]
        self._index = [
            (s, n) for s, sequence in enumerate(self._sequences) for n in range(len(sequence.times))
        ]
        if not self._index:
            raise ValueError("no target: recordings are shorter than a slice and its references")

    def __len__(self) -> int:
        return len(self._index)

    def size(self, index: int) -> tuple[int, int]:
        """Height and width of a target."""
        h, w = self._sequences[self._index[index][0]].images.shape[2:]
        return int(h), int(w)

    def origin(self, index: int) -> tuple[str, int]:
        """The sequence's name and the target's time, µs."""
        s, n = self._index[index]
        return self._sequences[s].name, int(self._sequences[s].times[n])

    def __getitem__(self, index: int) -> Batch:
        s, n = self._index[index]
        sequence = self._sequences[s]
        images = as_channels(sequence.images[sequence.places[n]], self.network.in_channels)
        item = Batch(
            images[0],
            images[1:],
            self._offsets,
            torch.tensor(sequence.K, dtype=torch.float32),
            torch.from_numpy(sequence.mask[n]).long(),
            torch.from_numpy(sequence.depth[n]).float(),
            torch.from_numpy(sequence.poses[n]),
            images[0].sum(0) > 0,
            torch.from_numpy(sequence.flow[n]).float(),
        )
        return item if self.augmentation is None else augmented(item, self.augmentation)


class SizedBatches(Sampler[list[int]]):
    """Batches of targets that have one size, in an order that PyTorch's generator draws, or as they come."""

    def __init__(self, dataset: SliceDataset, batch_size: int, *, order: Literal["random", "given"]) -> None:
        self.batch_size = batch_size
        self.order = order
        self._groups: dict[tuple[int, int], list[int]] = {}
        for index in range(len(dataset)):
            self._groups.setdefault(dataset.size(index), []).append(index)

    def __len__(self) -> int:
        return sum(-(-len(group) // self.batch_size) for group in self._groups.values())

    def __iter__(self) -> Iterator[list[int]]:
        batches: list[list[int]] = []
        for group in self._groups.values():
            order = torch.randperm(len(group)).tolist() if self.order == "random" else range(len(group))
            shuffled = [group[k] for k in order]
            batches += [shuffled[k : k + self.batch_size] for k in range(0, len(shuffled), self.batch_size)]
        order = torch.randperm(len(batches)).tolist() if self.order == "random" else range(len(batches))
        return iter([batches[k] for k in order])


def _read(
    recording: LabelledRecording,
    slices: SliceSettings,
    steps: NDArray[np.int64],
    without_mask: Literal["keep", "drop"],
) -> _Sequence | None:
    """Slices and truth of a recording; None where it is too short for a single target."""
    times = recording.times
    margin = round(5e5 * slices.width)
    first = times[0] + margin - min(0, int(steps.min()))
    last = times[-1] - margin - max(0, int(steps.max()))
    chosen: list[int] = []
    for moment in np.flatnonzero((times >= first) & (times <= last)).tolist():
        if not chosen or times[moment] - times[chosen[-1]] >= 1e6 * slices.stride - 1:
            chosen.append(moment)
    masks = [recording.mask(moment) for moment in chosen]
    if without_mask == "drop":
        known = [mask is not None and bool((mask != UNKNOWN).any()) for mask in masks]
        chosen, masks = list(itertools.compress(chosen, known)), list(itertools.compress(masks, known))
    if not chosen:
        return None
    wanted = times[chosen][:, None] + np.concatenate([[0], steps])
    unique, places = np.unique(wanted, return_inverse=True)
    images = event_slices(recording.events, unique, slices)
    s = slices.shrink(recording.events.width, recording.events.height)
    h, w = images.shape[2:]
    K = shrunk_intrinsics(recording.K, s)

    def shrunk(
        image: NDArray[Any] | None, shape: tuple[int, ...], unknown: float, dtype: Any
    ) -> NDArray[Any]:
        if image is None:
            return np.full((*shape, h, w), unknown, dtype)
        return image[..., s // 2 :: s, s // 2 :: s][..., :h, :w].astype(dtype)

    poses = np.full((len(chosen), len(steps), 6), np.nan, np.float32)
    if (T_world_camera := recording.T_world_camera) is not None:
        for n, moment in enumerate(chosen):
            poses[n] = relative_poses(T_world_camera, times, moment, times[moment] + steps)
    flows = (recording.flow(moment) for moment in chosen)
    over_slice = slices.width / s  # s of px/s
    return _Sequence(
        recording.name,
        times[chosen],
        images,
        places.reshape(wanted.shape),
        K,
        np.stack([shrunk(mask, (), UNKNOWN, np.int16) for mask in masks]),
        np.stack([shrunk(recording.depth(moment), (), 0, np.float16) for moment in chosen]),
        np.stack([shrunk(None if f is None else over_slice * f, (2,), np.nan, np.float16) for f in flows]),
        poses,
    )
