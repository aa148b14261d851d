"""A camera that is none: `python -m bench.live_sender` serves events to one client of dv-processing.

It prints its port, waits for the client, sends two textures that move apart at this rate, and prints how
many events it has sent in how many seconds.  The network's bytes are written here rather than by
dv-processing, which takes events one by one and would be too slow; the header is dv-processing's own.
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import struct
import time

import numpy as np
import numpy.typing as npt

from emseg.live.sinks import immortal

WIDTH, HEIGHT = 346, 260
STEP_US = 2_500  # a packet's time
CYCLE_STEPS = 80
SPEED = 300.0  # px/s
DRAIN_S = 1.0  # dv-processing's reader (2.0.4) drops what waits in it when the other end closes
EVENT = np.dtype(
    {
        "names": ["t", "x", "y", "p"],
        "formats": ["<i8", "<i2", "<i2", "u1"],
        "offsets": [0, 8, 10, 12],
        "itemsize": 16,
    }
)
# A FlatBuffer of dv-processing's EventPacket, up to the number of its events.
PACKET = bytes.fromhex("10000000 45565453 0000 0600 0800 0400 06000000 04000000")


def stream_header() -> bytes:
    """What dv-processing sends a client first, for a stream of events."""
    import dv_processing as dv

    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as free:
        port = free.getsockname()[1]
    stream = dv.io.Stream.EventStream(0, "events", "sender", (WIDTH, HEIGHT))
    immortal(dv.io.NetworkWriter("127.0.0.1", port, stream))
    with socket.create_connection(("127.0.0.1", port)) as client:
        size = client.recv(4, socket.MSG_WAITALL)
        header = size + client.recv(struct.unpack("<I", size)[0], socket.MSG_WAITALL)
    return header


def cycle(rate: float, *, seed: int = 0) -> list[npt.NDArray[np.void]]:
    """Events of successive steps: points of a background moving right, and of a square moving left."""
    rng = np.random.default_rng(seed)
    count = max(1, round(rate * STEP_US))
    points = rng.integers(0, (WIDTH, HEIGHT), (400, 2))
    square = np.array([150, 100]) + rng.integers(0, 60, (100, 2))
    steps = []
    for step in range(CYCLE_STEPS):
        events = np.zeros(count, EVENT)
        events["t"] = np.sort(rng.integers(0, STEP_US, count)) + step * STEP_US
        way = SPEED * events["t"] * 1e-6
        chosen = rng.integers(0, 500, count)
        in_square = chosen >= 400
        place = np.concatenate([points, square])[chosen]
        events["x"] = (place[:, 0] + np.where(in_square, -way, way)).astype(np.int64) % WIDTH
        events["y"] = place[:, 1]
        events["p"] = rng.integers(0, 2, count)
        steps.append(events)
    return steps


def send(client: socket.socket, steps: list[npt.NDArray[np.void]], seconds: float) -> tuple[int, float]:
    """Send steps in turn, each when it is due or as soon after as the client takes it: events and seconds."""
    count, began = 0, time.monotonic()
    for k in range(round(seconds * 1e6 / STEP_US)):
        events = steps[k % CYCLE_STEPS].copy()
        events["t"] += 1_000_000 + k // CYCLE_STEPS * CYCLE_STEPS * STEP_US
        body = PACKET + struct.pack("<I", len(events)) + events.tobytes()
        time.sleep(max(0.0, began + (k + 1) * STEP_US * 1e-6 - time.monotonic()))
        client.sendall(struct.pack("<iiI", 0, len(body) + 4, len(body)) + body)
        count += len(events)
    return count, time.monotonic() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--rate", type=float, default=1.0, help="million events a second")
    parser.add_argument("--seconds", type=float, default=5.0)
    arguments = parser.parse_args()
    header, steps = stream_header(), cycle(arguments.rate)
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as server:
        print(server.getsockname()[1], flush=True)
        client, _ = server.accept()
    with client:
        client.sendall(header)
        count, seconds = send(client, steps, arguments.seconds)
        time.sleep(DRAIN_S)
    print(count, seconds, flush=True)


if __name__ == "__main__":
    main()
