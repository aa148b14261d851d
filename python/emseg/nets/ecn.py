"""Evenly Cascaded Networks: depth and pose from event slices (Ye et al., arXiv 1809.08625).

Features are scaled by the same factor from level to level.  A level adds its input to the first of its
output's channels and appends `growth_rate` new ones; the decoder takes as many away.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from emseg.nets.norms import make_norm
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
from emseg.nets.settings import NetworkSettings, Norm

__all__ = ["EcnDepthNet", "EcnPoseNet", "encoder_levels"]


def encoder_levels(settings: NetworkSettings) -> int:
    """Levels below the stem: as many as keep the maps final_map_size high."""
    size, levels = settings.height // 2, 0
    while math.floor(size * settings.scale_factor) >= settings.final_map_size:
        size = math.floor(size * settings.scale_factor)
        levels += 1
    return levels


def _cascade(x: Tensor, y: Tensor) -> Tensor:
    """The output y with the input x added to the channels that both have."""
    shared = min(x.shape[1], y.shape[1])
    return torch.cat([y[:, :shared] + x[:, :shared], y[:, shared:]], dim=1)


def _resized(x: Tensor, like: Tensor) -> Tensor:
    return functional.interpolate(x, size=like.shape[2:], mode="bilinear", align_corners=False)


def _pre_activated(channels: int, out: int, norm: Norm) -> nn.Sequential:
    return nn.Sequential(
        make_norm(norm, channels), nn.ReLU(), nn.Conv2d(channels, out, 3, padding=1, bias=False)
    )


class _EncoderLevel(nn.Module):
    def __init__(self, channels: int, growth: int, norm: Norm) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(
            _pre_activated(channels, channels + growth, norm),
            _pre_activated(channels + growth, channels + growth, norm),
        )

    def forward(self, x: Tensor) -> Tensor:
        return _cascade(x, self.convolutions(x))


class _DecoderLevel(nn.Module):
    """Up to the skip's size, `out` channels wide, with a prediction of `predicted` channels."""

    def __init__(self, channels: int, skip: int, out: int, predicted: int, norm: Norm) -> None:
        super().__init__()
        self.narrow = _pre_activated(channels, out, norm)
        self.merge = _pre_activated(out + skip, out, norm)
        self.head = nn.Sequential(_pre_activated(out, predicted, norm), make_norm(norm, predicted))

    def forward(self, x: Tensor, skip: Tensor, coarser: Tensor | None) -> tuple[Tensor, Tensor]:
        x = _resized(x, skip)
        x = _cascade(x, self.narrow(x))
        both = torch.cat([x, skip], dim=1)
        x = _cascade(both, self.merge(both))
        prediction = self.head(x)
        if coarser is not None:
            prediction = prediction + _resized(coarser, skip)
        return _cascade(prediction, x), prediction


class _Cascade(nn.Module):
    """Encoder, and a decoder that predicts `predicted` channels at every scale; without any, no decoder."""

    def __init__(
        self, in_channels: int, init_planes: int, growth: int, predicted: int, settings: NetworkSettings
    ) -> None:
        super().__init__()
        self.scale_factor = settings.scale_factor
        norm = settings.norm
        levels = encoder_levels(settings)
        planes = [init_planes + growth * level for level in range(levels + 1)]
        self.stem = nn.Conv2d(in_channels, init_planes, 3, stride=2, padding=1, bias=False)
        self.encoder = nn.ModuleList(_EncoderLevel(channels, growth, norm) for channels in planes[:-1])
        self.bottom = planes[-1]
        self.decoder = nn.ModuleList()
        channels = planes[-1]
        for skip in [*planes[-2::-1], in_channels] if predicted else []:
            out = max(skip, predicted)  # predictions are added to the features, which must be as many
            self.decoder.append(_DecoderLevel(channels, skip, out, predicted, norm))
            channels = out

    def forward(self, image: Tensor) -> tuple[Tensor, list[Tensor]]:
        """The deepest features, and predictions, finest first."""
        skips, x = [image], self.stem(image)
        for level in self.encoder:
            skips.append(x)
            x = level(x)
            h, w = (max(1, math.floor(side * self.scale_factor)) for side in x.shape[2:])
            x = functional.adaptive_avg_pool2d(x, (h, w))
        bottom = x
        predictions: list[Tensor] = []
        prediction = None
        for level, skip in zip(self.decoder, reversed(skips), strict=bool(self.decoder)):
            x, prediction = level(x, skip, prediction)
            predictions.insert(0, prediction)
        return bottom, predictions


class EcnDepthNet(nn.Module):
    """Disparity from one slice."""

    def __init__(self, settings: NetworkSettings) -> None:
        super().__init__()
        self.settings = settings
        planes = settings.init_planes or settings.growth_rate
        self.cascade = _Cascade(settings.in_channels, planes, settings.growth_rate, 1, settings)
        initialise(self)

    def forward(self, target: Tensor, scales: Scales | None = None) -> list[Tensor]:
        """Disparities (b, 1, h, w), finest first; which, see :func:`kept_scales`."""
        _, logits = self.cascade(target)
        kept = kept_scales(logits, self, scales)
        return [disparity_at(each) for each in kept]


class EcnPoseNet(nn.Module):
    """Poses and maps from a slice and its neighbours; half as wide as the depth network."""

    def __init__(self, settings: NetworkSettings) -> None:
        super().__init__()
        self.settings = settings
        growth = max(1, settings.growth_rate // 2)
        planes = max(1, (settings.init_planes or settings.growth_rate) // 2)
        channels = settings.in_channels * (1 + settings.references)
        self.cascade = _Cascade(channels, planes, growth, map_channels(settings), settings)
        bottom = self.cascade.bottom
        self.pose = PoseHead(
            bottom, settings, before=nn.Sequential(make_norm(settings.norm, bottom), nn.ReLU())
        )
        initialise(self)

    def forward(self, target: Tensor, references: Tensor, scales: Scales | None = None) -> PoseOutput:
        """Poses (b, n, 6) and maps, finest first; which, see :func:`kept_scales`."""
        bottom, logits = self.cascade(frames_stacked(target, references))
        kept = kept_scales(logits, self, scales)
        poses, components = self.pose(bottom)
        return PoseOutput(poses, components, [map_activation(each, self.settings) for each in kept])
