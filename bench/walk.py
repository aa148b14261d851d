"""How fast, and in how much memory, long recordings are walked: `python -m bench.walk [FORMAT...]`.

Each format's recording is made in a temporary folder, chunk by chunk, and walked by a process of its own,
whose peak memory is the figure of interest: it must not grow with the recording.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from emseg.events import EventArray
from emseg.io.writing import write_events

WIDTH, HEIGHT = 640, 480
CHUNK = 1_000_000
WALK = """
import re, sys, time
import emseg.io
before = time.process_time()
with emseg.io.open_recording(sys.argv[1]) as recording:
    count = sum(len(chunk) for chunk in recording.chunks())
seconds = time.process_time() - before
# Not ru_maxrss, which begins with what the parent process had.
peak = re.search(r"VmHWM:\\s*(\\d+) kB", open("/proc/self/status").read())[1]
print(count, seconds, int(peak) / 1024)
"""
SUFFIXES = {"evt2": ".raw", "dat": ".dat", "npz": ".npz", "hdf5": ".h5", "aedat4": ".aedat4", "text": ".txt"}


def chunks(count: int) -> Iterator[EventArray]:
    """Scattered events at 10 Mev/s: one chunk, time and again."""
    rng = np.random.default_rng(0)
    n = min(CHUNK, count)
    x, y, p = rng.integers(0, WIDTH, n), rng.integers(0, HEIGHT, n), rng.integers(0, 2, n)
    t = np.sort(rng.integers(0, n // 10, n))
    first = EventArray(x, y, t, p, width=WIDTH, height=HEIGHT)
    for start in range(0, count, n):
        t_chunk = first.t + start // 10
        yield EventArray(first.x, first.y, t_chunk, first.p, width=WIDTH, height=HEIGHT)[: count - start]


def write(path: Path, form: str, count: int) -> None:
    """Make a recording."""
    if form not in ("evt2", "dat"):
        write_events(path, chunks(count), size=(WIDTH, HEIGHT), form=form)
        return
    with path.open("wb") as file:
        if form == "dat":
            file.write(f"% Version 2\n% Width {WIDTH}\n% Height {HEIGHT}\n".encode() + b"\x0c\x08")
        else:  # without the sensor's size, so that it must be walked twice
            file.write(b"% evt 2.0\n")
        for events in chunks(count):
            x, y, p = (column.astype(np.uint32) for column in (events.x, events.y, events.p))
            if form == "dat":
                address = x | y << 14 | p << 28
                file.write(np.stack([events.t.astype(np.uint32), address], axis=1).astype("<u4").tobytes())
            else:
                high = (events.t >> 6).astype(np.uint32)
                words = p << 28 | (events.t & 63).astype(np.uint32) << 22 | x << 11 | y
                steps = np.flatnonzero(np.diff(high, prepend=np.uint32(0xFFFFFFFF)))
                file.write(np.insert(words, steps, 0x80000000 | high[steps]).astype("<u4").tobytes())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("forms", nargs="*", metavar="FORMAT", help=f"of {', '.join(SUFFIXES)}; default: all")
    parser.add_argument("--events", type=int, default=100_000_000)
    arguments = parser.parse_args()
    print(f"{'format':8} {'events':>12} {'CPU s':>8} {'Mev/s':>8} {'peak MB':>8}")
    for form in arguments.forms or SUFFIXES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"long{SUFFIXES[form]}")
            write(path, form, arguments.events)
            output = subprocess.run(
                [sys.executable, "-c", WALK, str(path)], check=True, capture_output=True, text=True
            ).stdout
        count, seconds, peak = (float(word) for word in output.split())
        assert count == arguments.events, f"{form}: {count:.0f} events, expected {arguments.events}"
        print(f"{form:8} {count:12,.0f} {seconds:8.1f} {count / seconds / 1e6:8.1f} {peak:8.0f}", flush=True)


if __name__ == "__main__":
    main()
