"""What the tests of the networks share, PyTorch too; who imports it from here is skipped without it."""

from __future__ import annotations

import pytest

for needed in ("torch", "lightning", "torchmetrics", "kornia", "safetensors"):
    pytest.importorskip(needed, reason=f"needs {needed}: pip install 'emseg[nets]'")

import torch  # noqa: E402

from emseg.nets.losses import Batch  # noqa: E402
from emseg.nets.settings import Architecture, NetworkSettings  # noqa: E402

torch.set_num_threads(1)

SMALL = {
    "ecn": NetworkSettings(growth_rate=4, final_map_size=8, height=40),
    "edn": NetworkSettings(architecture="edn"),
    "redn": NetworkSettings(architecture="redn"),
}


def small_network(architecture: Architecture, **changes: object) -> NetworkSettings:
    """Settings of that architecture with cheap options."""
    return NetworkSettings.model_validate(SMALL[architecture].model_dump(exclude_unset=True) | changes)


def random_batch(settings: NetworkSettings, size: tuple[int, int] = (40, 52), count: int = 2) -> Batch:
    """Targets without meaning, but with every part of the truth: an object on a background."""
    generator = torch.Generator().manual_seed(7)
    h, w = size
    n, c = settings.references, settings.in_channels
    mask = torch.zeros(count, h, w, dtype=torch.long)
    mask[:, h // 4 : h // 2, w // 4 : w // 2] = 1
    images = torch.rand(count, 1 + n, c, h, w, generator=generator)
    # Something to see where the object is.
    images[:, :, 0] = 0.7 * (mask[:, None] > 0) + 0.3 * images[:, :, 0]
    K = torch.tensor([[40.0, 0, (w - 1) / 2], [0, 40, (h - 1) / 2], [0, 0, 1]]).expand(count, 3, 3)
    depth = 2 - (mask > 0).float() + torch.linspace(0, 1, w)
    poses = 0.01 * torch.randn(count, n, 6, generator=generator)
    offsets = torch.tensor([-0.5, 0.5, 1.0, 1.5])[:n].expand(count, n)
    flow = torch.randn(count, 2, h, w, generator=generator)
    return Batch(
        images[:, 0], images[:, 1:], offsets, K, mask, depth, poses, torch.ones_like(mask).bool(), flow
    )
