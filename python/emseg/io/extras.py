"""Packages that only some formats need."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

from emseg.io.errors import ReadError

__all__ = ["require"]


def require(module: str, package: str, what: str, path: Path) -> ModuleType:
    """Import a module that comes with the extra `io`.

    Args:
        module: The module.
        package: The package that brings it.
        what: What it is needed for.
        path: The file that needs it.

    Raises:
        ReadError: where it is not installed, with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        problem = f"{what} needs {package}, which is not installed: pip install 'emseg[io]'"
        raise ReadError(path, problem) from None
