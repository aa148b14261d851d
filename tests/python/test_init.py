"""`import emseg`: every public name, and nothing heavy."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

import emseg

HEAVY = {
    "scipy",
    "cv2",
    "pandas",
    "dv_processing",
    "matplotlib",
    "torch",
    "numba",
    "importlib.metadata",
    "tqdm",
    "typer",
    "yaml",
}

# The names of the public surface.
PUBLIC = {
    "Camera",
    "Config",
    "EventArray",
    "Segmenter",
    "evaluate",
    "event_graph",
    "expansion",
    "fit_motion",
    "iwe",
    "max_flow",
    "read",
    "segment",
    "warp",
}


def test_public_names_are_listed() -> None:
    assert set(emseg.__all__) >= PUBLIC
    assert set(dir(emseg)) >= PUBLIC


@pytest.mark.parametrize("name", emseg.__all__)
def test_every_listed_name_is_there(name: str) -> None:
    module = emseg._LAZY.get(name, "emseg")
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} has not landed yet")
    assert callable(getattr(emseg, name)) or isinstance(getattr(emseg, name), str)


def test_unknown_names() -> None:
    with pytest.raises(AttributeError, match="'emseg' has no attribute 'segmant'"):
        emseg.segmant  # noqa: B018


def test_submodules_do_not_hide_functions() -> None:
    import emseg.event_graph as module_or_function

    assert callable(module_or_function)
    assert callable(emseg.event_graph)


@pytest.mark.parametrize(
    "use",
    [
        "emseg.__version__",
        "emseg.Segmenter, emseg.Camera, emseg.fit_motion",
        "emseg.segment(events)",
        "list(emseg.Segmenter(20, 10).run(events))",
    ],
)
def test_import_and_segmentation_are_light(use: str) -> None:
    events = "emseg.EventArray([1, 2, 1], [1, 1, 2], [0, 1, 2], [0, 1, 1], width=20, height=10)"
    code = f"import sys, json, emseg; events = {events}; {use}; print(json.dumps([*sys.modules]))"
    environment = {"PYTHONPATH": str(Path(emseg.__file__).parents[1])}
    told = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert not HEAVY & set(json.loads(told.stdout))
