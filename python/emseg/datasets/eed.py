"""The Extreme Event Dataset: a folder a sequence, DAVIS240.

`<sequence>/events.txt` of "t x y p" (s, Unix time), beside images.txt ("t images/frame_….png"); some have
parts, such as light_variations/strobe and multiple_objects/2_objs.  EMSGC gives out filtered events as
events_filtered.txt; the raw recordings are ROS bags.  Boxes are read from `<sequence>/boundingbox.txt`: a
line a box, "t x y w h" (s, px), by blanks or commas; a header line may name the columns otherwise, also
x1 y1 x2 y2.  Times count as those of the events.

That boxes lie in boundingbox.txt beside the events is what the one loader of others that was found says; it
does not read the columns, so that these are an assumption.

Sources: Mitrokhin, Fermuller, Parameshwara, Aloimonos, "Event-based moving object detection and tracking",
IROS 2018, and the IROS_Dataset-2018-independent-motion archive's folders; EMSGC's launch/EED for its copies.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from emseg.datasets.folders import FolderDataset, named
from emseg.datasets.truth import BoxTrack, DatasetError, LabelledRecording, Span, Truth
from emseg.events import EventArray
from emseg.io import read

__all__ = ["eed", "read_boxes"]

WIDTH: Final = 240
HEIGHT: Final = 180
EVENT_FILES: Final = ("events.txt", "events_filtered.txt")
BOX_FILE: Final = "boundingbox.txt"
COLUMNS: Final = ("t", "x", "y", "w", "h")
CORNERS: Final = ("t", "x1", "y1", "x2", "y2")


def eed(root: Path) -> FolderDataset:
    """The Extreme Event Dataset below a folder."""
    texts = {path.parent for name in EVENT_FILES for path in root.rglob(name)}
    bags = {path.parent for path in root.rglob("*.bag")} - texts
    expected = "folders of sequences with events.txt, events_filtered.txt or a .bag"
    return named("eed", root, texts | bags, expected, _load)


def _load(path: Path, name: str, span: Span | None) -> LabelledRecording:
    events = _events(path, span)
    boxes = read_boxes(path / BOX_FILE) if (path / BOX_FILE).is_file() else None
    return LabelledRecording(name, events, name.split("/")[0], None, Truth(boxes=boxes, scene="moving"))


def _events(path: Path, span: Span | None) -> EventArray:
    for name in EVENT_FILES:
        if (path / name).is_file():
            return read(path / name, span=span, columns="txyp", time_unit="s", width=WIDTH, height=HEIGHT)
    bags = sorted(path.glob("*.bag"))
    if len(bags) != 1:
        raise DatasetError(f"{path}: {len(bags)} bags, expected one, or events.txt")
    return read(bags[0], span=span, width=WIDTH, height=HEIGHT)


def read_boxes(path: Path) -> BoxTrack:
    """Boxes from text, as this module describes it.

    Raises:
        DatasetError: naming the line.
    """
    order: tuple[str, ...] = COLUMNS
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        cells = [cell for cell in re.split(r"[\s,;]+", line.strip().lstrip("#")) if cell]
        if not cells:
            continue
        if not rows and (set(cells) >= set(COLUMNS) or set(cells) >= set(CORNERS)):
            order = tuple(cells)
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise DatasetError(f"{path}, line {number}: {line.strip()!r}, expected numbers") from None
        if len(row) < 5 or not np.isfinite(row[:5]).all():
            raise DatasetError(f"{path}, line {number}: {line.strip()!r}, expected {' '.join(order)}")
        rows.append(row)
    table = {
        name: np.array([row[k] for row in rows]) for k, name in enumerate(order) if name in COLUMNS + CORNERS
    }
    if "x1" in table:
        table |= {"x": table["x1"], "y": table["y1"]}
        table |= {"w": table["x2"] - table["x1"], "h": table["y2"] - table["y1"]}
    boxes = np.column_stack([table[name] for name in ("x", "y", "w", "h")]).reshape(-1, 4)
    t = np.rint(1e6 * table["t"]).astype(np.int64)
    rising = np.argsort(t, kind="stable")
    return BoxTrack(t[rising], boxes[rising].astype(np.float64))
