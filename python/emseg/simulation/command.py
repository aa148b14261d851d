"""What `emseg simulate` does."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from emseg.simulation.scene import Scene
from emseg.simulation.simulator import simulate
from emseg.yaml_files import ConfigError, nearest

__all__ = ["simulate_scene", "simulate_suite"]

Echo = Callable[..., Any]


def scene_of(name: str, seed: int, duration: float) -> Scene:
    """The scene of a YAML file, or of the suite where there is no file of that name.

    Raises:
        ConfigError: neither, or the file holds no scene.
    """
    from emseg.simulation.suite import NAMES, suite_scene

    if name in NAMES and not Path(name).exists():
        return suite_scene(name, seed, duration=duration)
    if Path(name).suffix == "" and not Path(name).exists():
        raise ConfigError(
            f"{name}: no such file, nor a scene of the suite ({', '.join(NAMES)}){nearest(name, NAMES)}"
        )
    return Scene.from_yaml(Path(name))


def simulate_scene(scene: str, seed: int, duration: float, out: Path, layout: str, echo: Echo) -> int:
    """Simulate one scene, a file or one of the suite by name; returns the number of failures."""
    try:
        simulation = simulate(scene_of(scene, seed, duration))
        if layout == "npz":
            simulation.save(out)
        else:
            from emseg.simulation import evimo

            write = {"evimo2": evimo.write_evimo2, "evimo": evimo.write_evimo, "evimo-txt": evimo.write_text}
            write[layout](out, simulation)
    except (ConfigError, OSError, ValueError) as error:
        line = " ".join(str(error).split())
        echo(f"failed: {line if scene in line else f'{scene}: {line}'}", err=True)
        return 1
    echo(f"done: {scene}: {len(simulation.events):,} events: {out}")
    return 0


def simulate_suite(
    folder: Path, seeds: str, names: Sequence[str], duration: float, processes: int, echo: Echo
) -> int:
    """Make the suite's recordings; returns the number of failures."""
    from emseg.simulation.generate import generate, suite_jobs, write_manifest
    from emseg.simulation.suite import NAMES

    found = re.fullmatch(r"(\d+):(\d+)", seeds)
    if found is None or not int(found[1]) < int(found[2]):
        echo(f"failed: --seeds {seeds}: expected A:B with A < B", err=True)
        return 1
    try:
        todo = suite_jobs(
            folder, range(int(found[1]), int(found[2])), names=names or NAMES, duration=duration
        )
        folder.mkdir(parents=True, exist_ok=True)
    except (ValueError, OSError) as error:
        echo(f"failed: {error}", err=True)
        return 1
    failed = 0
    for outcome in generate(todo, processes=processes):
        failed += outcome.status == "failed"
        echo(f"{outcome.status}: {outcome.message}", err=outcome.status == "failed")
    echo(f"listed in {write_manifest(todo)}")
    return failed
