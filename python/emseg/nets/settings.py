"""Settings of networks, losses, slices and training: frozen, typed, YAML both ways; no PyTorch is needed.

Defaults without another source are those of EV-IMO (Mitrokhin et al., IROS 2019) as its code has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from emseg.simulation.motion import Description
from emseg.yaml_files import ConfigError, nearest, read_yaml

__all__ = [
    "Architecture",
    "LossSettings",
    "NetworkSettings",
    "Norm",
    "PoseMaps",
    "RunSettings",
    "SliceSettings",
    "TrainingSettings",
]

Architecture = Literal["ecn", "edn", "redn"]
Norm = Literal["batch", "instance", "group", "decorrelation"]
PoseMaps = Literal["none", "explainability", "pixel_pose", "mixture", "disparity"]

Weight = Annotated[float, Field(ge=0, le=1e6)]
Count = Annotated[int, Field(ge=1, le=1_000_000)]


class NetworkSettings(Description):
    """A pair of networks, for depth and for pose.

    Attributes:
        architecture: ecn: evenly cascaded; edn: DispNetS and PoseExpNet; redn: on a ResNet18.
        in_channels: 3: positive count, mean time, negative count; 1: count of all events.
        references: Slices beside the target that the pose network sees.
        height: Of the images trained on, px: it decides how many levels ECN has; any size can be given later.
        growth_rate: Channels that ECN adds a level; no effect on the others.
        init_planes: Channels of ECN's stem; None: growth_rate.
        final_map_size: ECN adds levels while maps stay this high, px; no effect on the others.
        scale_factor: Of ECN's maps from level to level.
        norm: Of ECN; the others have none, or their ResNet's.
        maps: What the pose network tells of every pixel: nothing; how well one motion explains it; a pose;
            its share in each of some motions; its disparity.
        components: Motions of a mixture; the first is the camera's.
        scales: Predictions in training at all scales of the decoder, or the finest alone.
    """

    architecture: Architecture = "ecn"
    in_channels: Literal[1, 3] = 3
    references: Annotated[int, Field(ge=1, le=8)] = 2
    height: Annotated[int, Field(ge=8, le=8192)] = 260
    growth_rate: Annotated[int, Field(ge=1, le=512)] = 8
    init_planes: Annotated[int, Field(ge=1, le=512)] | None = None
    final_map_size: Annotated[int, Field(ge=1, le=512)] = 8
    scale_factor: Annotated[float, Field(ge=0.25, le=0.9)] = 0.5
    norm: Norm = "group"
    maps: PoseMaps = "mixture"
    components: Annotated[int, Field(ge=2, le=16)] = 4
    scales: Literal["all", "finest"] = "all"

    def without_effect(self) -> list[str]:
        """Settings that were given and that this architecture does not heed."""
        if self.architecture == "ecn":
            return []
        unheeded = ("growth_rate", "init_planes", "final_map_size", "scale_factor", "norm")
        return [name for name in unheeded if name in self.model_fields_set]


class SliceSettings(Description):
    """How recordings become images.

    Attributes:
        width: Of a slice, s, centred on its time.
        step: From slice to slice, s: references lie this far apart.
        stride: From target to target, s.
        longest: Longer side that images may have, px: larger sensors are shrunk by a whole factor.
    """

    width: Annotated[float, Field(gt=0, le=10)] = 0.05
    step: Annotated[float, Field(gt=0, le=10)] = 0.025
    stride: Annotated[float, Field(gt=0, le=10)] = 0.025
    longest: Annotated[int, Field(ge=16, le=8192)] = 346

    def shrink(self, width: int, height: int) -> int:
        """Pixels of a sensor of that size that make one of the image, each way."""
        return -(-max(width, height) // self.longest)


class LossSettings(Description):
    """Weights and forms of the losses.

    "corrected" is what emseg recommends, "thesis" what the thesis has literally: docs/networks.md has both.

    Attributes:
        photometric, mask, smoothness, pose, depth: Weights of the five parts.
        ssim: Weight of the structural similarity inside the photometric part.
        photometric_form: corrected: L1 + ssim (1 - SSIM); thesis: L1 + ssim SSIM.
        mask_form: corrected: cross entropy of the background's share; thesis: its L1 distance.
        smoothness_form: corrected: second derivatives of depth; thesis: gradient over its p-norm.
        smoothness_norm: The p of that norm.
        pose_form: corrected: even within background and objects; thesis: L2 distance to a true pose.
        padding: What lies beyond an image that is warped.
    """

    photometric: Weight = 1.0
    mask: Weight = 1.0
    smoothness: Weight = 1.0
    pose: Weight = 1.0
    depth: Weight = 0.5
    ssim: Weight = 0.0
    photometric_form: Literal["corrected", "thesis"] = "corrected"
    mask_form: Literal["corrected", "thesis"] = "corrected"
    smoothness_form: Literal["corrected", "thesis"] = "corrected"
    smoothness_norm: Annotated[float, Field(ge=1, le=16)] = 2.0
    pose_form: Literal["corrected", "thesis"] = "corrected"
    padding: Literal["zeros", "border"] = "zeros"


class TrainingSettings(Description):
    """How to train.

    Attributes:
        learning_rate: Of Adam, at the start; it falls as a cosine to zero.
        epochs: Passes over the training targets.
        batch_size: Targets a step.
        patience: Epochs without a better validation loss after which training stops; None: never.
        flip: Share of targets that are mirrored.
        zoom: Range of the zoom, drawn for x and y each.
        seed: Of weights, order and augmentation.
        precision: auto: bfloat16 where there is CUDA, else float32.
    """

    learning_rate: Annotated[float, Field(gt=0, le=1)] = 1e-3
    epochs: Count = 30
    batch_size: Count = 32
    patience: Count | None = None
    flip: Annotated[float, Field(ge=0, le=1)] = 0.5
    zoom: Annotated[tuple[float, float], Field(strict=False)] = (1.1, 1.35)
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    precision: Literal["auto", "float32", "bfloat16"] = "auto"

    @model_validator(mode="after")
    def _zoom_rises(self) -> Self:
        if not 1 <= self.zoom[0] <= self.zoom[1] <= 4:
            raise ValueError(f"zoom is {list(self.zoom)}, expected 1 ≤ low ≤ high ≤ 4")
        return self


class RunSettings(Description):
    """All that a training run is made of."""

    network: NetworkSettings = NetworkSettings()
    slices: SliceSettings = SliceSettings()
    loss: LossSettings = LossSettings()
    training: TrainingSettings = TrainingSettings()

    @classmethod
    def from_yaml(cls, path: str | PathLike[str]) -> Self:
        """Read settings.

        Raises:
            ConfigError: names file, key and expectation.
        """
        return cls.from_mapping(read_yaml(path), str(path))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], place: str) -> Self:
        """Check settings that came from `place`, which errors name.

        Raises:
            ConfigError: names place, key and expectation.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"]))
            if first["type"] == "extra_forbidden":
                hint = nearest(str(first["loc"][-1]), _names())
                raise ConfigError(f"{place}: {key}: unknown setting{hint}") from None
            raise ConfigError(f"{place}: {key}: {first['msg']}, found {first['input']!r}") from None

    def to_yaml(self) -> str:
        """The settings as YAML, all of them."""
        import yaml

        text: str = yaml.safe_dump(self.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
        return text


def _names() -> list[str]:
    parts = (NetworkSettings, SliceSettings, LossSettings, TrainingSettings)
    return [*RunSettings.model_fields, *(name for part in parts for name in part.model_fields)]
