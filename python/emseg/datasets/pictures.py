"""Reading the PNG files of masks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from emseg.datasets.truth import DatasetError

__all__ = ["read_png"]


def read_png(path: Path) -> npt.NDArray[Any]:
    """A picture, (h, w) or (h, w, 3) red, green, blue, uint8 or uint16.

    Raises:
        DatasetError: it is missing or damaged, or OpenCV, of the extra `viz`, is not installed.
    """
    try:
        import cv2
    except ImportError:
        problem = "reading PNG needs OpenCV, which is not installed: pip install 'emseg[viz]'"
        raise DatasetError(f"{path}: {problem}") from None
    try:
        content = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}, expected a picture") from None
    picture = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if picture is None:
        raise DatasetError(f"{path}: damaged, expected a picture")
    return np.asarray(picture if picture.ndim == 2 else picture[..., 2::-1])
