"""The first half of ResNet18 (He et al., CVPR 2016) with torchvision's names, and weights from a file."""

from __future__ import annotations

import hashlib
from os import PathLike
from pathlib import Path
from typing import Self

import torch
from torch import Tensor, nn

__all__ = ["KNOWN_WEIGHTS", "ResNetTrunk", "read_weights"]

KNOWN_WEIGHTS = ("f37072fd", "5c106cde")
"""How the SHA-256 of torchvision's checkpoints of ResNet18 begin (IMAGENET1K_V1, and an earlier file)."""


class _BasicBlock(nn.Module):
    def __init__(self, channels: int, out: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, out, 3, stride=stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(out)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(out)
        self.downsample = (
            None
            if stride == 1 and channels == out
            else nn.Sequential(nn.Conv2d(channels, out, 1, stride=stride, bias=False), nn.BatchNorm2d(out))
        )

    def forward(self, x: Tensor) -> Tensor:
        shortcut = x if self.downsample is None else self.downsample(x)
        y = torch.relu(self.bn1(self.conv1(x)))
        return torch.relu(self.bn2(self.conv2(y)) + shortcut)


class ResNetTrunk(nn.Module):
    """Stem, layer1 and layer2: 64 channels at 1/2, 64 at 1/4, 128 at 1/8 of the size."""

    def __init__(self, in_channels: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(in_channels, 64, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.layer1 = nn.Sequential(_BasicBlock(64, 64, 1), _BasicBlock(64, 64, 1))
        self.layer2 = nn.Sequential(_BasicBlock(64, 128, 2), _BasicBlock(128, 128, 1))
        self.is_frozen = False

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Features of the stem, layer1 and layer2."""
        stem = torch.relu(self.bn1(self.conv1(image)))
        first = self.layer1(nn.functional.max_pool2d(stem, 3, stride=2, padding=1))
        return stem, first, self.layer2(first)

    def load_pretrained(self, weights: dict[str, Tensor], *, frames: int) -> None:
        """Take over weights for colour images, and freeze them.

        The first convolution is repeated for the frames and divided by their number; it goes on learning
        where there are several.
        """
        own = self.state_dict()
        taken = {name: weights[name] for name in own if name in weights}
        missing = sorted(set(own) - set(taken) - {"bn1.num_batches_tracked"})
        missing = [name for name in missing if not name.endswith("num_batches_tracked")]
        if missing:
            raise ValueError(f"weights lack {missing[0]}, expected those of torchvision's resnet18")
        first = taken["conv1.weight"]
        channels = self.conv1.in_channels // frames
        if channels == 1:  # a grey image is one whose three channels are alike
            first = first.sum(dim=1, keepdim=True)
        taken["conv1.weight"] = first.repeat(1, frames, 1, 1) / frames
        self.load_state_dict(own | taken)
        self.freeze(frames=frames)

    def freeze(self, *, frames: int) -> None:
        """Keep all weights but, for several frames, those of the first convolution."""
        self.is_frozen = True
        self.requires_grad_(False)
        if frames > 1:
            self.conv1.requires_grad_(True)
        self.train(self.training)

    def train(self, mode: bool = True) -> Self:
        """Training mode; statistics of a frozen trunk stay as they are."""
        super().train(mode)
        if self.is_frozen:
            for module in self.modules():
                if isinstance(module, nn.BatchNorm2d):
                    module.eval()
        return self


def read_weights(path: str | PathLike[str]) -> dict[str, Tensor]:
    """The weights in a checkpoint of torchvision's ResNet18, which the user has.

    Raises:
        ValueError: another file, by its SHA-256.
        OSError: no such file.
    """
    digest = hashlib.sha256(Path(path).read_bytes()).hexdigest()
    if not digest.startswith(KNOWN_WEIGHTS):
        raise ValueError(
            f"{path}: SHA-256 begins {digest[:8]}, expected a ResNet18 of torchvision: "
            + " or ".join(KNOWN_WEIGHTS)
        )
    weights: dict[str, Tensor] = torch.load(path, map_location="cpu", weights_only=True)
    return weights
