"""YAML mappings from files: ours, and those that OpenCV writes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from os import PathLike
from typing import Any, Final

__all__ = ["ConfigError", "nearest", "read_yaml"]

_OPENCV_HEADER: Final = re.compile(r"\A%YAML[: ]1\.\d[^\n]*\n(---[^\n]*\n)?")

# Numbers that YAML 1.1, and so PyYAML, takes for text: 1e4 has neither point nor sign.
_PLAIN_EXPONENT: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


class ConfigError(ValueError):
    """Settings that cannot be used: names the file, the key and what was expected, in one line."""


def nearest(name: str, known: Iterable[str]) -> str:
    """A hint at the known name that is nearest to an unknown one; "" where none is near."""
    import difflib  # slow to import, and needed after a mistake only

    by_lower_case: dict[str, str] = {}
    for key in known:
        by_lower_case.setdefault(key.lower(), key)
    close = difflib.get_close_matches(name.lower(), by_lower_case, n=1, cutoff=0.5)
    return f", did you mean '{by_lower_case[close[0]]}'?" if close else ""


def read_yaml(path: str | PathLike[str]) -> dict[str, Any]:
    """The mapping in a YAML file; the header "%YAML:1.0" that OpenCV writes is passed over.

    Raises:
        ConfigError: naming the file and the line.
    """
    import yaml  # slow to import, and settings rarely come from files

    try:
        with open(path, encoding="utf-8-sig") as file:
            text = file.read()
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be opened: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is no text, expected YAML") from None
    # Its lines stay, empty, so that errors name the right ones.
    text = _OPENCV_HEADER.sub(lambda match: "\n" * match[0].count("\n"), text)
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise ConfigError(f"{path}: {place}no valid YAML: {problem}") from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: holds a {type(values).__name__}, expected lines 'key: value'")
    seen: set[str] = set()
    for key, _ in node.value:
        if key.value in seen:
            raise ConfigError(f"{path}: line {key.start_mark.line + 1}: {key.value} is given twice")
        seen.add(key.value)
    return {str(key): _number(value) for key, value in values.items()}


def _number(value: Any) -> Any:
    if isinstance(value, list):
        return [_number(item) for item in value]
    return float(value) if isinstance(value, str) and _PLAIN_EXPONENT.fullmatch(value) else value
