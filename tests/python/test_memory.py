"""Long recordings: `emseg segment` takes as much memory for many events as for few."""

from __future__ import annotations

from pathlib import Path

from bench.long_recording import segment, write_repeated

SHORT, LONG = 3_000_000, 6_000_000


def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """The events of what is longer take 39 MB, their labels 12 MB."""
    peaks = []
    for count in (SHORT, LONG):
        path = tmp_path / f"{count}.dat"
        write_repeated(path, count)
        peaks.append(segment(path, tmp_path / "out")[0])
    assert peaks[1] - peaks[0] < 20
    assert peaks[1] < 300
