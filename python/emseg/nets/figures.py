"""Figures of merit over many targets: masks at every threshold, depth, flow."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torchmetrics import MeanMetric
from torchmetrics.classification import BinaryPrecisionRecallCurve

from emseg.nets.build import NetworkPair
from emseg.nets.geometry import ego_pose, instantaneous_flow, moving_probability, pixel_pose
from emseg.nets.losses import UNKNOWN, Batch
from emseg.nets.outputs import PoseOutput, depth_at

__all__ = [
    "THRESHOLDS",
    "DepthFigures",
    "FlowFigures",
    "MaskFigures",
    "Prediction",
    "ValidationFigures",
    "predict",
]

THRESHOLDS = torch.linspace(0.02, 0.98, 49)
"""Of the probability that a pixel moves."""

OUTLIER = (3.0, 0.05)  # 3PE: px, and share of the true flow


class Prediction:
    """What a pair says of a batch, at full size.

    Attributes:
        depth: Up to scale, (b, 1, h, w).
        moving: Probability, (b, 1, h, w); None where the network tells none.
        flow: Of all that is seen, over the width of a slice, px, (b, 2, h, w).
        ego_flow: The same by the camera's motion alone.
        output: Of the pose network.
    """

    def __init__(
        self, networks: NetworkPair, disparities: list[Tensor], output: PoseOutput, batch: Batch
    ) -> None:
        settings = networks.settings
        self.output = output
        self.depth = depth_at(disparities[0].float())
        has_masks = settings.maps in ("mixture", "explainability", "pixel_pose")
        self.moving = moving_probability(output, settings, self.depth, batch.K).float() if has_masks else None
        ego = ego_pose(output, settings, batch.offsets).float()
        self.ego_flow = instantaneous_flow(self.depth, ego, batch.K)
        has_poses = settings.maps in ("mixture", "pixel_pose")
        self.flow = (
            instantaneous_flow(self.depth, pixel_pose(output, settings).float(), batch.K)
            if has_poses
            else self.ego_flow
        )


def predict(networks: NetworkPair, batch: Batch) -> Prediction:
    """Evaluate the networks, which must be in evaluation mode, without gradients."""
    with torch.inference_mode():
        disparities, output = networks(batch.target, batch.references)
        return Prediction(networks, disparities, output, batch)


class MaskFigures(nn.Module):
    """IoU, Dice and pixel accuracy of moving masks at the pixels with events, over all targets together."""

    def __init__(self) -> None:
        super().__init__()
        self.counts = BinaryPrecisionRecallCurve(thresholds=THRESHOLDS, ignore_index=UNKNOWN)

    def update(self, moving: Tensor, batch: Batch) -> None:
        """Take in probabilities (b, 1, h, w)."""
        known = batch.active & (batch.mask != UNKNOWN)
        self.counts.update(moving[:, 0], torch.where(known, (batch.mask > 0).long(), UNKNOWN))

    def compute(self, threshold: float | None = None) -> dict[str, Tensor]:
        """The figures at the threshold nearest to one that is given, else at that of the best IoU."""
        matrix = self.counts.confmat.double()  # (thresholds, truth, prediction)
        hit, false, missed = matrix[:, 1, 1], matrix[:, 0, 1], matrix[:, 1, 0]
        iou = hit / (hit + false + missed).clamp(min=1)
        best = int(iou.argmax() if threshold is None else (THRESHOLDS - threshold).abs().argmin())
        all_moving = matrix[0, 1].sum() / matrix[0].sum().clamp(min=1)
        return {
            "iou": iou[best],
            "dice": (2 * hit / (2 * hit + false + missed).clamp(min=1))[best],
            "accuracy": ((hit + matrix[:, 0, 0]) / matrix.sum((1, 2)).clamp(min=1))[best],
            "threshold": THRESHOLDS[best].double(),
            "iou_all_moving": all_moving,  # what calling every pixel moving would have
        }

    def reset(self) -> None:
        """Forget all."""
        self.counts.reset()


class DepthFigures(nn.Module):
    """Depth at pixels where it is known, scaled to the true mean of each image; 0.1 to 7 m count."""

    NAMES = ("abs_rel", "rmse", "delta_1", "delta_2", "delta_3")

    def __init__(self) -> None:
        super().__init__()
        self.means = nn.ModuleDict({name: MeanMetric() for name in self.NAMES})

    def _mean(self, name: str) -> MeanMetric:
        mean = self.means[name]
        assert isinstance(mean, MeanMetric)
        return mean

    def update(self, depth: Tensor, batch: Batch) -> None:
        """Take in depths (b, 1, h, w)."""
        for d, true in zip(depth[:, 0], batch.depth, strict=True):
            counted = (true > 0.1) & (true < 7)
            if not bool(counted.any()):
                continue
            d, true = d[counted], true[counted]
            d = d * true.mean() / d.mean()
            ratio = torch.maximum(d / true, true / d)
            self._mean("abs_rel").update(((d - true).abs() / true).mean())
            self._mean("rmse").update((d - true).square().mean().sqrt())
            for power in (1, 2, 3):
                self._mean(f"delta_{power}").update((ratio < 1.25**power).float().mean())

    def compute(self) -> dict[str, Tensor]:
        """Means over images; empty where depth was never known."""
        if not self._mean("rmse").weight:
            return {}
        return {name: self._mean(name).compute() for name in self.NAMES}

    def reset(self) -> None:
        """Forget all."""
        for name in self.NAMES:
            self._mean(name).reset()


class FlowFigures(nn.Module):
    """End-point error, px over the width of a slice, at the pixels with events where flow is known."""

    def __init__(self) -> None:
        super().__init__()
        self.error, self.outliers = MeanMetric(), MeanMetric()

    def update(self, flow: Tensor, batch: Batch) -> None:
        """Take in flows (b, 2, h, w)."""
        counted = batch.active & torch.isfinite(batch.flow).all(1)
        if bool(counted.any()):
            true = batch.flow.permute(0, 2, 3, 1)[counted]
            error = (flow.permute(0, 2, 3, 1)[counted] - true).square().sum(1).sqrt()
            self.error.update(error)
            wrong = (error > OUTLIER[0]) & (error > OUTLIER[1] * true.square().sum(1).sqrt())
            self.outliers.update(wrong.float())

    def compute(self) -> dict[str, Tensor]:
        """Means over pixels; empty where flow was never known."""
        if not self.error.weight:
            return {}
        return {"epe": self.error.compute(), "3pe": 100 * self.outliers.compute()}

    def reset(self) -> None:
        """Forget all."""
        self.error.reset()
        self.outliers.reset()


class ValidationFigures(nn.Module):
    """All of them."""

    def __init__(self) -> None:
        super().__init__()
        self.mask, self.depth, self.flow = MaskFigures(), DepthFigures(), FlowFigures()
        self.has_masks = False

    def update(self, prediction: Prediction, batch: Batch) -> None:
        """Take in what was predicted of a batch."""
        if prediction.moving is not None:
            self.has_masks = True
            self.mask.update(prediction.moving, batch)
        self.depth.update(prediction.depth, batch)
        self.flow.update(prediction.flow, batch)

    def compute(self, threshold: float | None = None) -> dict[str, float]:
        """The figures by name; a threshold that is not given is chosen for the best IoU."""
        masks = {f"mask/{name}": float(value) for name, value in self.mask.compute(threshold).items()}
        depth = {f"depth/{name}": float(value) for name, value in self.depth.compute().items()}
        flow = {f"flow/{name}": float(value) for name, value in self.flow.compute().items()}
        return {**(masks if self.has_masks else {}), **depth, **flow}

    def reset(self) -> None:
        """Forget all."""
        for each in (self.mask, self.depth, self.flow):
            each.reset()
        self.has_masks = False
