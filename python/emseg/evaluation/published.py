"""Figures that others have published, each with its protocol and source, to stand beside ours.

They are as their authors, or comparisons by others, give them; protocols of one name may still differ in
details such as which sequences and frames count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["PUBLISHED", "PublishedFigure", "published_for"]


@dataclass(frozen=True)
class PublishedFigure:
    """value is in the unit of our figure of this protocol and name; group "" is over all of the data set."""

    dataset: str
    protocol: str
    name: str
    method: str
    value: float
    source: str
    group: str = ""


_EMSGC: Final = "Zhou, Gallego, Lu, Liu, Shen, TNNLS 2021 (arXiv 2012.08730)"
_MBO: Final = "Moving Border Ownership, 2026"
_UN_EVIMO: Final = "Wang et al., Un-EVIMO, 2023 (arXiv 2312.00114)"
_SPIKEMS: Final = "Parameshwara et al., SpikeMS, IROS 2021 (arXiv 2105.06562)"
_EVDODGE: Final = "Sanket et al., EVDodgeNet, ICRA 2020 (arXiv 1906.02919)"
_EVIMO: Final = "Mitrokhin et al., EV-IMO, IROS 2019 (arXiv 1903.07520)"
_VARIATIONAL: Final = "Yamaki, Shiba, Gallego, Aoki, variational contrast maximisation, CVPRW 2025"
_NORMAL_FLOW: Final = "normal-flow graph cut, ICRA 2026"

# Per cent, table / box / floor / wall / fast, at pixels with events at 40 Hz.
_EVIMO_BY_SCENE: Final = {
    "EMSGC": ((55, 24, 18, 24, 43), f"method: {_EMSGC}; figures: comparison at 40 Hz, 9,529 ms a window"),
    "SpikeMS": ((50, 65, 53, 63, 38), f"{_SPIKEMS}, as compared at 40 Hz"),
    "Un-EVIMO": ((50, 45, 56, 53, 44), f"{_UN_EVIMO}, as compared at 40 Hz"),
    "EVDodgeNet": ((70, 67, 61, 72, 60), f"{_EVDODGE}, as compared at 40 Hz"),
    "EV-IMO network": ((79, 70, 59, 78, 67), f"{_EVIMO}, as compared at 40 Hz"),
    "Moving Border Ownership": ((74, 77, 69, 65, 63), f"{_MBO}, without training on it"),
}

PUBLISHED: Final = (
    PublishedFigure(
        "eed",
        "eed",
        "detection rate",
        "EMSMC",
        0.93,
        "Stoffregen et al., ICCV 2019 (arXiv 1904.01293): about 93 %",
    ),
    PublishedFigure(
        "eed", "eed", "detection rate", "0-MMS", 0.942, "Parameshwara et al., 2020 (arXiv 2006.06158): 94.2 %"
    ),
    PublishedFigure(
        "eed",
        "eed",
        "detection rate",
        "normal-flow graph cut",
        0.97,
        f"{_NORMAL_FLOW}: about 97 %, GPU, learned flow",
    ),
    PublishedFigure("evimo", "mask dense", "mask IoU, hulls filled", "EMSGC", 0.7681, f"{_EMSGC}: 76.81 %"),
    *(
        PublishedFigure("evimo", "mask 40 Hz", "mask IoU", method, value / 100, source, group)
        for method, (values, source) in _EVIMO_BY_SCENE.items()
        for group, value in zip(("table", "box", "floor", "wall", "fast"), values, strict=True)
    ),
    *(
        PublishedFigure("evimo2", "mIoU", "mIoU", method, value, source)
        for method, value, source in (
            ("EMSGC", 0.644, f"method: {_EMSGC}; figure: comparison on EVIMO2, 64.4 %"),
            ("normal flow and IMU", 0.774, "comparison on EVIMO2: 77.4 %"),
            ("variational contrast maximisation", 0.84, f"{_VARIATIONAL}: 84 %"),
            ("Moving Border Ownership", 0.816, f"{_MBO}: 81.6 %, without training on it"),
            ("Moving Border Ownership, tuned", 0.851, f"{_MBO}: 85.1 %"),
        )
    ),
)


def published_for(dataset: str) -> list[PublishedFigure]:
    """The published figures of a data set."""
    return [figure for figure in PUBLISHED if figure.dataset == dataset]
