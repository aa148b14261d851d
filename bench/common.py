"""What every benchmark shares: CPU time, tables with ratios, and JSON that says where it was measured.

CPU time is that of all threads of the process, so that it can be compared on a machine with other work.
Ours and its peers run in one process, in turns, so that both see the same machine.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

Result = TypeVar("Result")

SHORTEST_SAMPLE_S = 5e-3  # runs below it are repeated within a sample
LONG_RUN_S = 2.0  # a run above it is not worth repeating
PACKAGES = ("emseg", "numpy", "scipy", "numba", "PyMaxflow", "gco", "eventcv")
ROOT = Path(__file__).resolve().parents[1]


class Timed(NamedTuple, Generic[Result]):
    """Median CPU time of a run, seconds, and what every sample's last run returned."""

    cpu_s: float
    results: list[Result]

    @property
    def result(self) -> Result:
        return self.results[-1]


def cpu_times(runs: Sequence[Callable[[], Any]], repeats: int) -> list[Timed[Any]]:
    """Each run timed `repeats` times in turn with the others, after one run that warms it up.

    A run that takes longer than `LONG_RUN_S` is timed once.
    """
    for run in runs:
        run()  # what is compiled or cached on first use
    samples: list[list[float]] = []
    results: list[list[Any]] = []
    for run in runs:
        spent, result = _sample(run, 1)
        samples.append([spent])
        results.append([result])
    calls = [max(1, round(SHORTEST_SAMPLE_S / max(sample[0], 1e-6))) for sample in samples]
    for _ in range(repeats - 1):
        for k, run in enumerate(runs):
            if samples[k][0] <= LONG_RUN_S:
                spent, result = _sample(run, calls[k])
                samples[k].append(spent)
                results[k].append(result)
    return [Timed(statistics.median(s), r) for s, r in zip(samples, results, strict=True)]


def cpu_time(run: Callable[[], Result], repeats: int) -> Timed[Result]:
    """`cpu_times` of one run."""
    return cpu_times([run], repeats)[0]


def _sample(run: Callable[[], Result], calls: int) -> tuple[float, Result]:
    start = time.process_time()
    for _ in range(calls):
        result = run()
    return (time.process_time() - start) / calls, result


class Row(NamedTuple):
    """One kernel beside one peer."""

    what: str
    ours_ms: float
    peer: str
    peer_ms: float
    target: str = ""  # of the Speed issue

    @property
    def ratio(self) -> float:
        return self.peer_ms / self.ours_ms

    def as_dict(self) -> dict[str, Any]:
        return self._asdict() | {"ratio": self.ratio}


def print_rows(rows: Iterable[Row]) -> None:
    """The rows under a heading."""
    table = [
        (row.what, f"{row.ours_ms:.3g}", f"{row.peer_ms:.3g}", f"{row.ratio:.3g}", row.peer, row.target)
        for row in rows
    ]
    print_table(
        ("median CPU time, ms", "ours", "peer", "peer/ours", "which peer", "target"), table, left=(0, 4, 5)
    )


def print_table(
    heading: Sequence[str], table: Iterable[Sequence[str]], *, left: Iterable[int] = (0,)
) -> None:
    """A table in Markdown, so that what is printed can be pasted into the README."""
    lines = [list(heading), *[list(row) for row in table]]
    widths = [max(len(line[k]) for line in lines) for k in range(len(heading))]
    left = set(left)

    def text(line: Sequence[str]) -> str:
        cells = (
            f"{cell:<{w}}" if k in left else f"{cell:>{w}}"
            for k, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        return "| " + " | ".join(cells) + " |"

    rule = ("-" * (w + 1) + ("-" if k in left else ":") for k, w in enumerate(widths))
    print(text(lines[0]), "|" + "|".join(rule) + "|", *map(text, lines[1:]), sep="\n")


def number(value: float | None, form: str) -> str:
    """A figure as a table shows it; a dash where there is none."""
    return "–" if value is None or value != value else format(value, form)


def circumstances() -> dict[str, Any]:
    """Machine, commit and versions that figures belong to."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "absent"
    if versions["emseg"] == "absent":  # built in place
        import emseg

        versions["emseg"] = emseg.__version__
    return {
        "machine": {
            "processor": _processor(),
            "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
            "system": platform.platform(),
            "load_average": [round(load, 2) for load in os.getloadavg()],
        },
        "commit": _git("describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "versions": versions,
    }


def print_circumstances(found: Mapping[str, Any]) -> None:
    """One line on where the figures come from."""
    machine = found["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in found["versions"].items())
    print(
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load_average'][0]}; "
        f"commit {found['commit']}; {versions}\n"
    )


def write_json(path: Path, found: Mapping[str, Any], **contents: Any) -> None:
    """Figures beside their circumstances."""
    path.write_text(json.dumps({**found, **contents}, indent=2) + "\n", encoding="utf-8")


def require(condition: bool, message: str) -> None:
    """A benchmark's answer is checked before its time counts, also under `python -O`."""
    if not condition:
        raise AssertionError(message)


def _git(*arguments: str) -> str:
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
