"""Writing events as aedat4, npz, HDF5 or text: chunk by chunk, and complete or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from emseg.events import EVENT_DTYPE, EventArray
from emseg.io.errors import ReadError
from emseg.io.extras import require

__all__ = ["FORMATS", "SUFFIXES", "write_events"]

SUFFIXES: Final[dict[str, str]] = {
    ".aedat4": "aedat4",
    ".npz": "npz",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".txt": "text",
    ".csv": "text",
}
"""The format that a file's suffix stands for."""

_HDF5_CHUNK: Final = 1 << 16
_AEDAT4_PACKET: Final = 1 << 14
_LARGEST_AEDAT4_SIDE: Final = 32768  # its coordinates are signed


def write_events(path: Path, chunks: Iterable[EventArray], *, size: tuple[int, int], form: str) -> int:
    """Write a recording; the file appears when it is complete.

    Args:
        path: The file, which is replaced.
        chunks: Its events in order.
        size: Width and height of the sensor, px.
        form: One of :data:`FORMATS`.

    Returns:
        The number of events written.

    Raises:
        ReadError: where a package is missing to write it, or the format cannot hold the events.
        OSError: where it cannot be written.
    """
    count = 0

    def counted() -> Iterator[EventArray]:
        nonlocal count
        for events in chunks:
            count += len(events)
            yield events

    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        # The suffix stays: dv-processing goes by it.
        work = Path(folder, f"events{path.suffix}")
        FORMATS[form](work, counted(), size)
        os.replace(work, path)
    return count


def _write_npz(path: Path, chunks: Iterable[EventArray], size: tuple[int, int]) -> None:
    """Each column is collected in a file of its own, since an archive holds one after the other."""
    columns = {name: path.with_name(f"{name}.column") for name in "xytp"}
    count = 0
    files: dict[str, IO[bytes]] = {name: file.open("wb") for name, file in columns.items()}
    try:
        for events in chunks:
            count += len(events)
            for name, file in files.items():
                file.write(getattr(events, name).astype(EVENT_DTYPE[name], copy=False).data)
    finally:
        for file in files.values():
            file.close()
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, source in columns.items():
            header = {"descr": EVENT_DTYPE[name].str, "fortran_order": False, "shape": (count,)}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as target:
                np.lib.format.write_array_header_1_0(target, header)
                with source.open("rb") as column:
                    shutil.copyfileobj(column, target, 1 << 20)
        for name, side in zip(("width", "height"), size, strict=True):
            with archive.open(f"{name}.npy", "w") as target:
                np.lib.format.write_array(target, np.array(side), allow_pickle=False)


def _write_hdf5(path: Path, chunks: Iterable[EventArray], size: tuple[int, int]) -> None:
    """A group `events` of columns, as DSEC has it, with attributes width and height."""
    h5py: Any = require("h5py", "h5py", "HDF5", path)
    with h5py.File(path, "w") as file:
        group = file.create_group("events")
        group.attrs["width"], group.attrs["height"] = size
        columns = {
            name: group.create_dataset(
                name, (0,), EVENT_DTYPE[name], maxshape=(None,), chunks=(_HDF5_CHUNK,), compression="lzf"
            )
            for name in "xytp"
        }
        count = 0
        for events in chunks:
            for name, dataset in columns.items():
                dataset.resize((count + len(events),))
                dataset[count:] = getattr(events, name)
            count += len(events)


def _write_text(path: Path, chunks: Iterable[EventArray], size: tuple[int, int]) -> None:
    """The sensor's size, then a line "t x y p" an event, µs; with commas and a header in a .csv."""
    separator = "," if path.suffix.lower() == ".csv" else " "
    with path.open("w", encoding="ascii") as file:
        file.write(f"# width{separator}height, then t{separator}x{separator}y{separator}p; t in us\n")
        file.write(f"{size[0]}{separator}{size[1]}\n{separator.join('txyp')}\n")
        for events in chunks:
            columns = (getattr(events, name).tolist() for name in "txyp")
            rows = zip(*columns, strict=True)
            file.writelines(f"{t}{separator}{x}{separator}{y}{separator}{p}\n" for t, x, y, p in rows)


def _write_aedat4(path: Path, chunks: Iterable[EventArray], size: tuple[int, int]) -> None:
    """One stream of events, as dv-processing writes it."""
    if max(size) > _LARGEST_AEDAT4_SIDE:
        raise ReadError(
            path, f"sensor is {size[0]}x{size[1]}, AEDAT 4 holds {_LARGEST_AEDAT4_SIDE} px a side"
        )
    dv: Any = require("dv_processing", "dv-processing", "writing AEDAT 4", path)
    writer = dv.io.MonoCameraWriter(str(path), dv.io.MonoCameraWriter.EventOnlyConfig("emseg", size))
    for events in chunks:
        for start in range(0, len(events), _AEDAT4_PACKET):
            part = events[start : start + _AEDAT4_PACKET]
            columns = (part.t.tolist(), part.x.tolist(), part.y.tolist(), part.p.astype(bool).tolist())
            elements = dv.EventPacket.EventVector(map(dv.Event, *columns))
            writer.writeEventPacket(dv.EventPacket(elements))
    del writer  # closes the file


FORMATS: Final[dict[str, Callable[[Path, Iterable[EventArray], tuple[int, int]], None]]] = {
    "aedat4": _write_aedat4,
    "npz": _write_npz,
    "hdf5": _write_hdf5,
    "text": _write_text,
}
"""What writes each format."""
