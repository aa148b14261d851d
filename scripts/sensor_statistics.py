"""Hold the simulated sensor against real recordings: writes docs/sensor_statistics.png and prints a table.

Needs ../shared/data/real beside the repository, and matplotlib.

    python scripts/sensor_statistics.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import emseg
from emseg.datasets import bundled
from emseg.events import EventArray
from emseg.simulation import Scene

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / "shared" / "data" / "real"
SLIDER_SPAN_US = (1_000_000, 2_000_000)

# A DAVIS240C as its recordings look: more falls than rises, pixels that rest for some 2.5 ms.
DAVIS = {
    "threshold_on": 0.36,
    "threshold_off": 0.30,
    "threshold_sigma": 0.035,
    "refractory": 2.2e-3,
    "cutoff": 150.0,
    "leak": 0.1,
    "hot_fraction": 2e-4,
    "latency_jitter": 5e-6,
}

# What differs in the recording of cars, of a DAVIS346 in daylight: hardly any noise, more bandwidth.
CARS = {
    "threshold_on": 0.3,
    "threshold_off": 0.32,
    "shot_noise": 0.01,
    "leak": 0.0,
    "refractory": 1e-3,
    "cutoff": 400.0,
    "hot_fraction": 0.0,
}


def slider() -> Scene:
    """A camera slides past things that stand at several depths, as in the recording slider_depth."""
    bodies: list[dict[str, Any]] = [
        {
            "shape": {"kind": "rectangle", "size": [9, 9]},
            "motion": {"position": [0, 0, 1.6]},
            "texture": {"kind": "blocks", "grain": 0.12, "density": 0.8, "low": 0.1},
        }
    ]
    for k, (x, y, z) in enumerate([(-0.5, 0.1, 1.1), (0.1, -0.15, 0.9), (0.5, 0.2, 1.3), (-0.1, 0.3, 0.7)]):
        bodies.append(
            {
                "shape": {"kind": "box", "size": [0.25, 0.3, 0.15]},
                "motion": {"position": [x, y, z], "rotation": [0, 20 * k, 0]},
                "texture": {"kind": ["leaves", "blocks"][k % 2], "grain": 0.05, "low": 0.08},
            }
        )
    return Scene.from_mapping(
        {
            "name": "slider",
            "duration": 1.0,
            "camera": {
                "width": 240,
                "height": 180,
                "fx": 199.0,
                "motion": {
                    "position": [-0.15, 0, 0],
                    "velocity": [0.3, 0, 0],
                    "shake": {"translation": 5e-4},
                },
            },
            "sensor": DAVIS | {"shot_noise": 0.4},
            "bodies": bodies,
        }
    )


def cars() -> Scene:
    """A still camera above a road on which boxes drive, as in the bundled recording of cars."""
    drive = [(-7.0, -1.6, 7.0), (7.5, 1.4, -9.0), (0.0, -1.2, 8.5)]
    bodies: list[dict[str, Any]] = [
        {
            "shape": {"kind": "rectangle", "size": [90, 90]},
            "motion": {"position": [0, 0, 26]},
            "texture": {"kind": "clouds", "grain": 1.0},
        }
    ]
    for x, y, speed in drive:
        bodies.append(
            {
                "shape": {"kind": "box", "size": [3.0, 1.2, 1.0]},
                "motion": {
                    "position": [x, y, 25],
                    "velocity": [speed, 0, 0],
                    "acceleration": [-speed / 3, 0, 0],
                },
                "texture": {"kind": "blocks", "grain": 0.6, "density": 0.7, "low": 0.08},
            }
        )
    return Scene.from_mapping(
        {
            "name": "cars",
            "duration": 2.0,
            "camera": {"width": 346, "height": 260, "fx": 320.0},
            "sensor": DAVIS | CARS,
            "bodies": bodies,
        }
    )


def intervals_ms(events: EventArray) -> NDArray[np.float64]:
    """Times between successive events of a pixel, ms."""
    pixel = events.y.astype(np.int64) * events.width + events.x
    order = np.lexsort((events.t, pixel))
    return np.diff(events.t[order])[np.diff(pixel[order]) == 0] / 1e3


def rates_hz(events: EventArray) -> NDArray[np.float64]:
    """Events a second of every pixel, sorted from the busiest on."""
    pixel = events.y.astype(np.int64) * events.width + events.x
    counts = np.bincount(pixel, minlength=events.width * events.height)
    return np.sort(counts)[::-1] / (events.duration / 1e6)


def lonely_rate_hz(events: EventArray, reach_us: int = 10_000) -> float:
    """Events a second and pixel with no other within 3x3 pixels and 10 ms: noise, mostly."""
    last = np.full((events.height + 2, events.width + 2), -(10**12), np.int64)
    follows = np.zeros(len(events), bool)
    newest = np.full((events.height + 2, events.width + 2), -1, np.int64)
    accompanied = np.zeros(len(events), bool)
    for k, (x, y, t) in enumerate(zip(events.x.tolist(), events.y.tolist(), events.t.tolist(), strict=True)):
        near = last[y : y + 3, x : x + 3] >= t - reach_us
        if near.any():
            follows[k] = True
            accompanied[newest[y : y + 3, x : x + 3][near]] = True
        last[y + 1, x + 1], newest[y + 1, x + 1] = t, k
    lonely = np.sum(~follows & ~accompanied)
    return float(lonely / (events.width * events.height) / (events.duration / 1e6))


def row(name: str, events: EventArray) -> str:
    """A line of the table."""
    low, middle, high = np.percentile(intervals_ms(events), [5, 50, 95])
    rate = len(events) / (events.duration / 1e6)
    pixels = events.width * events.height
    return (
        f"| {name} | {rate / 1e6:.3f} | {rate / pixels:.2f} | {100 * events.p.mean():.0f} | {low:.1f} | "
        f"{middle:.1f} | {high:.0f} | {lonely_rate_hz(events):.3f} |"
    )


def main() -> None:
    """Simulate, compare, draw."""
    if not REAL.exists():
        sys.exit(f"no recordings at {REAL}")
    from matplotlib import pyplot

    start, stop = SLIDER_SPAN_US
    slid = emseg.read(REAL / "slider_depth" / "slider_depth.npz")
    pairs = {
        "slider_depth": (slid.between(start, stop), emseg.simulate(slider(), truth="poses").events),
        "cars": (emseg.read(bundled()["cars"]), emseg.simulate(cars(), truth="poses").events),
    }
    print("| recording | Mev/s | ev/s/px | rises, % | 5 % ms | median ms | 95 % ms | lonely, Hz/px |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    figure, axes = pyplot.subplots(2, 3, figsize=(10, 5.4), layout="constrained")
    bins = np.geomspace(0.3, 1000, 60)
    for line, (name, (real, made)) in zip(axes, pairs.items(), strict=True):
        for kind, events, colour in (("recorded", real, "black"), ("simulated", made, "tab:red")):
            print(row(f"{name}, {kind}", events))
            density, _ = np.histogram(intervals_ms(events), bins)
            line[0].stairs(density / density.sum(), bins, color=colour, label=kind)
            rates = rates_hz(events)
            line[1].plot(np.arange(1, len(rates) + 1) / len(rates), np.maximum(rates, 1e-2), color=colour)
            t = (events.t - events.t[0]) / 1e6
            counts, edges = np.histogram(t, np.arange(0, t[-1], 0.02))
            line[2].stairs(counts / 0.02 / 1e6, edges, color=colour)
        line[0].set(xscale="log", xlabel="interval between events of a pixel, ms", ylabel=name)
        line[1].set(xscale="log", yscale="log", xlabel="share of pixels", ylabel="their rate, Hz")
        line[2].set(xlabel="time, s", ylabel="events, Mev/s", ylim=(0, None))
        line[0].legend(frameon=False)
    target = ROOT / "docs" / "sensor_statistics.png"
    figure.savefig(target, dpi=80)
    print(target)


if __name__ == "__main__":
    main()
