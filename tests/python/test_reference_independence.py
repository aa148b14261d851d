import ast
from pathlib import Path

import emseg.metrics
import emseg.reference


def test_reference_and_metrics_import_nothing_of_the_engine():
    """They are what the engine is held against, so they may share no code with it."""
    packages = [Path(package.__file__).parent for package in (emseg.reference, emseg.metrics)]
    sources = [path for package in packages for path in sorted(package.glob("*.py"))]
    assert len(sources) > 15
    for source in sources:
        for node in ast.walk(ast.parse(source.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert not name.startswith("emseg") or name.startswith(
                    ("emseg.reference.", "emseg.metrics.")
                ), f"{source.name}: {name}"
            assert not (isinstance(node, ast.ImportFrom) and node.level), f"{source.name}: relative import"
