"""What the networks give, and what they share."""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

import torch
from torch import Tensor, nn

from emseg.nets.settings import NetworkSettings

__all__ = [
    "PoseHead",
    "PoseOutput",
    "Scales",
    "depth_at",
    "disparity_at",
    "frames_stacked",
    "initialise",
    "kept_scales",
    "map_activation",
    "map_channels",
]

DISPARITY_RANGE = 10.0  # α
LEAST_DISPARITY = 0.01  # β
POSE_SCALE = 0.01  # poses are small

Scales = Literal["all", "finest"]


class _Network(Protocol):
    training: bool
    settings: NetworkSettings


class PoseOutput(NamedTuple):
    """What a pose network says of b targets with n references.

    A pose is (tx, ty, tz, rx, ry, rz): where the camera of the other moment stands in the target's frame.

    Attributes:
        poses: (b, n, 6), from the target to each reference; with a mixture or pixel poses (b, 1, 6): the
            camera's own motion over the width of a slice.
        components: (b, k, 6) of a mixture, over the width of a slice, the camera's first; else (b, 0, 6).
        maps: Finest first, (b, m, h, w): shares of the components, how well the pose explains each pixel,
            what is to be added to its pose, or its disparity; [] where there are none.
    """

    poses: Tensor
    components: Tensor
    maps: list[Tensor]


def kept_scales(predictions: list[Tensor], network: _Network, scales: Scales | None) -> list[Tensor]:
    """Those of the predictions, finest first, that are asked for.

    None: all that the settings want in training, the finest alone in evaluation.
    """
    usual = network.settings.scales if network.training else "finest"
    wanted = usual if scales is None else scales
    return predictions if wanted == "all" else predictions[:1]


def frames_stacked(target: Tensor, references: Tensor) -> Tensor:
    """Target and references as channels of one image, (b, (1 + n) c, h, w)."""
    return torch.cat([target, references.flatten(1, 2)], dim=1)


def disparity_at(logits: Tensor) -> Tensor:
    """Disparity α σ(p) + β, always positive."""
    return DISPARITY_RANGE * torch.sigmoid(logits) + LEAST_DISPARITY


def depth_at(disparity: Tensor) -> Tensor:
    """Depth of disparities (b, 1, h, w), scaled to a mean of 1 an image: the scale is not known anyway."""
    return disparity.mean((1, 2, 3), keepdim=True) / disparity


def map_channels(settings: NetworkSettings) -> int:
    """Channels of the pose network's maps; 0 where it has none."""
    channels = {"none": 0, "explainability": settings.references, "pixel_pose": 6, "disparity": 1}
    return settings.components if settings.maps == "mixture" else channels[settings.maps]


def map_activation(logits: Tensor, settings: NetworkSettings) -> Tensor:
    """The maps that logits (b, m, h, w) stand for."""
    match settings.maps:
        case "mixture":
            return torch.softmax(logits, dim=1)
        case "pixel_pose":
            return POSE_SCALE * logits
        case "disparity":
            return disparity_at(logits)
        case _:
            return torch.sigmoid(logits)


class PoseHead(nn.Module):
    """Poses from the deepest features: a 1×1 convolution and the mean over the map."""

    def __init__(self, channels: int, settings: NetworkSettings, *, before: nn.Module | None = None) -> None:
        super().__init__()
        self.maps = settings.maps
        counts = {"mixture": settings.components, "pixel_pose": 1}
        self.count = counts.get(settings.maps, settings.references)
        self.before = nn.Identity() if before is None else before
        self.conv = nn.Conv2d(channels, 6 * self.count, 1, bias=before is None)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Poses and components, see :class:`PoseOutput`."""
        raw = POSE_SCALE * self.conv(self.before(features)).mean((2, 3)).view(-1, self.count, 6)
        if self.maps != "mixture":
            return raw, raw[:, :0]
        ego = raw[:, :1]
        # An object differs from the camera's motion by a translation; its rotation is not told apart.
        residual = torch.cat([raw[:, 1:, :3], torch.zeros_like(raw[:, 1:, 3:])], dim=2)
        return ego, torch.cat([ego, ego + residual], dim=1)


def initialise(network: nn.Module) -> None:
    """Xavier-uniform weights of convolutions, biases zero."""
    for module in network.modules():
        if isinstance(module, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.xavier_uniform_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
