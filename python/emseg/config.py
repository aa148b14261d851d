"""Settings of a segmentation: frozen, typed, with units and sources; YAML both ways."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from emseg.presets import PRESETS
from emseg.yaml_files import ConfigError, nearest, read_yaml

__all__ = ["Config", "ConfigError", "HybridModelCombination"]

HybridModelCombination = Literal[
    "2d", "3d", "4d", "2d+3d", "2d+4d", "3d+4d", "all", "affine", "homography", "auto"
]
"""Which motion models may explain a cluster: translation (2d), rotation (3d), similarity (4d), …"""

# The published integers 0 .. 6, in order.
_PUBLISHED_COMBINATIONS: Final = ("2d", "3d", "4d", "2d+3d", "2d+4d", "3d+4d", "all")

_THESIS: Final = "thesis"
_EMSGC: Final = "arXiv 2012.08730"


def _setting(default: Any, description: str, *, unit: str = "", source: str = "emseg", **limits: Any) -> Any:
    extra: dict[str, Any] = {"unit": unit, "source": source}
    return Field(default, description=description, json_schema_extra=extra, **limits)


class Config(BaseModel):
    """Settings of a segmentation.  The defaults need no number that depends on the scene.

    `emseg config` prints every field with its meaning, unit, range and source.  The names of the published
    code's YAML files (`LAMBDA_smooth`, `BracketRow`, …) are accepted in files and by :meth:`from_mapping`.

    Raises:
        pydantic.ValidationError: a ValueError that names the field and what was expected.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=False
    )

    num_events_per_image: Annotated[int | None, Field(ge=10, le=100_000_000)] = _setting(
        None, "Events in a window; null: by window_duration, else adaptively", unit="events", source=_EMSGC
    )
    window_duration: Annotated[float | None, Field(gt=0, le=60)] = _setting(
        None, "Duration of a window; null: by num_events_per_image, else adaptively", unit="s"
    )
    data_term: Literal["logarithmic", "published"] = _setting(
        "logarithmic", "How an event's fit to a motion is scored; published: 255 (1 - IWE / max IWE)"
    )
    lambda_data: float = _setting(1.0, "Weight of the data term", source=_EMSGC, gt=0, le=1e6)
    lambda_smooth: float = _setting(
        30.0, "Potts weight: cost of an edge of the event graph with two labels", source=_EMSGC, ge=0, le=1e6
    )
    lambda_label: Annotated[float | None, Field(ge=0, le=1e12)] = _setting(
        None, "Cost of a label that is used; null: grows with the window, 0.2 an event", source=_EMSGC
    )
    bracket_row: int = _setting(
        6, "Most rows of sub-volumes at which motions are searched", source=_EMSGC, ge=1, le=32
    )
    bracket_col: int = _setting(
        6, "Most columns of sub-volumes at which motions are searched", source=_EMSGC, ge=1, le=32
    )
    affine_trans2d_max: float = _setting(
        5000.0, "Largest translation searched, each way", unit="px/s", source=_EMSGC, gt=0, le=1e6
    )
    affine_scale_max: float = _setting(
        0.5, "Largest scaling searched, each way", unit="1/s", source=_EMSGC, ge=0, le=1e3
    )
    affine_theta_max: float = _setting(
        1.5, "Largest rotation searched, each way", unit="rad/s", source=_EMSGC, ge=0, le=1e3
    )
    division_exponent: int = _setting(
        7,
        "Halvings of the published grid search; read from published files, the engine searches otherwise",
        source=_EMSGC,
        ge=1,
        le=16,
    )
    hybrid_model_combination: HybridModelCombination = _setting(
        "2d+4d", "Motion models that may explain a cluster; 0 .. 6 as published", source=_THESIS
    )
    num_iter_segmentation: int = _setting(
        5, "Most alternations of labels and models", source=_EMSGC, ge=1, le=1000
    )
    num_iter_labeling: int = _setting(
        2, "Most sweeps of expansion moves in an alternation", source=_EMSGC, ge=1, le=1000
    )
    sigma: float = _setting(
        1.0,
        "Standard deviation of the blur of images of events",
        unit="px",
        source=_EMSGC,
        ge=0.1,
        le=10,
    )
    noise_label: Literal["auto", "off"] = _setting(
        "auto", "Whether events that no motion explains are labelled as noise (-1)"
    )
    threads: int = _setting(0, "Threads; 0: all cores.  The result is the same for any number", ge=0, le=1024)
    seed: int = _setting(
        0, "Recorded with every run; the engine itself has nothing random", ge=0, le=2**63 - 1
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, values: Any) -> Any:
        if isinstance(values, Mapping):
            for key in values:
                if key not in cls.model_fields:
                    raise ValueError(_unknown_key(key))
        return values

    @field_validator("*", mode="before")
    @classmethod
    def _unwrap_numpy_scalars(cls, value: Any) -> Any:
        return value.item() if isinstance(value, np.generic) else value

    @field_validator("hybrid_model_combination", mode="before")
    @classmethod
    def _name_published_combination(cls, value: Any) -> Any:
        if isinstance(value, int) and not isinstance(value, bool):
            if not 0 <= value < len(_PUBLISHED_COMBINATIONS):
                raise ValueError(f"{value} is no published combination, expected 0..6 or a name")
            return _PUBLISHED_COMBINATIONS[value]
        return value.lower() if isinstance(value, str) else value

    @model_validator(mode="after")
    def _refuse_two_window_rules(self) -> Self:
        if self.num_events_per_image is not None and self.window_duration is not None:
            raise ValueError(
                f"num_events_per_image is {self.num_events_per_image} and window_duration is "
                f"{self.window_duration}, expected at most one of them"
            )
        return self

    @classmethod
    def auto(cls) -> Self:
        """The defaults, which need no number that depends on the scene."""
        return cls()

    @classmethod
    def preset(cls, name: str) -> Self:
        """Published settings by name, such as "eed/fast_drone"; :meth:`presets` lists them.

        Raises:
            ConfigError: for an unknown name.
        """
        if name not in PRESETS:
            there_are = ", ".join(PRESETS)
            raise ConfigError(f"unknown preset '{name}'{nearest(name, PRESETS)}; there are {there_are}")
        return cls(**PRESETS[name])

    @classmethod
    def presets(cls) -> list[str]:
        """The names of all presets."""
        return list(PRESETS)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], *, origin: str = "settings") -> Self:
        """Settings by our names or by the published upper-case ones.

        Args:
            values: Settings by name.
            origin: What to call them in an error.

        Raises:
            ConfigError: naming the origin, the key and what was expected.
        """
        named: dict[str, Any] = {}
        for key, value in values.items():
            name = _PUBLISHED_KEYS.get(str(key), str(key))
            if name in named:
                raise ConfigError(f"{origin}: {key}: is given twice, expected one of the two names")
            named[name] = value
        try:
            return cls(**named)
        except ValidationError as error:
            raise ConfigError(f"{origin}: {_first_problem(error)}") from None

    @classmethod
    def from_yaml(cls, path: str | PathLike[str]) -> Self:
        """Settings from a YAML file: ours, or one of the published code with its OpenCV header.

        Raises:
            ConfigError: naming the file, the key and what was expected.
        """
        return cls.from_mapping(read_yaml(path), origin=str(path))

    def to_yaml(self, path: str | PathLike[str] | None = None) -> str:
        """These settings as YAML, each under a comment that explains it; also written to `path` if given."""
        lines = []
        for name, value in self.model_dump().items():
            lines.append(f"# {explain(name)}")
            lines.append(yaml.safe_dump({name: value}, default_flow_style=False).strip())
        text = "\n".join(lines) + "\n"
        if path is not None:
            Path(path).write_text(text, encoding="utf-8")
        return text

    def fingerprint(self) -> str:
        """Hash of every setting that can change the result (all but `threads`)."""
        values = self.model_dump(exclude={"threads"})
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


_PUBLISHED_KEYS: Final[dict[str, str]] = {
    "num_events_per_image": "num_events_per_image",
    "LAMBDA_data": "lambda_data",
    "LAMBDA_smooth": "lambda_smooth",
    "LAMBDA_label": "lambda_label",
    "BracketRow": "bracket_row",
    "BracketCol": "bracket_col",
    "Affine_trans2d_max": "affine_trans2d_max",
    "Affine_scale_max": "affine_scale_max",
    "Affine_theta_max": "affine_theta_max",
    "division_exponent": "division_exponent",
    "HybridModelCombination": "hybrid_model_combination",
    "NUM_ITER_SEGMENTATION": "num_iter_segmentation",
    "NUM_ITER_LABELING": "num_iter_labeling",
}


@cache
def _schema() -> dict[str, Any]:
    properties: dict[str, Any] = Config.model_json_schema()["properties"]
    return properties


def explain(name: str) -> str:
    """One line on a setting: meaning, unit, range or choices, and source."""
    field = Config.model_fields[name]
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    schema = _schema()[name]
    kind = next((part for part in schema.get("anyOf", [schema]) if part.get("type") != "null"), schema)
    bounds = [
        f"{sign} {kind[key]:g}"
        for key, sign in (
            ("exclusiveMinimum", ">"),
            ("minimum", "≥"),
            ("maximum", "≤"),
        )
        if key in kind
    ]
    about = [str(extra.get("unit") or ""), " ".join(bounds) or " | ".join(kind.get("enum", []))]
    return f"{field.description} [{', '.join(part for part in about if part)}; {extra.get('source')}]"


def _unknown_key(key: object) -> str:
    return f"{key}: unknown key{nearest(str(key), [*Config.model_fields, *_PUBLISHED_KEYS])}"


def _first_problem(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    key = f"{first['loc'][0]}: " if first["loc"] else ""
    message = first["msg"].removeprefix("Value error, ")
    given = f", not {first['input']!r}" if first["loc"] else ""
    return f"{key}{message}{given}"
