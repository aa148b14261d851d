"""Data sets as folders of recordings: what most adapters have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from emseg.datasets.truth import DatasetError, LabelledRecording, Span

__all__ = ["FolderDataset", "Place", "folders_with", "named"]

Load = Callable[[Path, str, Span | None], LabelledRecording]


@dataclass(frozen=True)
class Place:
    """A recording to be loaded: its name in the data set, and its file or folder."""

    name: str
    path: Path


@dataclass(frozen=True)
class FolderDataset:
    """Recordings found in a folder, each loaded when asked for by `reader` (path, name, span)."""

    name: str
    places: Sequence[Place]
    reader: Load

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings, in order."""
        return tuple(place.name for place in self.places)

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> LabelledRecording:
        return self.load(index)

    def load(self, index: int, *, span: Span | None = None) -> LabelledRecording:
        """See :meth:`emseg.datasets.truth.Dataset.load`."""
        place = self.places[index]
        return self.reader(place.path, place.name, span)


def named(
    dataset: str,
    root: Path,
    paths: Iterable[Path],
    expected: str,
    reader: Load,
    *,
    naming: Callable[[Path], str] | None = None,
) -> FolderDataset:
    """The data set of the recordings at `paths`, in their order, named by their place below the root.

    Args:
        dataset: The data set's name.
        root: The folder that it is in.
        paths: Files or folders of the recordings.
        expected: What there should be, for the error.
        reader: Loads a recording.
        naming: Names a recording otherwise.

    Raises:
        DatasetError: there are no recordings; the message says what was expected.
    """
    if not root.is_dir():
        raise DatasetError(f"{root}: no such folder, expected the data set {dataset}")
    places = [Place(naming(path) if naming else _name(root, path), path) for path in sorted(set(paths))]
    if not places:
        raise DatasetError(f"{root}: holds no recording of {dataset}, expected {expected}")
    return FolderDataset(dataset, places, reader)


def folders_with(root: Path, *files: str) -> list[Path]:
    """The folders at or below the root that hold files of all these names."""
    return [path.parent for path in root.rglob(files[0]) if all((path.parent / f).is_file() for f in files)]


def _name(root: Path, path: Path) -> str:
    below = path.relative_to(root).as_posix()
    return (below if path.is_dir() else below.removesuffix(path.suffix)) if below != "." else root.name
