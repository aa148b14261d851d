"""Figures that others have published, each with its protocol and source, to stand beside ours.

They are as their authors, or comparisons by others, give them; protocols of one name may still differ in
details such as which sequences and frames count.  `confirmed` says where a figure was found again: in the
paper's own abstract, or in notes by others that repeat its tables; the papers' tables were not at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["PUBLISHED", "PublishedFigure", "published_for"]


@dataclass(frozen=True)
class PublishedFigure:
    """value is in the unit of our figure of this protocol and name; group "" is over all of the data set.

    confirmed: where the figure was found again; empty where it could not be.
    """

    dataset: str
    protocol: str
    name: str
    method: str
    value: float
    source: str
    group: str = ""
    confirmed: str = ""


_EMSGC: Final = "Zhou, Gallego, Lu, Liu, Shen, EMSGC, TNNLS 2021 (arXiv 2012.08730)"
_MBO: Final = "Hua, Fermuller, Aloimonos, Moving border ownership, CVPR 2026"
_UN_EVIMO: Final = "Wang, Guo, Daniilidis, Un-EVIMO, ECCV 2024 (arXiv 2312.00114)"
_SPIKEMS: Final = "Parameshwara et al., SpikeMS, IROS 2021 (arXiv 2105.06562)"
_EVDODGE: Final = "Sanket et al., EVDodgeNet, ICRA 2020 (arXiv 1906.02919)"
_EVIMO: Final = "Mitrokhin et al., EV-IMO, IROS 2019 (arXiv 1903.07520)"
_VARIATIONAL: Final = (
    "Yamaki, Shiba, Gallego, Aoki, Iterative event-based motion segmentation by variational contrast "
    "maximization, CVPRW 2025 (arXiv 2504.18447)"
)
_NORMAL_FLOW: Final = (
    "Zhong, Ren, Zhu, Yuan, Fermuller, Zhou, Real-time motion segmentation with event-based normal flow, "
    "ICRA 2026 (arXiv 2602.20790)"
)
_NORMAL_FLOW_IMU: Final = (
    "Hua, Yuan, Fermuller, Motion segmentation and egomotion estimation from event-based normal flow, 2025 "
    "(arXiv 2507.14500)"
)
_MBO_TABLE: Final = "notes on the CVPR 2026 paper that repeat its table"
_UN_EVIMO_TABLE: Final = "notes on the ECCV 2024 paper that repeat its table"

# Per cent, table / box / floor / wall / fast, at pixels with events at 40 Hz: the table of Un-EVIMO, repeated
# and extended by that of Moving border ownership.
_EVIMO_BY_SCENE: Final = {
    "EMSGC": (
        (55, 24, 18, 24, 43),
        f"method: {_EMSGC}; figures: {_UN_EVIMO}, 40 Hz, its column 'Top 30 %', 9,529 ms a window",
        _UN_EVIMO_TABLE,
    ),
    "SpikeMS": ((50, 65, 53, 63, 38), f"{_SPIKEMS}, as compared at 40 Hz", _UN_EVIMO_TABLE),
    "Un-EVIMO": ((50, 45, 56, 53, 44), _UN_EVIMO, _UN_EVIMO_TABLE),
    "EVDodgeNet": ((70, 67, 61, 72, 60), f"{_EVDODGE}, as compared by {_MBO}", _MBO_TABLE),
    "EV-IMO network": ((79, 70, 59, 78, 67), f"{_EVIMO}, as compared at 40 Hz", _UN_EVIMO_TABLE),
    "Moving Border Ownership": ((74, 77, 69, 65, 63), f"{_MBO}, without training on it", _MBO_TABLE),
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
        "eed",
        "eed",
        "detection rate",
        "0-MMS",
        0.942,
        "Parameshwara et al., 0-MMS, ICRA 2021 (arXiv 2006.06158): 94.2 %",
        confirmed="its abstract",
    ),
    PublishedFigure(
        "eed",
        "eed",
        "detection rate",
        "normal-flow graph cut",
        0.97,
        f"{_NORMAL_FLOW}: about 97 %, GPU, learned flow",
        confirmed="a summary of it",
    ),
    PublishedFigure("evimo", "mask dense", "mask IoU, hulls filled", "EMSGC", 0.7681, f"{_EMSGC}: 76.81 %"),
    *(
        PublishedFigure("evimo", "mask 40 Hz", "mask IoU", method, value / 100, source, group, confirmed)
        for method, (values, source, confirmed) in _EVIMO_BY_SCENE.items()
        for group, value in zip(("table", "box", "floor", "wall", "fast"), values, strict=True)
    ),
    *(
        PublishedFigure("evimo2", "mIoU", "mIoU", method, value, source, confirmed=_MBO_TABLE)
        for method, value, source in (
            ("EMSGC", 0.644, f"method: {_EMSGC}; figure: {_MBO}, 64.38 %"),
            ("normal flow and IMU", 0.774, f"{_NORMAL_FLOW_IMU}; figure: {_MBO}, 77.4 %"),
            ("variational contrast maximisation", 0.84, f"{_VARIATIONAL}; figure: {_MBO}, 84 %"),
            ("Moving Border Ownership", 0.816, f"{_MBO}: 81.55 %, without training on it"),
            ("Moving Border Ownership, tuned", 0.851, f"{_MBO}: 85.12 %"),
        )
    ),
)
UNCONFIRMED: Final = "; not confirmed"
"""Follows the source where a figure was not found again."""


def published_for(dataset: str) -> list[PublishedFigure]:
    """The published figures of a data set."""
    return [figure for figure in PUBLISHED if figure.dataset == dataset]
