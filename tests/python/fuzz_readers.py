"""Damaged recordings of every format: each must give events or one line that says what is wrong with it.

    python tests/python/fuzz_readers.py --cases 20000 [--seed 0] [--only evt3]

Made recordings (made_recordings.py) and, where they are there, the fronts of the real ones in ../shared are
cut, flipped, blanked, lengthened and filled with extreme numbers.  The cases run in a process of their own:
whichever ends it, or takes longer than 5 s, is named at the end, and can be run again with --case.
"""

from __future__ import annotations

import argparse
import importlib.util
import logging
import multiprocessing
import random
import resource
import struct
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

from made_recordings import MADE, made_events

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "real"
REAL_SUFFIXES = (".aedat", ".aedat4", ".bag", ".dat", ".db3", ".hdf5", ".mat", ".mcap", ".npz", ".raw")
FRONT_BYTES = 150_000
LONGEST_S = 5.0
MEMORY_BYTES = 6 << 30
EXTREMES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 62, (1 << 64) - 1)


def sound_files(folder: Path, only: str = "") -> list[Path]:
    """The recordings to damage, by order of their names."""
    files = []
    for name, (suffix, write, modules) in MADE.items():
        if only not in name or not all(is_installed(module) for module in modules):
            continue
        path = folder / f"made {name}{suffix}"
        write(path, made_events(200))
        files.append(path)
    for source in sorted(REAL.rglob("*")):
        is_recording = source.suffix in (
            ".aedat",
            ".aedat4",
            ".bag",
            ".dat",
            ".db3",
            ".hdf5",
            ".mcap",
            ".npz",
            ".raw",
        )
        if is_recording and only in source.name:
            path = folder / f"real {source.name}"
            with source.open("rb") as file:
                is_small = source.stat().st_size < 450_000
                path.write_bytes(file.read(-1 if is_small else FRONT_BYTES))
            files.append(path)
    return files


def is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def damaged(content: bytes, rng: random.Random) -> bytes:
    """Something done to a file's bytes, often near its front."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 3))):
        reach = len(data) if rng.random() < 0.5 else min(len(data), 2000)
        where = rng.randrange(max(reach, 1))
        match rng.choice(("cut", "flip", "flips", "blank", "insert", "number", "repeat", "swap")):
            case "cut":
                del data[where:]
            case "flip":
                data[where : where + 1] = bytes([data[where] ^ 1 << rng.randrange(8)]) if data else b""
            case "flips":
                for _ in range(30):
                    if data:
                        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            case "blank":
                length = min(rng.choice((1, 4, 64, 1000)), len(data) - where)
                data[where : where + length] = bytes([rng.choice((0, 0xFF))]) * length
            case "insert":
                data[where:where] = rng.randbytes(rng.choice((1, 3, 100)))
            case "number":
                form = rng.choice("BHIQ")
                number = rng.choice(EXTREMES) & (1 << 8 * struct.calcsize(form)) - 1
                data[where : where + struct.calcsize(form)] = struct.pack("<" + form, number)
            case "repeat":
                data[where:where] = data[where : where + rng.choice((2, 8, 100))]
            case "swap":
                other = rng.randrange(max(len(data), 1))
                a, b = bytes(data[where : where + 8]), bytes(data[other : other + 8])
                data[where : where + len(b)], data[other : other + len(a)] = b, a
        if not data:
            break
    return bytes(data)


def check(path: Path, *, keep: bool) -> str:
    """Read a file in every way; "read" or "refused".

    Raises:
        AssertionError: where it is refused otherwise than by one line that names it.
    """
    import emseg.io

    try:
        damage = "keep" if keep else "refuse"
        with emseg.io.open_recording(path, damage=damage) as recording:
            count = sum(len(chunk) for chunk in recording.chunks())
            assert count >= 0
            for _ in recording.frames():
                pass
            recording.imu()
    except emseg.io.ReadError as error:
        message = str(error)
        assert message.startswith(str(path)), message
        assert "\n" not in message, message
        assert len(message) < 2000, message
        return "refused"
    return "read"


def run_case(files: list[Path], folder: Path, case: int, seed: int) -> str:
    rng = random.Random(f"{seed}/{case}")
    source = files[case % len(files)]
    path = folder / f"case{source.suffix}"
    path.write_bytes(damaged(source.read_bytes(), rng))
    return check(path, keep=bool(case // len(files) % 2))


def run_cases(files: list[Path], cases: range, seed: int, pipe: Connection) -> None:
    """The process of the cases: sends each one's number before it and its result after it."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        for case in cases:
            pipe.send((case, None))
            try:
                pipe.send((case, run_case(files, Path(folder), case, seed)))
            except Exception as error:
                pipe.send((case, f"{type(error).__name__}: {error}"))
    pipe.send((cases.stop, "end"))


def fuzz(files: list[Path], cases: range, seed: int) -> tuple[Counter[str], list[str]]:
    """Run all cases, whatever becomes of the process: how many were read and refused, and the failures."""
    results: Counter[str] = Counter()
    failures: list[str] = []
    context = multiprocessing.get_context("fork")
    at = cases.start
    while at < cases.stop:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=run_cases, args=(files, range(at, cases.stop), seed, sender))
        process.start()
        sender.close()
        try:
            while at < cases.stop:
                if not receiver.poll(LONGEST_S):
                    raise TimeoutError
                at, result = receiver.recv()
                if result in ("read", "refused"):
                    results[result] += 1
                elif result not in (None, "end"):
                    failures.append(describe(files, at, result))
        except (TimeoutError, EOFError) as error:
            process.kill()
            process.join()
            fault = "hangs" if isinstance(error, TimeoutError) else f"ends the process: {process.exitcode}"
            failures.append(describe(files, at, fault))
            at += 1
        process.join()
    return results, failures


def describe(files: list[Path], case: int, fault: str) -> str:
    return f"case {case} ({files[case % len(files)].name}): {fault}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="only files whose names hold this")
    parser.add_argument("--case", type=int, help="run one case here, and show what it raises")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = sound_files(folder, arguments.only)
        if arguments.case is not None:
            print(run_case(files, folder, arguments.case, arguments.seed))
            return
        began = time.perf_counter()
        results, failures = fuzz(files, range(arguments.cases), arguments.seed)
    print("\n".join(failures))
    seconds = time.perf_counter() - began
    print(
        f"{arguments.cases} cases on {len(files)} files, {seconds:.0f} s:",
        f"{results['read']} read, {results['refused']} refused, {len(failures)} failed",
    )
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
