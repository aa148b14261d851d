"""What networks learn from: recordings with truth, as far as it is known.  No PyTorch is needed here."""

from __future__ import annotations

import hashlib
import logging
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from emseg.events import EventArray

__all__ = [
    "Image",
    "LabelledRecording",
    "SimulatedRecording",
    "Split",
    "find_recordings",
    "split_by_name",
]

log = logging.getLogger(__name__)

Split = Literal["train", "validation", "test"]
Image = NDArray[Any]

SPLITS: Final[tuple[Split, ...]] = ("train", "validation", "test")


class LabelledRecording(Protocol):
    """A recording, and the truth about n moments of it; every part of the truth may be missing."""

    @property
    def name(self) -> str:
        """Of the sequence."""

    @property
    def events(self) -> EventArray:
        """All its events."""

    @property
    def K(self) -> NDArray[np.float64]:
        """Of a camera without distortion, (3, 3)."""

    @property
    def times(self) -> NDArray[np.int64]:
        """Moments of the truth, µs, rising, (n,)."""

    @property
    def T_world_camera(self) -> NDArray[np.float64] | None:
        """The camera's poses at these moments, (n, 4, 4)."""

    def mask(self, moment: int) -> Image | None:
        """0 what stands still, 1.. what moves by itself, -1 not known; integers (h, w)."""

    def depth(self, moment: int) -> Image | None:
        """Along the optical axis, m, (h, w); 0 where it is not known."""

    def flow(self, moment: int) -> Image | None:
        """Motion in the image, px/s, (2, h, w); NaN where it is not known."""

    def owners(self) -> NDArray[np.integer[Any]] | None:
        """True label of each event: as the mask's, -1 noise."""


class SimulatedRecording:
    """A recording as `emseg simulate` writes it (docs/simulation.md); read when first used."""

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = Path(path)

    @property
    def name(self) -> str:
        """The file's name without its ending."""
        return self.path.stem

    @cached_property
    def _arrays(self) -> dict[str, NDArray[Any]]:
        wanted = ("x", "y", "t", "p", "label", "width", "height", "K", "gt_t", "gt_T_world_camera")
        with np.load(self.path, allow_pickle=False) as archive:
            missing = [key for key in (*wanted, "gt_mask", "gt_depth") if key not in archive]
            if missing:
                raise ValueError(f"{self.path}: lacks {missing[0]}, expected a recording of `emseg simulate`")
            arrays = {key: archive[key] for key in wanted}
            distorted = "D" in archive and np.any(archive["D"])
        if distorted:
            log.warning("%s: its distortion is not heeded", self.path)
        return arrays

    @cached_property
    def _truth(self) -> dict[str, NDArray[Any]]:
        with np.load(self.path, allow_pickle=False) as archive:
            return {key: archive[key] for key in ("gt_mask", "gt_depth", "gt_flow") if key in archive}

    @cached_property
    def events(self) -> EventArray:
        """All events."""
        a = self._arrays
        return EventArray(a["x"], a["y"], a["t"], a["p"], width=int(a["width"]), height=int(a["height"]))

    @property
    def K(self) -> NDArray[np.float64]:
        """Intrinsics (3, 3)."""
        return self._arrays["K"]

    @property
    def times(self) -> NDArray[np.int64]:
        """Moments of the truth, µs (n,)."""
        return self._arrays["gt_t"]

    @property
    def T_world_camera(self) -> NDArray[np.float64]:
        """The camera's poses, (n, 4, 4)."""
        return self._arrays["gt_T_world_camera"]

    def mask(self, moment: int) -> Image:
        """Labels, int8 (h, w)."""
        mask: Image = self._truth["gt_mask"][moment]
        return mask

    def depth(self, moment: int) -> Image:
        """Depth, m, float16 (h, w); 0 where there is nothing."""
        depth: Image = self._truth["gt_depth"][moment]
        return depth

    def flow(self, moment: int) -> Image | None:
        """Motion, px/s, float32 (2, h, w); files of other simulators may lack it."""
        if "gt_flow" not in self._truth:
            return None
        interval = 1e-6 * float(self.times[1] - self.times[0])
        flow: Image = self._truth["gt_flow"][moment].astype(np.float32) / interval
        return flow

    def owners(self) -> NDArray[np.integer[Any]]:
        """True label of each event, int8 (n,)."""
        return self._arrays["label"]


def split_by_name(name: str) -> Split:
    """Where a sequence belongs that nobody has assigned: 8 of 10 to training, 1 to each of the others.

    By its name alone, so that it never changes sides, whatever other sequences there are.
    """
    digit = int(hashlib.sha256(name.encode()).hexdigest(), 16) % 10
    return "train" if digit < 8 else "validation" if digit == 8 else "test"


def find_recordings(folder: str | PathLike[str], split: Split | Literal["all"]) -> list[SimulatedRecording]:
    """The simulated recordings of a split: in folder/<split>/ where there are such, else chosen by name.

    "all" are those of the folder itself, whatever their names.

    Raises:
        ValueError: none.
    """
    root = Path(folder)
    if split == "all":
        found = sorted(root.glob("*.npz"))
    elif any((root / name).is_dir() for name in SPLITS):
        found = sorted((root / split).glob("*.npz"))
    else:
        found = [path for path in sorted(root.glob("*.npz")) if split_by_name(path.stem) == split]
    if not found:
        place = "*.npz" if split == "all" else f"{split}/*.npz"
        raise ValueError(f"{root}: no recordings for {split}, expected {place} of `emseg simulate`")
    return [SimulatedRecording(path) for path in found]
