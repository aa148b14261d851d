"""What a fresh process pays in Python: imports, the door of EventArray, and the shell around the engine.

``python -m bench.start_up [--repeats N] [--json FILE]``
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import emseg
from bench.common import (
    Row,
    circumstances,
    print_circumstances,
    print_rows,
    require,
    write_json,
)
from bench.fresh import fresh_environment

# The engine's own time is taken at its door: whatever else `emseg.segment` costs is its Python.
_FRESH = """
import json, time
clock = time.process_time
start = clock()
import numpy as np
numpy_done = clock()
import emseg
emseg_done = clock()
emseg.segment
config = emseg.Config(threads=1)
ready = clock()
rng = np.random.default_rng(0)
n = 5000
x, y = rng.integers(0, 346, n).astype(np.uint16), rng.integers(0, 260, n).astype(np.uint16)
t, p = np.sort(rng.integers(0, 20_000, n)), rng.integers(0, 2, n).astype(np.uint8)
made = clock()
events = emseg.EventArray(x, y, t, p, width=346, height=260)
checked = clock()

from emseg import segmentation
spent = 0.0

class Door:
    def __init__(self, *arguments):
        begun = clock()
        self.engine = native(*arguments)
        self.count(begun)

    def segment(self, *arguments):
        begun = clock()
        found = self.engine.segment(*arguments)
        self.count(begun)
        return found

    def motion_losses(self, *arguments):
        begun = clock()
        losses = self.engine.motion_losses(*arguments)
        self.count(begun)
        return losses

    def count(self, begun):
        global spent
        spent += clock() - begun

class Core:
    def __getattr__(self, name):
        return Door if name == "Segmenter" else getattr(core, name)

core = segmentation._core
native, segmentation._core = core.Segmenter, Core()
begun = clock()
found = emseg.segment(events, config=config)
whole = clock() - begun
print(json.dumps({
    "version": emseg.__version__,
    "labels": len(found.labels),
    "numpy": numpy_done - start,
    "import": emseg_done - numpy_done,
    "ready": ready - numpy_done,
    "events": checked - made,
    "shell": whole - spent,
    "engine": spent,
}))
"""


def bench_start_up(repeats: int = 5) -> list[Row]:
    """CPU milliseconds of fresh processes, beside NumPy's own import or the engine's part of the call."""
    command = [sys.executable, "-c", _FRESH]
    runs = []
    for turn in range(repeats + 1):
        done = subprocess.run(command, env=fresh_environment(), capture_output=True, text=True, check=False)
        require(done.returncode == 0, f"a fresh process failed: {done.stderr.strip().splitlines()[-1:]}")
        run = json.loads(done.stdout)
        require(run["version"] == emseg.__version__, f"another emseg is found, version {run['version']}")
        require(run["labels"] == 5000, f"{run['labels']} labels for 5000 events")
        if turn:  # the first may have had to compile the Python files
            runs.append(run)

    def median_ms(part: str) -> float:
        return 1e3 * statistics.median(float(run[part]) for run in runs)

    numpy_ms, engine_ms = median_ms("numpy"), median_ms("engine")
    ready = "import emseg, emseg.segment, Config()"
    return [
        Row("import emseg, over NumPy's own", median_ms("import"), "import numpy", numpy_ms, "≤ 150 ms"),
        Row(f"{ready}, over NumPy's own", median_ms("ready"), "import numpy", numpy_ms, "≤ 30 ms"),
        Row("EventArray, 5000 events, first", median_ms("events"), "import numpy", numpy_ms),
        Row("emseg.segment, first, outside the engine", median_ms("shell"), "engine", engine_ms, "≤ 2 ms"),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=9, help="fresh processes; medians are shown")
    parser.add_argument("--json", type=Path, help="also write the rows here")
    options = parser.parse_args(arguments)
    found = circumstances()
    print_circumstances(found)
    rows = bench_start_up(options.repeats)
    print_rows(rows)
    if options.json:
        write_json(options.json, found, rows=[row.as_dict() for row in rows])


if __name__ == "__main__":
    main()
