"""Encoder-decoder networks: DispNetS for depth, PoseExpNet for poses (Zhou et al., SfMLearner, CVPR 2017).

No normalisation, ReLU, biases.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

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
from emseg.nets.settings import NetworkSettings

__all__ = ["DispNetS", "PoseExpNet"]

KERNELS = (7, 5, 3, 3, 3, 3, 3)
DEPTH_PLANES = (32, 64, 128, 256, 512, 512, 512)
DEPTH_UP_PLANES = (512, 512, 256, 128, 64, 32, 16)
POSE_PLANES = (16, 32, 64, 128, 256, 256, 256)
POSE_UP_PLANES = (256, 128, 64, 32, 16)
PREDICTED_SCALES = 4


def _convolution(channels: int, out: int, kernel: int, *, stride: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels, out, kernel, stride=stride, padding=kernel // 2), nn.ReLU(inplace=True)
    )


def _cropped(x: Tensor, like: Tensor) -> Tensor:
    """The upper left part of x that is as large; odd sizes make decoders overshoot by a pixel."""
    return x[:, :, : like.shape[2], : like.shape[3]]


class DispNetS(nn.Module):
    """Disparity from one slice."""

    def __init__(self, settings: NetworkSettings) -> None:
        super().__init__()
        self.settings = settings
        before = (settings.in_channels, *DEPTH_PLANES)
        self.down = nn.ModuleList(
            nn.Sequential(
                _convolution(channels, out, kernel, stride=2), _convolution(out, out, kernel, stride=1)
            )
            for channels, out, kernel in zip(before, DEPTH_PLANES, KERNELS, strict=False)
        )
        self.up, self.merge, self.predict = nn.ModuleList(), nn.ModuleList(), nn.ModuleList()
        channels = DEPTH_PLANES[-1]
        for step, out in enumerate(DEPTH_UP_PLANES):
            self.up.append(
                nn.Sequential(
                    nn.ConvTranspose2d(channels, out, 3, stride=2, padding=1, output_padding=1),
                    nn.ReLU(inplace=True),
                )
            )
            skip = DEPTH_PLANES[-2 - step] if step < len(DEPTH_UP_PLANES) - 1 else 0
            coarser = int(step > len(DEPTH_UP_PLANES) - PREDICTED_SCALES)  # the disparity of the step before
            self.merge.append(_convolution(out + skip + coarser, out, 3, stride=1))
            if step >= len(DEPTH_UP_PLANES) - PREDICTED_SCALES:
                self.predict.append(nn.Conv2d(out, 1, 3, padding=1))
            channels = out
        initialise(self)

    def forward(self, target: Tensor, scales: Scales | None = None) -> list[Tensor]:
        """Disparities (b, 1, h, w), finest first; which, see :func:`kept_scales`."""
        features = [target]
        for block in self.down:
            features.append(block(features[-1]))
        x = features[-1]
        disparities: list[Tensor] = []
        unpredicted = len(DEPTH_UP_PLANES) - PREDICTED_SCALES
        for step, (up, merge) in enumerate(zip(self.up, self.merge, strict=True)):
            skip = features[-2 - step]
            parts = [_cropped(up(x), skip)]
            if step < len(DEPTH_UP_PLANES) - 1:  # the last would have the image itself
                parts.append(skip)
            if disparities:
                twice = functional.interpolate(
                    disparities[0], scale_factor=2, mode="bilinear", align_corners=False
                )
                parts.append(_cropped(twice, skip))
            x = merge(torch.cat(parts, dim=1))
            if step >= unpredicted:
                disparities.insert(0, disparity_at(self.predict[step - unpredicted](x)))
        return kept_scales(disparities, self, scales)


class PoseExpNet(nn.Module):
    """Poses and maps from a slice and its neighbours."""

    def __init__(self, settings: NetworkSettings) -> None:
        super().__init__()
        self.settings = settings
        before = (settings.in_channels * (1 + settings.references), *POSE_PLANES)
        self.down = nn.ModuleList(
            _convolution(channels, out, kernel, stride=2)
            for channels, out, kernel in zip(before, POSE_PLANES, KERNELS, strict=False)
        )
        self.pose = PoseHead(POSE_PLANES[-1], settings)
        self.up, self.predict = nn.ModuleList(), nn.ModuleList()
        predicted = map_channels(settings)
        if predicted:
            channels = POSE_PLANES[len(POSE_UP_PLANES) - 1]
            for step, out in enumerate(POSE_UP_PLANES):
                self.up.append(
                    nn.Sequential(
                        nn.ConvTranspose2d(channels, out, 4, stride=2, padding=1), nn.ReLU(inplace=True)
                    )
                )
                if step >= len(POSE_UP_PLANES) - PREDICTED_SCALES:
                    self.predict.append(nn.Conv2d(out, predicted, 3, padding=1))
                channels = out
        initialise(self)

    def forward(self, target: Tensor, references: Tensor, scales: Scales | None = None) -> PoseOutput:
        """Poses (b, n, 6) and maps, finest first; which, see :func:`kept_scales`."""
        features = [frames_stacked(target, references)]
        for block in self.down:
            features.append(block(features[-1]))
        maps: list[Tensor] = []
        x = features[len(POSE_UP_PLANES)]
        for step, up in enumerate(self.up):
            x = _cropped(up(x), features[len(POSE_UP_PLANES) - 1 - step])
            number = step - (len(POSE_UP_PLANES) - PREDICTED_SCALES)
            if number >= 0:
                maps.insert(0, map_activation(self.predict[number](x), self.settings))
        kept = kept_scales(maps, self, scales)
        poses, components = self.pose(features[-1])
        return PoseOutput(poses, components, kept)
