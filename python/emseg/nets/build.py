"""Network pairs from their settings."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import torch
from torch import Tensor, nn

from emseg.nets.ecn import EcnDepthNet, EcnPoseNet
from emseg.nets.edn import DispNetS, PoseExpNet
from emseg.nets.outputs import PoseOutput, Scales
from emseg.nets.redn import ResDepthNet, ResPoseNet
from emseg.nets.settings import NetworkSettings

__all__ = ["NetworkPair", "build_networks", "parameter_count"]

log = logging.getLogger(__name__)


class NetworkPair(nn.Module):
    """A network for depth and one for poses."""

    def __init__(self, settings: NetworkSettings, depth: nn.Module, pose: nn.Module) -> None:
        super().__init__()
        self.settings = settings
        self.depth = depth
        self.pose = pose

    def forward(
        self, target: Tensor, references: Tensor, scales: Scales | None = None
    ) -> tuple[list[Tensor], PoseOutput]:
        """Disparities (b, 1, h, w), finest first, and poses, from (b, c, h, w) and (b, n, c, h, w)."""
        return self.depth(target, scales), self.pose(target, references, scales)


def build_networks(
    settings: NetworkSettings, *, seed: int = 0, resnet_weights: Mapping[str, Tensor] | None = None
) -> NetworkPair:
    """The pair of that architecture with fresh weights, drawn from the seed.

    Args:
        settings: Which.
        seed: Of the weights; the state of PyTorch's own generator is left as it was.
        resnet_weights: Of ResNet18, see :func:`emseg.nets.resnet.read_weights`; for redn alone, which then
            keeps them as they are.

    Raises:
        ValueError: weights for an architecture that has no ResNet.
    """
    if resnet_weights is not None and settings.architecture != "redn":
        raise ValueError(f"weights of ResNet18 are given for {settings.architecture}, expected redn")
    for name in settings.without_effect():
        log.warning("%s has no effect on %s", name, settings.architecture)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        match settings.architecture:
            case "ecn":
                return NetworkPair(settings, EcnDepthNet(settings), EcnPoseNet(settings))
            case "edn":
                return NetworkPair(settings, DispNetS(settings), PoseExpNet(settings))
            case "redn":
                if resnet_weights is None:
                    log.warning("no weights of ResNet18 are given: redn trains from scratch, nothing frozen")
                return NetworkPair(
                    settings, ResDepthNet(settings, resnet_weights), ResPoseNet(settings, resnet_weights)
                )


def parameter_count(network: nn.Module) -> int:
    """Number of parameters, those that are kept as they are included."""
    return sum(parameter.numel() for parameter in network.parameters())
