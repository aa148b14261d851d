"""The process that decodes an AEDAT 4 file: `python -P aedat4_worker.py FILE`, records to standard output.

One line of JSON with the sensor size, or with an error; then batches, each its count as int64 and its
records; then END, or FAILED and a line of JSON with the error.  Imports nothing of emseg, to start quickly.
"""

from __future__ import annotations

import json
import os
import struct
import sys
from typing import IO, Any, Final

import numpy as np

END: Final = -1
FAILED: Final = -2
RECORD: Final = np.dtype(
    {
        "names": ["timestamp", "x", "y", "polarity"],
        "formats": ["<i8", "<i2", "<i2", "i1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)


def _line(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer).encode() + b"\n"


def _reason(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0][:200] if lines else type(error).__name__


def _open(path: str) -> tuple[Any, dict[str, Any]]:
    import dv_processing as dv

    recording = dv.io.MonoCameraRecording(path)
    if not recording.isEventStreamAvailable():
        raise ValueError("it holds no event stream")
    width, height = recording.getEventResolution()
    streams = [name for name in recording.getStreamNames() if recording.isStreamOfEventType(name)]
    notes = [f"has {len(streams)} event streams, the first is read"] if len(streams) > 1 else []
    return recording, {"width": int(width), "height": int(height), "notes": notes}


def send(path: str, output: IO[bytes]) -> None:
    """Write the file's sensor size and records to `output`."""
    try:
        recording, header = _open(path)
    except Exception as error:  # whatever the decoder makes of a damaged file
        output.write(_line({"error": _reason(error)}))
        return
    output.write(_line(header))
    try:
        while (batch := recording.getNextEventBatch()) is not None:
            records = np.ascontiguousarray(batch.numpy(), dtype=RECORD)
            output.write(struct.pack("<q", len(records)))
            output.write(records.tobytes())
    except Exception as error:  # as above
        output.write(struct.pack("<q", FAILED))
        output.write(_line({"error": _reason(error)}))
        return
    output.write(struct.pack("<q", END))


if __name__ == "__main__":
    # The decoder may print: its standard output goes where errors go, and only records go to ours.
    own = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    with own:
        send(sys.argv[1], own)
