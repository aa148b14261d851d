"""Mirroring and zooming of targets, with everything that belongs to them."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from emseg.nets.losses import Batch
from emseg.nets.settings import TrainingSettings

__all__ = ["augmented", "flipped", "zoomed"]


def augmented(item: Batch, settings: TrainingSettings) -> Batch:
    """The item mirrored by chance, and zoomed by chance; x and y by different factors, which K tells."""
    if torch.rand(()) < settings.flip:
        item = flipped(item)
    low, high = settings.zoom
    if high > 1:
        h, w = item.target.shape[1:]
        sy, sx = (low + (high - low) * torch.rand(2)).tolist()
        size = (max(h, round(h * sy)), max(w, round(w * sx)))
        top = int(torch.randint(size[0] - h + 1, ()))
        left = int(torch.randint(size[1] - w + 1, ()))
        item = zoomed(item, size, (top, left))
    return item


def flipped(item: Batch) -> Batch:
    """The mirror image, left for right, of the scene and the camera's motion through it."""
    K = item.K.clone()
    K[0, 2] = item.target.shape[2] - 1 - K[0, 2]
    flow = item.flow.flip(-1)
    return item._replace(
        target=item.target.flip(-1),
        references=item.references.flip(-1),
        K=K,
        mask=item.mask.flip(-1),
        depth=item.depth.flip(-1),
        # Rotations about y and z turn the other way.
        poses=item.poses * item.poses.new_tensor([-1, 1, 1, 1, -1, -1]),
        active=item.active.flip(-1),
        flow=torch.stack([-flow[0], flow[1]]),
    )


def zoomed(item: Batch, size: tuple[int, int], corner: tuple[int, int]) -> Batch:
    """The item enlarged to a size (h, w) and cut out from a corner (top, left) on, as large as before."""
    h, w = item.target.shape[1:]
    top, left = corner
    sy, sx = size[0] / h, size[1] / w

    def cut(images: Tensor, mode: str) -> Tensor:
        if mode == "bilinear":
            large = functional.interpolate(images, size=size, mode=mode, align_corners=False)
        else:
            large = functional.interpolate(images, size=size, mode=mode)
        return large[..., top : top + h, left : left + w]

    def cut_one(image: Tensor) -> Tensor:
        return cut(image[None, None].float(), "nearest-exact")[0, 0]

    K = item.K.clone()
    K[0] *= sx
    K[1] *= sy
    K[0, 2] += (sx - 1) / 2 - left
    K[1, 2] += (sy - 1) / 2 - top
    flow = cut(item.flow[None], "nearest-exact")[0]
    return item._replace(
        target=cut(item.target[None], "bilinear")[0],
        references=cut(item.references, "bilinear"),
        K=K,
        mask=cut_one(item.mask).long(),
        depth=cut_one(item.depth),
        active=cut_one(item.active) > 0,
        flow=flow * flow.new_tensor([sx, sy])[:, None, None],
    )
