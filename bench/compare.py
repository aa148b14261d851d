"""Two commits beside each other: one benchmark run by both in turns, its times and its quality.

``python -m bench.compare A B [--rounds N] [--bench own|a|b] [-- BENCHMARK ARGUMENTS …]``, such as
``python -m bench.compare main HEAD -- bench.stages --windows 240x180_15k --reference none``

Both commits are built for speed in temporary working trees, which are removed at the end, also of an
interrupted run.  Ratios are A's time over B's: above 1, B is faster.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

from bench.common import ROOT, print_table, require
from bench.figures import figures_of, is_quality, is_repeatable, is_time

BENCHMARKS: Final = ("bench.stages", "bench.kernels", "bench.sequences", "bench.growth", "bench.start_up")
DEFAULT: Final = ["bench.stages", "--repeats", "3", "--fresh", "1", "--reference", "none"]


class Failed(Exception):
    """A step that went wrong, in one line."""


# --- working trees -----------------------------------------------------------------------------------------


def run(command: Sequence[str], *, cwd: Path, log: Path, env: dict[str, str] | None = None) -> None:
    """Run to the end in a process group of its own, which is ended with us.

    Raises:
        Failed: with the last line of what it said.
    """
    with log.open("w", encoding="utf-8") as out:
        process = subprocess.Popen(
            command, cwd=cwd, env=env, stdout=out, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            status = process.wait()
        except BaseException:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
            process.wait()
            raise
    if status:
        said = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise Failed(f"{' '.join(command)} in {cwd.name} failed: {said[-1] if said else status}")


def git(*arguments: str) -> str:
    """What a git command in this repository says."""
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise Failed(f"git {' '.join(arguments)}: {done.stderr.strip().splitlines()[-1]}")
    return done.stdout.strip()


def end_on_signal(number: int, frame: FrameType | None) -> NoReturn:
    """So that what was begun is cleaned up."""
    raise SystemExit(128 + number)


@contextlib.contextmanager
def working_trees(commits: dict[str, str]) -> Iterator[dict[str, Path]]:
    """A detached working tree for each commit, with the shared recordings beside them."""
    folder = Path(tempfile.mkdtemp(prefix="emseg-compare-"))
    trees = {side: folder / side for side in commits}
    handlers = {number: signal.signal(number, end_on_signal) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        shared = ROOT.parent / "shared"
        if shared.exists():
            (folder / "shared").symlink_to(shared.resolve(), target_is_directory=True)
        for side, commit in commits.items():
            git("worktree", "add", "--quiet", "--detach", str(trees[side]), commit)
        yield trees
    finally:
        for tree in trees.values():
            with contextlib.suppress(Failed):  # the tree of an early interruption is not known to git
                git("worktree", "remove", "--force", str(tree))
        shutil.rmtree(folder, ignore_errors=True)
        for number, handler in handlers.items():
            signal.signal(number, handler)


def build(tree: Path, log: Path) -> None:
    """The extension module, for speed, into the tree's package."""
    cmakedir = subprocess.run(
        [sys.executable, "-m", "pybind11", "--cmakedir"], capture_output=True, text=True, check=True
    ).stdout.strip()
    configure = ["cmake", "--preset", "release", "-DEMSEG_TESTS=OFF", f"-Dpybind11_DIR={cmakedir}"]
    run([*configure, f"-DPython_EXECUTABLE={sys.executable}"], cwd=tree, log=log)
    run(["cmake", "--build", "--preset", "release"], cwd=tree, log=log)


def measure(tree: Path, benchmark: Sequence[str], folder: Path) -> dict[str, float]:
    """The figures of one run of the benchmark by a tree."""
    written = folder / "figures.json"
    environment = os.environ | {"PYTHONPATH": str(tree / "python")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled, too
    command = [sys.executable, "-m", *benchmark, "--json", str(written)]
    run(command, cwd=tree, log=folder / f"{tree.name}.log", env=environment)
    return figures_of(json.loads(written.read_text(encoding="utf-8")))


# --- figures -----------------------------------------------------------------------------------------------


def check_answers(side: str, rounds: Sequence[dict[str, float]]) -> None:
    """Every run of a commit gives one answer; the benchmark itself has checked that it is right."""
    for key in filter(is_repeatable, rounds[0]):
        found = {figures.get(key) for figures in rounds}
        require(len(found) == 1, f"{side}: {key} differs between runs: {sorted(map(str, found))}")


def time_rows(a: Sequence[dict[str, float]], b: Sequence[dict[str, float]]) -> list[dict[str, Any]]:
    """Times that both commits have: medians, and the ratio with its spread over the rounds."""
    rows = []
    for key in filter(is_time, a[0]):
        if key not in b[0] or min(a[0][key], b[0][key]) <= 0:
            continue
        ratios = [one[key] / other[key] for one, other in zip(a, b, strict=True)]
        rows.append(
            {
                "figure": key,
                "a": statistics.median(figures[key] for figures in a),
                "b": statistics.median(figures[key] for figures in b),
                "ratio": statistics.median(ratios),
                "least": min(ratios),
                "most": max(ratios),
            }
        )
    return rows


def quality_rows(a: Sequence[dict[str, float]], b: Sequence[dict[str, float]]) -> list[dict[str, Any]]:
    """Quality that both commits have."""
    rows = []
    for key in filter(is_quality, a[0]):
        if key in b[0]:
            one, other = (statistics.median(figures[key] for figures in side) for side in (a, b))
            rows.append({"figure": key, "a": one, "b": other, "change": other - one})
    return rows


def print_comparison(compared: dict[str, Any]) -> None:
    print_table(
        ("times", "A", "B", "A/B", "spread"),
        [
            (
                row["figure"],
                f"{row['a']:.4g}",
                f"{row['b']:.4g}",
                f"{row['ratio']:.2f}",
                f"{row['least']:.2f} .. {row['most']:.2f}",
            )
            for row in compared["times"]
        ],
    )
    print()
    print_table(
        ("quality", "A", "B", "B - A"),
        [
            (row["figure"], f"{row['a']:.6g}", f"{row['b']:.6g}", f"{row['change']:+.4g}")
            for row in compared["quality"]
        ],
    )


# --- the command -------------------------------------------------------------------------------------------


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    end = arguments.index("--") if "--" in arguments else len(arguments)
    ours, benchmark = arguments[:end], arguments[end + 1 :] or DEFAULT
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("a", metavar="A", help="a commit, by any of its names")
    parser.add_argument("b", metavar="B", help="another one")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each commit, in turns")
    parser.add_argument(
        "--bench",
        choices=("own", "a", "b"),
        default="own",
        help="whose benchmark both run: each its own, or one commit's, where it can drive the other",
    )
    parser.add_argument("--json", type=Path, help="also write the comparison here")
    options = parser.parse_args(ours)
    options.benchmark = list(benchmark)
    if not options.benchmark or options.benchmark[0] not in BENCHMARKS:
        parser.error(f"benchmark {options.benchmark[:1]}, expected one of {', '.join(BENCHMARKS)}")
    if options.rounds < 1:
        parser.error(f"--rounds is {options.rounds}, expected at least 1")
    return options


def compare(options: argparse.Namespace) -> dict[str, Any]:
    commits = {
        side: git("rev-parse", "--verify", f"{name}^{{commit}}")
        for side, name in (("A", options.a), ("B", options.b))
    }
    results: dict[str, list[dict[str, float]]] = {side: [] for side in commits}
    with working_trees(commits) as trees:
        for side, tree in trees.items():
            print(f"{side}: building {commits[side][:12]} …", file=sys.stderr, flush=True)
            build(tree, tree.parent / f"{side}.build.log")
        if options.bench != "own":
            source, target = (trees[side] for side in ("AB" if options.bench == "a" else "BA"))
            shutil.rmtree(target / "bench")
            shutil.copytree(source / "bench", target / "bench")
        for turn in range(options.rounds):
            for side in "BA" if turn % 2 else "AB":  # so that a machine that slows down favours neither
                tree = trees[side]
                print(f"{side}: run {turn + 1} of {options.rounds} …", file=sys.stderr, flush=True)
                results[side].append(measure(tree, options.benchmark, tree.parent))
    for side, rounds in results.items():
        check_answers(side, rounds)
    return {
        "a": commits["A"],
        "b": commits["B"],
        "benchmark": options.benchmark,
        "rounds": options.rounds,
        "times": time_rows(results["A"], results["B"]),
        "quality": quality_rows(results["A"], results["B"]),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    options = parse(list(sys.argv[1:] if arguments is None else arguments))
    try:
        compared = compare(options)
    except Failed as failed:
        sys.exit(f"bench.compare: {failed}")
    print(f"A {compared['a'][:12]}, B {compared['b'][:12]}: {' '.join(compared['benchmark'])}\n")
    print_comparison(compared)
    if options.json:
        options.json.write_text(json.dumps(compared, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
