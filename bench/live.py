"""How `emseg live` keeps up with a network stream on loopback: `python -m bench.live [MEV_S...]`.

The sender is a process of its own on the same machine, so it takes its share of it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from bench.common import ROOT
from emseg.live import LiveFigures, LiveSegmenter, open_source

RATES = (0.2, 1.0, 3.0, 10.0)  # million events a second


def measure(rate: float, seconds: float) -> tuple[LiveFigures, int, float]:
    """What became of a stream; how many events were sent, in how many seconds."""
    command = [sys.executable, "-m", "bench.live_sender", "--rate", str(rate), "--seconds", str(seconds)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as sender:
        assert sender.stdout is not None
        port = int(sender.stdout.readline())
        segmenter = LiveSegmenter(open_source(f"tcp://127.0.0.1:{port}"))
        for _ in segmenter.run():
            pass
        sent, lasted = sender.stdout.readline().split()
    return segmenter.figures, int(sent), float(lasted)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("rates", nargs="*", type=float, metavar="MEV_S", default=list(RATES))
    parser.add_argument("--seconds", type=float, default=10.0)
    arguments = parser.parse_args()
    titles = ("asked", "sent", "labelled", "thinned", "skipped", "windows", "p50 ms", "p95 ms")
    print("".join(f"{title:>10}" for title in titles))
    for rate in arguments.rates:
        figures, sent, seconds = measure(rate, arguments.seconds)
        assert figures.received == sent == figures.labelled + figures.thinned + figures.skipped
        shares = (figures.labelled / sent, figures.thinned / sent, figures.skipped / sent)
        print(
            f"{rate:10.1f}{sent / seconds / 1e6:10.2f}{shares[0]:10.1%}{shares[1]:10.1%}{shares[2]:10.1%}"
            f"{figures.windows:10}{1e3 * figures.latency_s(0.5):10.0f}{1e3 * figures.latency_s(0.95):10.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
