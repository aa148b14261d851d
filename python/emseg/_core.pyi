"""
The native core of emseg; the public surface is the emseg package.
"""

from __future__ import annotations

import typing

import numpy
import numpy.typing

__all__: list[str] = ["check_events", "version"]

def check_events(
    x: typing.Annotated[numpy.typing.ArrayLike, numpy.uint16],
    y: typing.Annotated[numpy.typing.ArrayLike, numpy.uint16],
    t: typing.Annotated[numpy.typing.ArrayLike, numpy.int64],
    p: typing.Annotated[numpy.typing.ArrayLike, numpy.uint8],
    width: typing.SupportsInt | typing.SupportsIndex,
    height: typing.SupportsInt | typing.SupportsIndex,
) -> None:
    """
    Raise ValueError at the first event out of order, off the sensor or with a wrong polarity.
    """

version: str = "0.1.0"
