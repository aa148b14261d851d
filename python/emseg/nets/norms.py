"""Normalisations of feature maps (b, c, h, w): the four that ECN can be built with."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from emseg.nets.settings import Norm

__all__ = ["FeatureDecorrelation", "GroupNorm", "make_norm", "whiten"]

GROUPS = 16
EPSILON = 1e-5
NEWTON_STEPS = 10


class GroupNorm(nn.Module):
    """Zero mean and unit variance of each of 16 groups of neighbouring channels, then scale and shift.

    Unlike torch.nn.GroupNorm it takes any number of channels, and variances are unbiased.  Fewer channels
    than groups make a group each: instance normalisation.
    """

    membership: Tensor

    def __init__(self, channels: int, groups: int = GROUPS) -> None:
        super().__init__()
        groups = min(groups, channels)
        of_channel = torch.arange(channels) * groups // channels
        self.register_buffer(
            "membership", nn.functional.one_hot(of_channel, groups).float(), persistent=False
        )
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (b, c, h, w)."""
        pixels = x.shape[2] * x.shape[3]
        with torch.autocast(x.device.type, enabled=False):  # sums lose too much in half precision
            x = x.to(self.membership.dtype)
            counts = self.membership.sum(0) * pixels
            mean = x.mean((2, 3)) @ self.membership * pixels / counts
            centred = x - (mean @ self.membership.T)[..., None, None]
            squares = centred.square().sum((2, 3)) @ self.membership
            variance = squares / (counts - 1).clamp(min=1)  # a single value has none
            scale = (variance + EPSILON).rsqrt() @ self.membership.T * self.weight
            return centred * scale[..., None, None] + self.bias[:, None, None]


class FeatureDecorrelation(nn.Module):
    """ZCA whitening of 16 super-channels, sample by sample, then scale and shift.

    Channel c belongs to super-channel c mod 16.  After Ye et al., "Network Deconvolution", ICLR 2020, and
    "Evenly Cascaded Convolutional Networks", arXiv 1807.00456.
    """

    def __init__(self, channels: int, groups: int = GROUPS) -> None:
        super().__init__()
        self.groups = min(groups, channels)
        self.weight = nn.Parameter(torch.ones(channels))
        self.bias = nn.Parameter(torch.zeros(channels))

    def forward(self, x: Tensor) -> Tensor:
        """Whiten (b, c, h, w)."""
        b, c, h, w = x.shape
        layers = -(-c // self.groups)
        missing = layers * self.groups - c  # the last layer's, which stay zero
        with torch.autocast(x.device.type, enabled=False):  # covariances, too
            present = x.new_ones(c, dtype=torch.float32)
            members = nn.functional.pad(present, (0, missing)).view(layers, self.groups).sum(0)
            padded = nn.functional.pad(x.float(), (0, 0, 0, 0, 0, missing)).view(
                b, layers, self.groups, h * w
            )
            mean = padded.sum((1, 3)) / (members * (h * w))
            centred = padded - mean[:, None, :, None]
            if missing:
                centred = centred * nn.functional.pad(present, (0, missing)).view(layers, self.groups, 1)
            rows = centred.transpose(1, 2).reshape(b, self.groups, layers * h * w)
            white = whiten(rows).view(b, self.groups, layers, h * w).transpose(1, 2)
            result = white.reshape(b, layers * self.groups, h, w)[:, :c]
            return result * self.weight[:, None, None] + self.bias[:, None, None]


def whiten(rows: Tensor) -> Tensor:
    """Rows of zero mean (b, g, n) with the identity as their covariance: Σ^-1/2 X, Σ = X Xᵀ / n + ε I."""
    groups, n = rows.shape[1:]
    identity = torch.eye(groups, device=rows.device, dtype=rows.dtype)
    covariance = rows @ rows.transpose(1, 2) / n + EPSILON * identity
    return _inverse_square_root(covariance, identity) @ rows


def _inverse_square_root(matrix: Tensor, identity: Tensor) -> Tensor:
    """Σ^-1/2 of positive definite matrices (b, g, g) by Newton and Schulz's coupled iteration."""
    norm: Tensor = torch.linalg.matrix_norm(matrix)[:, None, None]  # bounds the eigenvalues: it converges
    y, z = matrix / norm, identity.expand_as(matrix)
    for _ in range(NEWTON_STEPS):
        step = 1.5 * identity - 0.5 * z @ y
        y, z = y @ step, step @ z
    root: Tensor = z / norm.sqrt()
    return root


def make_norm(kind: Norm, channels: int) -> nn.Module:
    """The normalisation of that kind for maps of so many channels; each has a scale and a shift a channel."""
    match kind:
        case "batch":
            return nn.BatchNorm2d(channels)
        case "instance":
            return GroupNorm(channels, groups=channels)
        case "group":
            return GroupNorm(channels)
        case "decorrelation":
            return FeatureDecorrelation(channels)
