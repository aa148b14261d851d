"""Encoder-decoder networks on a ResNet18: ResDepthNet and ResPoseNet."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from emseg.nets.outputs import (
    PoseHead,
    PoseOutput,
    Scales,
    disparity_at,
    frames_stacked,
    initialise,
    kept_scales,
    map_activation,
    map_channels,
)
from emseg.nets.resnet import ResNetTrunk
from emseg.nets.settings import NetworkSettings

__all__ = ["ResDepthNet", "ResPoseNet"]

FEATURES = 128  # of layer2
DECODER_PLANES = (64, 64, 32)
SKIP_PLANES = (64, 64, 0)  # layer1, the stem, and nothing at full size


class _Step(nn.Module):
    """Twice the size by a transposed convolution, then a convolution over it and the skip."""

    def __init__(self, channels: int, skip: int, out: int) -> None:
        super().__init__()
        self.up = nn.ConvTranspose2d(channels, out, 4, stride=2, padding=1)
        self.merge = nn.Conv2d(out + skip, out, 3, padding=1)

    def forward(self, x: Tensor, size: tuple[int, int], skip: Tensor | None) -> Tensor:
        x = torch.relu(self.up(x))[:, :, : size[0], : size[1]]
        return torch.relu(self.merge(x if skip is None else torch.cat([x, skip], dim=1)))


class _Decoder(nn.Module):
    """Predictions at 1, 1/2, 1/4 and 1/8 of the size."""

    def __init__(self, predicted: int) -> None:
        super().__init__()
        planes = (FEATURES, *DECODER_PLANES)
        self.steps = nn.ModuleList(
            _Step(channels, skip, out)
            for channels, skip, out in zip(planes, SKIP_PLANES, DECODER_PLANES, strict=False)
        )
        self.heads = nn.ModuleList(nn.Conv2d(channels, predicted, 3, padding=1) for channels in planes)

    def forward(self, image: Tensor, stem: Tensor, first: Tensor, second: Tensor) -> list[Tensor]:
        """Logits, finest first."""
        x = second
        logits = [self.heads[0](x)]
        sizes = [(each.shape[2], each.shape[3]) for each in (first, stem, image)]
        skips = (first, stem, None)
        for step, head, size, skip in zip(self.steps, self.heads[1:], sizes, skips, strict=True):
            x = step(x, size, skip)
            logits.insert(0, head(x))
        return logits


class ResDepthNet(nn.Module):
    """Disparity from one slice."""

    def __init__(self, settings: NetworkSettings, weights: Mapping[str, Tensor] | None = None) -> None:
        super().__init__()
        self.settings = settings
        self.trunk = ResNetTrunk(settings.in_channels)
        self.decoder = _Decoder(1)
        initialise(self)
        if weights is not None:
            self.trunk.load_pretrained(dict(weights), frames=1)

    def forward(self, target: Tensor, scales: Scales | None = None) -> list[Tensor]:
        """Disparities (b, 1, h, w), finest first; which, see :func:`kept_scales`."""
        logits = self.decoder(target, *self.trunk(target))
        kept = kept_scales(logits, self, scales)
        return [disparity_at(each) for each in kept]


class ResPoseNet(nn.Module):
    """Poses and maps from a slice and its neighbours."""

    def __init__(self, settings: NetworkSettings, weights: Mapping[str, Tensor] | None = None) -> None:
        super().__init__()
        self.settings = settings
        frames = 1 + settings.references
        self.trunk = ResNetTrunk(settings.in_channels * frames)
        self.pose = PoseHead(FEATURES, settings)
        predicted = map_channels(settings)
        self.decoder = _Decoder(predicted) if predicted else None
        initialise(self)
        if weights is not None:
            self.trunk.load_pretrained(dict(weights), frames=frames)

    def forward(self, target: Tensor, references: Tensor, scales: Scales | None = None) -> PoseOutput:
        """Poses (b, n, 6) and maps, finest first; which, see :func:`kept_scales`."""
        image = frames_stacked(target, references)
        features = self.trunk(image)
        logits = [] if self.decoder is None else self.decoder(image, *features)
        kept = kept_scales(logits, self, scales)
        poses, components = self.pose(features[-1])
        return PoseOutput(poses, components, [map_activation(each, self.settings) for each in kept])
