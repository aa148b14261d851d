"""Where live results go: JSON lines, and dv-processing network streams."""

from __future__ import annotations

import ctypes
import json
from pathlib import Path
from typing import IO, Any, Literal, Protocol

import numpy as np

from emseg.events import EventArray
from emseg.io.extras import require
from emseg.live.segmenter import LiveWindow

__all__ = ["DvStreams", "JsonLines", "Sink", "immortal"]


class Sink(Protocol):
    """Takes results as they come."""

    def write(self, window: LiveWindow) -> None:
        """Take one window's."""


class JsonLines:
    """A line of JSON a window.

    Args:
        file: An open text file.
        events: Which events it lists with their labels, as columns.
    """

    def __init__(self, file: IO[str], *, events: Literal["none", "moving", "all"] = "none") -> None:
        self._file, self._events = file, events

    def write(self, window: LiveWindow) -> None:
        """See :meth:`Sink.write`."""
        seg = window.segmentation
        values, counts = np.unique(seg.labels, return_counts=True)
        line: dict[str, Any] = {
            "window": window.number,
            "t_first_us": window.t_first,
            "t_last_us": window.t_last,
            "t_ref_us": int(seg.t_ref),
            "events": window.events,
            "labelled": len(seg.labels),
            "thinned": window.thinned,
            "skipped": window.skipped,
            "behind_ms": round(window.behind_us / 1e3, 3),
            "latency_ms": round(window.latency_s * 1e3, 3),
            "events_by_label": {str(v): int(n) for v, n in zip(values, counts, strict=True)},
            "boxes": [
                {"track": int(box["track"])}
                | {side: round(float(box[side]), 2) for side in ("x", "y", "w", "h")}
                for box in seg.boxes
            ],
            "models": [
                {"label": model.label, "kind": model.kind, "params": [float(v) for v in model.params]}
                for model in seg.models
            ],
        }
        if self._events != "none":
            chosen = seg.labels > 0 if self._events == "moving" else np.ones(len(seg.labels), bool)
            columns = {name: getattr(seg.events, name)[chosen].tolist() for name in "xytp"}
            line["labels"] = columns | {"label": seg.labels[chosen].tolist()}
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()


class DvStreams:
    """Three network streams of dv-processing, at successive ports.

    The first has the moving objects' events; the second a packet of bounding boxes a window, each labelled
    with its track and with the share of the window's events as confidence; the third every labelled event as
    a timed key point whose class_id is the label and whose response is the polarity.  Nothing is prepared for
    a stream that nobody listens to.  The streams end with the process.

    Args:
        host: Address of this machine to listen at.
        port: The first stream's port.
        size: Width and height of the sensor, px.

    Raises:
        ReadError: dv-processing is not installed.
        OSError: a port is taken.
    """

    def __init__(self, host: str, port: int, *, size: tuple[int, int]) -> None:
        self._dv: Any = require("dv_processing", "dv-processing", "publishing", Path(f"tcp://{host}:{port}"))
        dv = self._dv
        streams = (
            dv.io.Stream.EventStream(0, "events", "emseg", size),
            dv.io.Stream(0, "boxes", "emseg", dv.BoundingBoxPacket.PacketIdentifier()),
            dv.io.Stream(0, "labels", "emseg", dv.TimedKeyPointPacket.PacketIdentifier()),
        )
        for stream in streams[1:]:
            stream.setResolution(size)
        try:
            self._writers = [
                immortal(dv.io.NetworkWriter(host, port + k, stream)) for k, stream in enumerate(streams)
            ]
        except RuntimeError as error:
            problem = str(error).partition(" [")[0]
            raise OSError(f"cannot publish at {host}:{port} to {port + 2}: {problem}") from None

    def write(self, window: LiveWindow) -> None:
        """See :meth:`Sink.write`."""
        events, boxes, labels = self._writers
        seg = window.segmentation
        if events.getClientCount():
            self._write_events(events, seg.events[seg.labels > 0])
        if boxes.getClientCount():
            boxes.writeBoundingBox(self._boxes(window))
        if labels.getClientCount():
            labels.writeTimedKeyPoints(self._key_points(window))

    def _write_events(self, writer: Any, events: EventArray) -> None:
        if not len(events):
            return
        store = self._dv.EventStore()
        push = store.push_back
        columns = (events.t.tolist(), events.x.tolist(), events.y.tolist(), (events.p > 0).tolist())
        for t, x, y, p in zip(*columns, strict=True):
            push(t, x, y, p)
        writer.writeEvents(store)

    def _boxes(self, window: LiveWindow) -> Any:
        dv, seg = self._dv, window.segmentation
        vector = dv.BoundingBoxPacket.BoundingBoxVector()
        for box in seg.boxes:
            x, y, w, h = (float(box[side]) for side in ("x", "y", "w", "h"))
            share = float(np.mean(seg.labels == box["track"]))
            vector.append(dv.BoundingBox(int(seg.t_ref), x, y, x + w, y + h, share, str(box["track"])))
        return dv.BoundingBoxPacket(vector)

    def _key_points(self, window: LiveWindow) -> Any:
        dv, seg = self._dv, window.segmentation
        point = dv.TimedKeyPoint
        events = seg.events
        columns = (column.tolist() for column in (events.x, events.y, events.p, seg.labels, events.t))
        vector = dv.TimedKeyPointPacket.TimedKeyPointVector(
            [point((x, y), 1.0, -1.0, p, 0, label, t) for x, y, p, label, t in zip(*columns, strict=True)]
        )
        return dv.TimedKeyPointPacket(vector)


def immortal(writer: Any) -> Any:
    """A network writer of dv-processing's that is never freed.

    Its destructor (2.0.4) keeps the interpreter's lock while it waits for a thread that needs that lock to
    say that a client has gone, and so for ever.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(writer))
    return writer
