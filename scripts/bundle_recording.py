"""Write the events of an aedat4 recording as the .npz that ships in emseg.datasets."""

import argparse
from pathlib import Path

import dv_processing as dv
import numpy as np


def main() -> None:
    """Read all events; write x, y (uint16), t (int64, µs, as recorded), p (uint8), width and height."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="an .aedat4 file")
    parser.add_argument("npz", type=Path, help="the file to write")
    arguments = parser.parse_args()
    reader = dv.io.MonoCameraRecording(str(arguments.recording))
    width, height = reader.getEventResolution()
    batches = []
    while reader.isRunning():
        batch = reader.getNextEventBatch()
        if batch is not None:
            batches.append(batch.numpy())
    events = np.concatenate(batches)
    np.savez_compressed(
        arguments.npz,
        allow_pickle=False,
        x=events["x"].astype(np.uint16),
        y=events["y"].astype(np.uint16),
        t=events["timestamp"].astype(np.int64),
        p=events["polarity"].astype(np.uint8),
        width=np.array(width),
        height=np.array(height),
    )


if __name__ == "__main__":
    main()
