"""Networks as TorchScript, for programs that have neither emseg nor its Python code."""

from __future__ import annotations

import warnings
from os import PathLike
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from emseg.nets.build import NetworkPair
from emseg.nets.checkpoints import TrainedNetworks
from emseg.nets.outputs import depth_at

__all__ = ["Deployed", "export_torchscript"]


class Deployed(nn.Module):
    """A pair as plain tensors in and out.

    From a target (b, c, h, w) and references (b, n, c, h, w) it gives depth (b, 1, h, w), up to scale; poses
    (b, n, 6), see :class:`emseg.nets.outputs.PoseOutput`; components (b, k, 6) and maps (b, m, h, w), which
    are empty for networks without.
    """

    def __init__(self, networks: NetworkPair) -> None:
        super().__init__()
        self.networks = networks

    def forward(self, target: Tensor, references: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Evaluate."""
        disparities, output = self.networks(target, references)
        maps = output.maps[0] if output.maps else target.new_zeros(target.shape[0], 0, *target.shape[2:])
        return depth_at(disparities[0]), output.poses, output.components, maps


def export_torchscript(
    trained: TrainedNetworks, path: str | PathLike[str], *, width: int, height: int
) -> None:
    """Trace the networks for images of one size, any number at a time, and write them."""
    network = trained.settings.network
    generator = torch.Generator().manual_seed(0)
    target = torch.rand(2, network.in_channels, height, width, generator=generator)
    references = torch.rand(2, network.references, network.in_channels, height, width, generator=generator)
    target_path = Path(path)
    target_path.parent.mkdir(parents=True, exist_ok=True)
    with torch.inference_mode(), warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # sizes become constants, as is wanted; TorchScript itself is no longer new
        traced: Any = torch.jit.trace(  # type: ignore[no-untyped-call]
            Deployed(trained.networks).eval(), (target, references), check_trace=False
        )
        torch.jit.save(torch.jit.freeze(traced.eval()), str(target_path))
