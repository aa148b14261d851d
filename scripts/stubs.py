"""Write python/emseg/_core.pyi from the built module, or with --check say whether it is up to date."""

import argparse
import difflib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
STUB = ROOT / "python" / "emseg" / "_core.pyi"
ANY_ARRAY = r"typing\.Annotated\[numpy\.typing\.ArrayLike, (numpy\.\w+)\]"


def generate() -> str:
    """The stub of emseg._core as pybind11-stubgen and ruff write it."""
    with tempfile.TemporaryDirectory() as folder:
        python_tool("pybind11_stubgen", "emseg._core", "--exit-code", "-o", folder)
        stub = Path(folder, "emseg", "_core.pyi")
        # The module takes arrays of the very type, so that large ones are not copied in silence.
        stub.write_text(re.sub(ANY_ARRAY, r"numpy.typing.NDArray[\1]", stub.read_text()))
        for action in (["check", "--fix-only"], ["format"]):
            python_tool("ruff", *action, "--quiet", "--config", str(ROOT / "pyproject.toml"), str(stub))
        return stub.read_text()


def python_tool(module: str, *arguments: str) -> None:
    """Run a tool of this interpreter; show its output only where it fails."""
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: exit {done.returncode}\n{done.stdout}{done.stderr}")


def main() -> None:
    """Write the stub, or compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 where the file is stale")
    check = parser.parse_args().check
    wanted = generate()
    if not check:
        STUB.write_text(wanted)
        return
    present = STUB.read_text() if STUB.exists() else ""
    if present != wanted:
        lines = present.splitlines(), wanted.splitlines()
        difference = difflib.unified_diff(*lines, "present", "generated", n=1, lineterm="")
        sys.exit("\n".join([f"{STUB} is stale: run `./run format`", *difference]))


if __name__ == "__main__":
    main()
