"""Which data sets are known, and where their adapters are; each is imported when it is asked for.

Other packages add theirs by entry points of the group `emseg.datasets`, named as the data set, that name a
function of the root folder.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from importlib.metadata import entry_points
from os import PathLike
from pathlib import Path
from typing import Final

from emseg.datasets.truth import Dataset, DatasetError

__all__ = ["ENTRY_POINT_GROUP", "DatasetEntry", "known_datasets", "open_dataset"]

ENTRY_POINT_GROUP: Final = "emseg.datasets"


@dataclass(frozen=True)
class DatasetEntry:
    """A data set by name: its adapter as module:function, what it holds, and where it is described."""

    name: str
    adapter: str
    title: str
    source: str


_BUILT_IN: Final = (
    DatasetEntry(
        "evimo",
        "emseg.datasets.evimo:evimo",
        "EV-IMO: masks, depth, poses; npz or text",
        "Mitrokhin, Ye, Fermuller, Aloimonos, Delbruck, EV-IMO, IROS 2019",
    ),
    DatasetEntry(
        "evimo2",
        "emseg.datasets.evimo:evimo2",
        "EVIMO2, v1 (npz) and v2 (folders), or text: masks, depth, poses",
        "Burner, Mitrokhin, Fermuller, Aloimonos, EVIMO2, arXiv 2205.03467",
    ),
    DatasetEntry(
        "eed",
        "emseg.datasets.eed:eed",
        "Extreme Event Dataset: boxes",
        "Mitrokhin, Fermuller, Parameshwara, Aloimonos, IROS 2018",
    ),
    DatasetEntry(
        "dvsmotion20",
        "emseg.datasets.plain:dvsmotion20",
        "DVSMOTION20: no truth of moving objects",
        "Almatrafi, Baldwin, Aizawa, Hirakawa, Distance surface, PAMI 2020",
    ),
    DatasetEntry(
        "distsurf",
        "emseg.datasets.plain:distsurf",
        "DistSurf's car and hand, as EMSGC has them: no truth",
        "Almatrafi et al., PAMI 2020; Zhou et al., EMSGC, TNNLS 2021",
    ),
    DatasetEntry(
        "hkust-ems",
        "emseg.datasets.plain:hkust_ems",
        "HKUST-EMS' cast and corridor: no truth",
        "Zhou et al., EMSGC, TNNLS 2021",
    ),
    DatasetEntry(
        "ecd",
        "emseg.datasets.plain:ecd",
        "Event Camera Dataset: mostly still scenes, in which nothing may be found",
        "Mueggler, Rebecq, Gallego, Delbruck, Scaramuzza, IJRR 2017",
    ),
    DatasetEntry(
        "dsec",
        "emseg.datasets.dsec:dsec",
        "DSEC, with labels of DSEC-MOS or in MOTS' layout where there are some: masks",
        "Gehrig, Aarents, Gehrig, Scaramuzza, DSEC, RA-L 2021; Zhou et al., DSEC-MOS, IROS 2024",
    ),
    DatasetEntry(
        "mvsec",
        "emseg.datasets.mvsec:mvsec",
        "MVSEC: flow, depth; still scenes indoors",
        "Zhu, Thakur, Ozaslan, Pfrommer, Kumar, Daniilidis, MVSEC, RA-L 2018",
    ),
    DatasetEntry(
        "sim",
        "emseg.datasets.simulated:simulated",
        "what `emseg simulate` wrote (.npz): labels per event, masks, depth, flow",
        "emseg, docs/simulation.md",
    ),
)


def known_datasets() -> dict[str, DatasetEntry]:
    """Every known data set by its name: the built-in ones, then those of other packages."""
    known = {entry.name: entry for entry in _BUILT_IN}
    for point in entry_points(group=ENTRY_POINT_GROUP):
        known.setdefault(point.name, DatasetEntry(point.name, point.value, point.value, point.value))
    return known


def open_dataset(name: str, root: str | PathLike[str]) -> Dataset:
    """The recordings of a data set in a folder.

    Raises:
        DatasetError: the name is not known, or the folder does not hold the data set.
    """
    known = known_datasets()
    if name not in known:
        raise DatasetError(f"no data set {name!r}, expected one of: {', '.join(known)}")
    module, _, function = known[name].adapter.partition(":")
    found: Dataset = getattr(importlib.import_module(module), function)(Path(root))
    return found
