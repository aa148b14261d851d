"""Settings of a segmentation: frozen, typed, with units and sources; YAML both ways."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from os import PathLike
from typing import Any, Final, Literal, Self, get_args

import numpy as np

from emseg.presets import PRESETS
from emseg.settings import choice, number, setting_of, whole_number
from emseg.yaml_files import ConfigError, nearest, read_yaml

__all__ = ["Config", "ConfigError", "DataTerm", "HybridModelCombination", "Labelling", "NoiseLabel"]

DataTerm = Literal["logarithmic", "published"]
"""How an event's fit to a motion is scored."""

HybridModelCombination = Literal[
    "2d", "3d", "4d", "2d+3d", "2d+4d", "3d+4d", "all", "affine", "homography", "auto"
]
"""Which motion models may explain a cluster: translation (2d), rotation (3d), similarity (4d), …"""

Labelling = Literal["bands", "exact"]
"""How labels are found for given motions: from coarse to fine, or by moves on all events at once."""

NoiseLabel = Literal["auto", "off"]
"""Whether events that no motion explains are labelled as noise."""

Polarity = Literal["opposed", "ignored"]
"""What the polarity of an event says of the images that it is part of."""

Footprint = Literal["scattered", "point"]
"""Where on its pixel an event is taken to be."""

Flicker = Literal["left_out", "kept"]
"""What becomes of bursts of events all over the sensor."""

Background = Literal["scene", "widest"]
"""What label 0 is."""

# The published integers 0 .. 6, in order.
_PUBLISHED_COMBINATIONS: Final = ("2d", "3d", "4d", "2d+3d", "2d+4d", "3d+4d", "all")

_THESIS: Final = "thesis"
_EMSGC: Final = "arXiv 2012.08730"


@dataclass(frozen=True, kw_only=True)
class Config:
    """Settings of a segmentation.  The defaults need no number that depends on the scene.

    `emseg config` prints every field with its meaning, unit, range and source.  The names of the published
    code's YAML files (`LAMBDA_smooth`, `BracketRow`, …) are accepted in files and by :meth:`from_mapping`.
    `dataclasses.replace` changes some settings of a config, and checks them.

    Raises:
        ConfigError: a ValueError that names the field, its value and what was expected.
    """

    num_events_per_image: int | None = whole_number(
        None,
        "Events in a window; null: by window_duration, else adaptively",
        unit="events",
        source=_EMSGC,
        least=10,
        most=100_000_000,
    )
    window_duration: float | None = number(
        None,
        "Duration of a window; null: by num_events_per_image, else adaptively",
        unit="s",
        above=0,
        most=60,
    )
    data_term: DataTerm = choice(
        "logarithmic",
        "How an event's fit to a motion is scored; published: 255 (1 - IWE / max IWE)",
        choices=get_args(DataTerm),
    )
    lambda_data: float = number(1.0, "Weight of the data term", source=_EMSGC, above=0, most=1e6)
    lambda_smooth: float = number(
        24.0,
        "Potts weight: cost of an edge of the event graph with two labels",
        source=_EMSGC,
        least=0,
        most=1e6,
    )
    lambda_label: float | None = number(
        None,
        "Cost of a label that is used; null: grows with the window, 0.25 an event",
        source=_EMSGC,
        least=0,
        most=1e12,
    )
    lambda_speed: float = number(
        15.0,
        "Cost of an event by a motion, times log(1 + px over the window / 10): fast ones are sharp by chance",
        least=0,
        most=255,
    )
    lambda_edge: float = number(
        50.0,
        "As lambda_speed, of the way along straight edges, which is not seen; half as much in the labels",
        least=0,
        most=255,
    )
    polarity: Polarity = choice(
        "opposed",
        "Whether rising and falling events take each other away in images of events, or count alike",
        choices=get_args(Polarity),
    )
    footprint: Footprint = choice(
        "scattered",
        "Where on its pixel an event is taken to be: anywhere, scattered; or in the middle",
        choices=get_args(Footprint),
    )
    flicker: Flicker = choice(
        "left_out",
        "Whether bursts of events all over the sensor are kept out of the search for motions",
        choices=get_args(Flicker),
    )
    background: Background = choice(
        "scene",
        "What label 0 is: all that stands still in the scene, or the motion that is most widely spread",
        choices=get_args(Background),
    )
    bracket_row: int = whole_number(
        6, "Most rows of sub-volumes at which motions are searched", source=_EMSGC, least=1, most=32
    )
    bracket_col: int = whole_number(
        6, "Most columns of sub-volumes at which motions are searched", source=_EMSGC, least=1, most=32
    )
    affine_trans2d_max: float = number(
        5000.0, "Largest translation searched, each way", unit="px/s", source=_EMSGC, above=0, most=1e6
    )
    affine_scale_max: float = number(
        0.5, "Largest scaling searched, each way", unit="1/s", source=_EMSGC, least=0, most=1e3
    )
    affine_theta_max: float = number(
        1.5, "Largest rotation searched, each way", unit="rad/s", source=_EMSGC, least=0, most=1e3
    )
    division_exponent: int = whole_number(
        7,
        "Halvings of the published grid search; read from published files, the engine searches otherwise",
        source=_EMSGC,
        least=1,
        most=16,
    )
    hybrid_model_combination: HybridModelCombination = choice(
        "2d+4d",
        "Motion models that may explain a cluster; 0 .. 6 as published",
        choices=get_args(HybridModelCombination),
        source=_THESIS,
    )
    num_iter_segmentation: int = whole_number(
        5, "Most alternations of labels and models", source=_EMSGC, least=1, most=1000
    )
    num_iter_labeling: int = whole_number(
        2, "Most sweeps of expansion moves in an alternation", source=_EMSGC, least=1, most=1000
    )
    labelling: Labelling = choice(
        "bands",
        "How labels are found for given motions: from coarse to fine, or by exact moves on all events",
        choices=get_args(Labelling),
    )
    max_events_per_window: int | None = whole_number(
        60_000,
        "Events that motions and labels are found on, evenly in time; the rest follow them; null: all",
        unit="events",
        least=1,
        most=100_000_000,
        optional=True,
    )
    sigma: float = number(
        0.7,
        "Standard deviation of the blur of images of events",
        unit="px",
        source=_EMSGC,
        least=0.1,
        most=10,
    )
    noise_label: NoiseLabel = choice(
        "auto",
        "Whether events that no motion explains are labelled as noise (-1)",
        choices=get_args(NoiseLabel),
    )
    threads: int = whole_number(
        0, "Threads; 0: all cores.  The result is the same for any number", least=0, most=1024
    )
    seed: int = whole_number(
        0, "Recorded with every run; the engine itself has nothing random", least=0, most=2**63 - 1
    )

    def __new__(cls, **values: Any) -> Self:
        """Refuse unknown names before __init__ does, which would name none near."""
        for key in values:
            if key not in cls.__dataclass_fields__:
                raise ConfigError(_unknown_key(key))
        return super().__new__(cls)

    def __post_init__(self) -> None:
        combination = _combination_name(self.hybrid_model_combination)
        object.__setattr__(self, "hybrid_model_combination", combination)
        for name in self.__dataclass_fields__:
            try:
                value = setting_of(Config, name).checked(getattr(self, name))
            except ValueError as error:
                raise ConfigError(f"{name}: {error}") from None
            object.__setattr__(self, name, value)
        if self.num_events_per_image is not None and self.window_duration is not None:
            raise ConfigError(
                f"num_events_per_image is {self.num_events_per_image} and window_duration is "
                f"{self.window_duration}, expected at most one of them"
            )

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
        except ConfigError as error:
            raise ConfigError(f"{origin}: {error}") from None

    @classmethod
    def from_yaml(cls, path: str | PathLike[str]) -> Self:
        """Settings from a YAML file: ours, or one of the published code with its OpenCV header.

        Raises:
            ConfigError: naming the file, the key and what was expected.
        """
        return cls.from_mapping(read_yaml(path), origin=str(path))

    def to_yaml(self, path: str | PathLike[str] | None = None) -> str:
        """These settings as YAML, each under a comment that explains it; also written to `path` if given."""
        import yaml  # slow to import, and settings rarely come from files

        lines = []
        for name, value in asdict(self).items():
            lines.append(f"# {explain(name)}")
            lines.append(yaml.safe_dump({name: value}, default_flow_style=False).strip())
        text = "\n".join(lines) + "\n"
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
        return text

    def fingerprint(self) -> str:
        """Hash of every setting that can change the result (all but `threads`)."""
        import hashlib
        import json

        values = asdict(self)
        del values["threads"]
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


def explain(name: str) -> str:
    """One line on a setting: meaning, unit, range or choices, and source."""
    return setting_of(Config, name).explanation


def _combination_name(value: Any) -> Any:
    """The name of a published combination of motion models, which is 0 .. 6 there."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, int) and not isinstance(value, bool):
        if not 0 <= value < len(_PUBLISHED_COMBINATIONS):
            raise ConfigError(f"hybrid_model_combination: is {value}, expected 0..6 or a name")
        return _PUBLISHED_COMBINATIONS[value]
    return value.lower() if isinstance(value, str) else value


def _unknown_key(key: str) -> str:
    known = [*(field.name for field in fields(Config)), *_PUBLISHED_KEYS]
    return f"{key}: unknown key{nearest(key, known)}"
