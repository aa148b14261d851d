"""Settings as fields of a dataclass: each says what it means, what it may be, and where it comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np

__all__ = ["Setting", "choice", "number", "setting_of", "whole_number"]

Kind = Literal["whole number", "number", "choice"]

_SETTING: Final = "setting"


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What a field may be.

    Attributes:
        kind: What its values are.
        description: One line on what it means.
        unit: Of its values; "" where there is none.
        source: Where the setting comes from.
        optional: Whether it may be left open, as None.
        above: Bound that a number must exceed.
        least: Smallest number.
        most: Largest number.
        choices: The words to choose from.
    """

    kind: Kind
    description: str
    unit: str
    source: str
    optional: bool = False
    above: float | None = None
    least: float | None = None
    most: float | None = None
    choices: tuple[str, ...] = ()

    def checked(self, value: Any) -> int | float | str | None:
        """The value in the type of the field.

        NumPy's scalars are unwrapped and whole numbers will do for others; nothing else is converted.

        Raises:
            ValueError: "is <value>, expected <what it may be>".
        """
        if isinstance(value, np.generic):
            value = value.item()
        if value is None and self.optional:
            return None
        if self.kind == "choice":
            accepted = isinstance(value, str) and value in self.choices
        elif isinstance(value, bool) or not isinstance(value, int | float):
            accepted = False
        else:
            accepted = (isinstance(value, int) or self.kind == "number") and self._in_range(value)
        if not accepted:
            raise ValueError(f"is {value!r}, expected {self.expectation}")
        return float(value) if self.kind == "number" else value

    def _in_range(self, value: float) -> bool:
        return (
            (isinstance(value, int) or math.isfinite(value))
            and (self.above is None or value > self.above)
            and (self.least is None or value >= self.least)
            and (self.most is None or value <= self.most)
        )

    @property
    def bounds(self) -> str:
        """The range of a number, as "> 0 ≤ 60"."""
        signs = ((">", self.above), ("≥", self.least), ("≤", self.most))
        return " ".join(f"{sign} {bound:g}" for sign, bound in signs if bound is not None)

    @property
    def expectation(self) -> str:
        """What a value should be, for an error."""
        if self.kind == "choice":
            kind = " or ".join(map(repr, self.choices))
        else:
            kind = " ".join(filter(None, ["a", self.kind, self.bounds, self.unit]))
        return f"{kind}, or null" if self.optional else kind

    @property
    def explanation(self) -> str:
        """One line: meaning, unit, range or choices, and source."""
        about = filter(None, [self.unit, self.bounds or " | ".join(self.choices)])
        return f"{self.description} [{', '.join(about)}; {self.source}]"


def whole_number(
    default: int | None,
    description: str,
    *,
    least: int,
    most: int,
    unit: str = "",
    source: str = "emseg",
) -> Any:
    """A field of whole numbers; one whose default is None may be left open."""
    setting = Setting(
        kind="whole number",
        description=description,
        unit=unit,
        source=source,
        optional=default is None,
        least=least,
        most=most,
    )
    return field(default=default, metadata={_SETTING: setting})


def number(
    default: float | None,
    description: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float,
    unit: str = "",
    source: str = "emseg",
) -> Any:
    """A field of finite numbers; one whose default is None may be left open."""
    setting = Setting(
        kind="number",
        description=description,
        unit=unit,
        source=source,
        optional=default is None,
        above=above,
        least=least,
        most=most,
    )
    return field(default=default, metadata={_SETTING: setting})


def choice(default: str, description: str, *, choices: tuple[str, ...], source: str = "emseg") -> Any:
    """A field that holds one of some words."""
    setting = Setting(kind="choice", description=description, unit="", source=source, choices=choices)
    return field(default=default, metadata={_SETTING: setting})


def setting_of(owner: type, name: str) -> Setting:
    """What a field of a dataclass may be.

    Raises:
        KeyError: no such field, or one that is no setting.
    """
    setting: Setting = owner.__dataclass_fields__[name].metadata[_SETTING]  # type: ignore[attr-defined]
    return setting
