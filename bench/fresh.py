"""One cold segmentation in a process of its own: what a stranger's first call costs.

``python -m bench.fresh WINDOW CONFIG_JSON``, with the window's name or file, prints one line of JSON.  NumPy
and the events are there before the clock starts: they are the caller's.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

_BEFORE_EMSEG = time.process_time()


def peak_mb() -> float:
    """Largest resident memory so far, MB.

    From VmHWM where there is one: ru_maxrss of a child starts at its parent's, which holds far more.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def fresh_environment() -> dict[str, str]:
    """Of a new process that imports what this one does.

    Python's own compilation is kept from one process to the next, as an installed package's is: else every
    import would include it.  NumPy's linear algebra, of which nothing is used here, would start threads that
    spin for some 30 ms of CPU time after NumPy's import: it is told not to.
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    environment["OPENBLAS_NUM_THREADS"] = "1"
    return environment


def main() -> None:
    np.zeros(1)
    numpy_mb = peak_mb()
    import emseg

    config_class, segment = emseg.Config, emseg.segment  # imported when first named
    imported = time.process_time()
    from bench.windows import load  # not part of what is timed

    window = load(sys.argv[1])
    config = config_class(**json.loads(sys.argv[2]))
    events_mb = peak_mb()
    loaded = time.process_time()
    found = segment(window.events, window.camera, config)
    done = time.process_time()
    figures = {
        "import_cpu_s": imported - _BEFORE_EMSEG,
        "segment_cpu_s": done - loaded,
        "peak_mb_over_numpy": peak_mb() - numpy_mb,
        "peak_mb_over_events": peak_mb() - events_mb,
        "labels": len(found.models),
        "energy": found.energy,
    }
    print(json.dumps(figures))


def run_fresh(*arguments: str) -> dict[str, Any]:
    """This module in a new process with the same import path."""
    environment = fresh_environment()
    command = [sys.executable, "-m", "bench.fresh", *arguments]
    root = Path(__file__).resolve().parents[1]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed: {done.stderr.strip().splitlines()[-1:]}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


if __name__ == "__main__":
    main()
