"""What networks see in a recording without truth: depth, flow and masks of every slice, in files."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

import emseg
from emseg.camera import Camera
from emseg.events import EventArray
from emseg.nets.checkpoints import TrainedNetworks
from emseg.nets.figures import Prediction
from emseg.nets.figures import predict as predict_batch
from emseg.nets.geometry import instances
from emseg.nets.losses import Batch
from emseg.nets.pictures import captioned, depth_picture, flow_picture, mask_picture, row, slice_picture
from emseg.nets.slices import as_channels, event_slices, reference_steps, shrunk_intrinsics
from emseg.writers import write_png

__all__ = ["SlicePredictor", "predict_recording"]

log = logging.getLogger(__name__)


class SlicePredictor:
    """Networks at work on a recording, one target after the other.

    Args:
        trained: The networks.
        events: The recording.
        K: Intrinsics (3, 3); they matter for flow alone.
    """

    def __init__(self, trained: TrainedNetworks, events: EventArray, K: NDArray[np.float64]) -> None:
        self.trained = trained
        self.events = events
        settings = trained.settings
        self.shrink = settings.slices.shrink(events.width, events.height)
        self._K = torch.tensor(shrunk_intrinsics(K, self.shrink), dtype=torch.float32)[None]
        steps = np.array(reference_steps(settings.network.references))
        self._steps = np.rint(1e6 * settings.slices.step * np.concatenate([[0], steps])).astype(np.int64)
        self._offsets = torch.tensor(
            steps * settings.slices.step / settings.slices.width, dtype=torch.float32
        )

    def images(self, time: int) -> NDArray[np.uint8]:
        """The target and its references at a time, µs: (1 + n, 3, h, w)."""
        return event_slices(self.events, time + self._steps, self.trained.settings.slices)

    def at(self, time: int) -> Prediction:
        """What the networks say of a time, µs."""
        planes = as_channels(self.images(time), self.trained.settings.network.in_channels)
        h, w = planes.shape[2:]
        batch = Batch(
            target=planes[:1],
            references=planes[None, 1:],
            offsets=self._offsets[None],
            K=self._K,
            mask=torch.full((1, h, w), -1),
            depth=torch.zeros(1, h, w),
            poses=torch.full((1, len(self._offsets), 6), torch.nan),
            active=planes[:1].sum(1) > 0,
            flow=torch.full((1, 2, h, w), torch.nan),
        )
        return predict_batch(self.trained.networks, batch)

    def labels(self, prediction: Prediction) -> NDArray[np.int16]:
        """Label of each pixel of the image, (h, w): 0 background, 1.. what moves.

        Raises:
            ValueError: networks that tell no masks.
        """
        if prediction.moving is None:
            raise ValueError(f"maps are {self.trained.settings.network.maps}: these networks tell no masks")
        found = instances(
            prediction.output,
            self.trained.settings.network,
            prediction.moving,
            threshold=self.trained.threshold,
        )
        return found[0].numpy().astype(np.int16)

    def on_sensor(self, image: NDArray[np.int16]) -> NDArray[np.int16]:
        """An image of labels as large as the sensor, (height, width)."""
        large = image.repeat(self.shrink, axis=0).repeat(self.shrink, axis=1)
        missing = (self.events.height - large.shape[0], self.events.width - large.shape[1])
        return np.pad(large, ((0, missing[0]), (0, missing[1])), mode="edge")


def predict_recording(
    trained: TrainedNetworks, events: EventArray, out: Path, *, camera: Camera | None, pictures: int
) -> Path:
    """Write predictions.npz, run.json and some pictures; returns the folder.

    predictions.npz holds `t` (n,) µs; `labels` int16, `moving` and `depth` (up to scale) float16, (n, h, w);
    and `flow` float16 (n, 2, h, w), px over a slice.

    Raises:
        ValueError: the recording is shorter than a slice with its references.
    """
    if camera is None:
        log.warning(
            "no calibration is given: a focal length of the sensor's width is taken; flow depends on it"
        )
        focal = float(events.width)
        K = np.array([[focal, 0, (events.width - 1) / 2], [0, focal, (events.height - 1) / 2], [0, 0, 1]])
    else:
        K = camera.K
    predictor = SlicePredictor(trained, events, K)
    slices = trained.settings.slices
    margin = round(5e5 * slices.width) + int(np.abs(predictor._steps).max())
    first, last = (int(events.t[0]), int(events.t[-1])) if len(events) else (0, 0)
    times = np.arange(first + margin, last - margin + 1, round(1e6 * slices.stride), dtype=np.int64)
    if not len(times):
        raise ValueError(
            f"the recording lasts {(last - first) / 1e6:g} s, expected {2 * margin / 1e6:g} s at least"
        )
    out.mkdir(parents=True, exist_ok=True)
    drawn = set(np.linspace(0, len(times) - 1, min(pictures, len(times))).round().astype(int).tolist())
    columns: dict[str, list[NDArray[np.generic]]] = {
        name: [] for name in ("labels", "moving", "depth", "flow")
    }
    for number, time in enumerate(times.tolist()):
        prediction = predictor.at(time)
        depth, flow = prediction.depth[0, 0].numpy(), prediction.flow[0].numpy()
        columns["depth"].append(depth.astype(np.float16))
        columns["flow"].append(flow.astype(np.float16))
        if prediction.moving is not None:
            columns["labels"].append(predictor.labels(prediction))
            columns["moving"].append(prediction.moving[0, 0].numpy().astype(np.float16))
        if number in drawn:
            panels = [
                captioned(slice_picture(predictor.images(time)[0]), f"events {time / 1e6:.3f} s"),
                captioned(depth_picture(depth), "depth"),
                captioned(flow_picture(flow), "flow, thesis"),
                captioned(flow_picture(flow, wheel="middlebury"), "flow, middlebury"),
            ]
            if prediction.moving is not None:
                panels.append(captioned(mask_picture(columns["labels"][-1]), "mask"))
            write_png(out / f"slice_{number:05d}.png", row(panels))
    filled = {name: np.stack(column) for name, column in columns.items() if column}
    np.savez_compressed(out / "predictions.npz", t=times, **filled)  # type: ignore[arg-type]
    run = {
        "version": emseg.__version__,
        "settings": trained.settings.model_dump(mode="json"),
        "threshold": trained.threshold,
        "networks": dict(trained.about),
    }
    (out / "run.json").write_text(json.dumps(run, indent=1) + "\n", encoding="utf-8")
    return out
