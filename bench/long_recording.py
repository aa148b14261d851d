"""In how much memory, and how fast, `emseg segment` does long recordings: `python -m bench.long_recording`.

The bundled made scene is repeated to as many events as asked for, in a DAT file, and segmented by a process
of its own.  Its peak memory is the figure of interest: it must not grow with the recording.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import emseg
from emseg.datasets import bundled

SEGMENT = """
import re, sys
from emseg.cli import app
status = app(sys.argv[1:], standalone_mode=False)
# Not ru_maxrss, which begins with what the parent process had.
print("PEAK", re.search(r"VmHWM:\\s*(\\d+) kB", open("/proc/self/status").read())[1])
sys.exit(status)
"""


def write_repeated(path: Path, count: int) -> None:
    """The made scene, time and again, as Prophesee DAT."""
    events = emseg.read(bundled()["made_scene"])
    x, y, p = (column.astype(np.uint32) for column in (events.x, events.y, events.p))
    records = np.stack([np.zeros_like(x), x | y << 14 | p << 28], axis=1)
    first = events.t - events.t[0]
    with path.open("wb") as file:
        header = f"% Version 2\n% Width {events.width}\n% Height {events.height}\n"
        file.write(header.encode() + b"\x0c\x08")
        for repeat, start in enumerate(range(0, count, len(events))):
            records[:, 0] = (first + repeat * (events.duration + 1)).astype(np.uint32)
            file.write(records[: count - start].astype("<u4").tobytes())


def segment(path: Path, out: Path) -> tuple[float, float, float]:
    """Peak memory, MB, and seconds of wall clock and of all threads' CPU time, of one process."""
    before, began = os.times(), time.perf_counter()
    command = [sys.executable, "-c", SEGMENT, "segment", str(path), "--out", str(out)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    after, seconds = os.times(), time.perf_counter() - began
    peak = re.search(r"PEAK (\d+)", output)
    assert peak is not None
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return int(peak[1]) / 1024, seconds, cpu


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--events", type=int, nargs="+", default=[1_000_000, 10_000_000, 100_000_000])
    parser.add_argument(
        "--folder", type=Path, help="for the recording and its results; default: a temporary one"
    )
    arguments = parser.parse_args()
    print(f"{'events':>12} {'windows':>8} {'wall s':>8} {'CPU s':>8} {'Mev/CPU s':>9} {'peak MB':>8}")
    for count in arguments.events:
        with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
            path = Path(folder, "long.dat")
            write_repeated(path, count)
            peak, wall, cpu = segment(path, Path(folder, "out"))
            result = Path(folder, "out", "long")
            windows = len(json.loads((result / "models.json").read_text()))
            with np.load(result / "labels.npz") as arrays:
                assert arrays["labels"].shape == (count,), (
                    f"{arrays['labels'].shape} labels, expected {count}"
                )
        speed = count / cpu / 1e6
        print(f"{count:12,} {windows:8,} {wall:8.1f} {cpu:8.1f} {speed:9.2f} {peak:8.0f}", flush=True)


if __name__ == "__main__":
    main()
