"""The simulator's speed: simulated events per CPU second.

The target, 2 Mev per CPU second, is for a planar scene on 346x260: textured planes, the camera and two
objects moving.  The scenes of the suite say what a user waits for, their truth and files included.

    python -m bench.simulator [--scenes all|NAME ...] [--json FILE]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import emseg
from bench.common import circumstances, cpu_time, print_circumstances, print_table, require, write_json
from emseg.simulation import Scene, Simulation
from emseg.simulation.build import build, native_sensor
from emseg.simulation.scene import Sensor
from emseg.simulation.suite import NAMES, suite_scene

PLANAR: dict[str, Any] = {
    "name": "planar",
    "duration": 1.0,
    "seed": 1,
    "camera": {
        "width": 346,
        "height": 260,
        "fx": 258.0,
        "motion": {
            "waves": [
                {"amplitude": [0.5, 0, 0], "frequency": 0.32},
                {"amplitude": [0, 0.2, 0], "frequency": 0.48},
            ]
        },
    },
    "sensor": {"shot_noise": 0.2},
    "bodies": [
        {
            "name": "poster",
            "shape": {"kind": "rectangle", "size": [20, 20]},
            "motion": {"position": [0, 0, 3]},
            "texture": {"grain": 0.13},
        },
        {
            "name": "blob",
            "shape": {"kind": "blob", "radius": 0.3},
            "motion": {"position": [-0.5, 0, 2], "velocity": [1, 0, 0]},
            "texture": {"grain": 0.06, "kind": "blocks"},
        },
        {
            "name": "card",
            "shape": {"kind": "rectangle", "size": [0.4, 0.3]},
            "motion": {"position": [0.6, 0.3, 1.6], "velocity": [-1, 0, 0]},
            "texture": {"grain": 0.06, "kind": "stripes"},
        },
    ],
}


def bench_planar(repeats: int = 3) -> dict[str, Any]:
    """Events alone, one thread: from a built scene to columns of events and owners."""
    from emseg import _core

    scene = Scene.from_mapping(PLANAR)
    built, sensor = build(scene), native_sensor(scene.sensor, scene.seed)
    options = _core.SimulationOptions()
    options.duration = scene.duration
    options.threads = 1
    timed = cpu_time(lambda: built.native.simulate(sensor, options), repeats)
    owners = timed.result["owner"]
    count = len(owners)
    require(count > 500_000, f"{count} events, expected a lively scene")
    require(set(np.unique(owners)) == {-1, 0, 1, 2}, "expected events of all owners")
    quiet = native_sensor(Sensor.ideal(), 1)
    still = build(
        Scene.from_mapping(PLANAR | {"camera": {"width": 64, "height": 48}, "bodies": PLANAR["bodies"][:1]})
    )
    options.duration = 0.1
    require(
        len(still.native.simulate(quiet, options)["t"]) == 0, "a still scene without noise makes no event"
    )
    return {"events": count, "cpu_s": timed.cpu_s, "mev_per_cpu_s": count / timed.cpu_s / 1e6}


def bench_scene(name: str) -> dict[str, Any]:
    """A recording of the suite as `emseg simulate --suite` makes it: events, truth and file."""

    def make() -> Simulation:
        simulation = emseg.simulate(suite_scene(name, 0), threads=1)
        with tempfile.TemporaryDirectory() as folder:
            simulation.save(Path(folder, "out.npz"))
        return simulation

    timed = cpu_time(make, 1)
    events = timed.result.events
    return {
        "scene": name,
        "size": f"{events.width}x{events.height}",
        "events": len(events),
        "cpu_s": timed.cpu_s,
        "mev_per_cpu_s": len(events) / timed.cpu_s / 1e6,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="*", default=[], help="of the suite, too; all: every one")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    chosen = parser.parse_args(arguments)
    found = circumstances()
    print_circumstances(found)
    planar = bench_planar()
    print_table(
        ("planar 346x260, events alone", "events", "CPU s", "Mev per CPU s", "target"),
        [("1 s", f"{planar['events']:,}", f"{planar['cpu_s']:.3f}", f"{planar['mev_per_cpu_s']:.2f}", "≥ 2")],
        left=(0, 4),
    )
    names = NAMES if chosen.scenes == ["all"] else chosen.scenes
    rows = [bench_scene(name) for name in names]
    if rows:
        print()
        print_table(
            ("suite, 0.5 s, with truth and file", "size", "events", "CPU s", "Mev per CPU s"),
            [
                (
                    row["scene"],
                    row["size"],
                    f"{row['events']:,}",
                    f"{row['cpu_s']:.2f}",
                    f"{row['mev_per_cpu_s']:.2f}",
                )
                for row in rows
            ],
            left=(0, 1),
        )
    if chosen.json:
        write_json(chosen.json, found, planar=planar, suite=rows)


if __name__ == "__main__":
    main()
