"""Keeping a live stream as a recording."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from emseg.io.extras import require
from emseg.io.writing import write_events
from emseg.live.sources import DvSource, LiveSource

__all__ = ["record"]


def record(source: LiveSource, path: Path) -> int:
    """Write a stream as aedat4 until it ends or is stopped; the file appears when it is complete.

    From a camera or a network stream, what comes beside the events is kept too: frames, inertial measurements
    and triggers.  A process that is killed leaves the file, readable but for its table, in a hidden folder
    beside `path`.

    Returns:
        The number of events written.

    Raises:
        ReadError: dv-processing is not installed, or the source cannot be read on.
        OSError: the file cannot be written.
    """
    if not isinstance(source, DvSource):
        return write_events(path, source.chunks(), size=source.size, form="aedat4")
    dv: Any = require("dv_processing", "dv-processing", "writing AEDAT 4", path)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        work = Path(folder, "events.aedat4")
        try:
            writer = dv.io.MonoCameraWriter(str(work), _streams(dv, source))
        except RuntimeError as error:
            raise OSError(f"{path}: {error}") from None
        count = 0
        for store in _with_the_rest(source, writer):
            writer.writeEvents(store)
            count += store.size()
        del writer  # closes the file
        os.replace(work, path)
    return count


def _streams(dv: Any, source: DvSource) -> Any:
    capture = source.capture
    config = dv.io.MonoCameraWriter.Config(capture.getCameraName())
    config.addEventStream(source.size)
    if capture.isFrameStreamAvailable() and (size := capture.getFrameResolution()) is not None:
        config.addFrameStream(size)
    if capture.isImuStreamAvailable():
        config.addImuStream()
    if capture.isTriggerStreamAvailable():
        config.addTriggerStream()
    return config


def _with_the_rest(source: DvSource, writer: Any) -> Iterator[Any]:
    """The stores of events as they come; what comes beside them is written on the way."""
    capture = source.capture
    # Asked once: the answers take time, and what waits to be read when a stream ends is lost.
    frames, imu, triggers = (
        capture.isFrameStreamAvailable(),
        capture.isImuStreamAvailable(),
        capture.isTriggerStreamAvailable(),
    )
    for store in source.stores():
        yield store
        while frames and (frame := capture.getNextFrame()) is not None:
            writer.writeFrame(frame)
        while imu and (samples := capture.getNextImuBatch()) is not None and len(samples):
            for sample in samples:
                writer.writeImu(sample)
        while triggers and (batch := capture.getNextTriggerBatch()) is not None and len(batch):
            for trigger in batch:
                writer.writeTrigger(trigger)
