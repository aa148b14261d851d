"""emseg: motion segmentation with event cameras.

Names are imported when first used, so that `import emseg` stays quick; see __all__ for the public ones.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

from emseg import _core
from emseg.event_graph import event_graph  # at once: later the module of this name would hide the function
from emseg.events import EventArray

if TYPE_CHECKING:
    from emseg.camera import Camera
    from emseg.config import Config
    from emseg.graph_cut import expansion, max_flow
    from emseg.io import ReadError, read
    from emseg.metrics import evaluate
    from emseg.motion import MotionModel, fit_motion, iwe, warp
    from emseg.segmentation import Segmentation, Segmenter, segment
    from emseg.simulation import simulate

__version__: Final[str] = _core.version

# Public names by the module that holds them.
_LAZY: Final[dict[str, str]] = {
    "Camera": "emseg.camera",
    "Config": "emseg.config",
    "MotionModel": "emseg.motion",
    "ReadError": "emseg.io",
    "Segmentation": "emseg.segmentation",
    "Segmenter": "emseg.segmentation",
    "evaluate": "emseg.metrics",
    "expansion": "emseg.graph_cut",
    "fit_motion": "emseg.motion",
    "iwe": "emseg.motion",
    "max_flow": "emseg.graph_cut",
    "read": "emseg.io",
    "segment": "emseg.segmentation",
    "simulate": "emseg.simulation",
    "warp": "emseg.motion",
}

__all__ = [
    "Camera",
    "Config",
    "EventArray",
    "MotionModel",
    "ReadError",
    "Segmentation",
    "Segmenter",
    "__version__",
    "evaluate",
    "event_graph",
    "expansion",
    "fit_motion",
    "iwe",
    "max_flow",
    "read",
    "segment",
    "simulate",
    "warp",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'emseg' has no attribute {name!r}")
    try:
        value = getattr(importlib.import_module(_LAZY[name]), name)
    except ModuleNotFoundError as error:
        if error.name == _LAZY[name]:
            raise AttributeError(f"module 'emseg' has no attribute {name!r} in this build") from None
        raise
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})
