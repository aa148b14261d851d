"""Trains the classifiers that tell what moves from what stands still (emseg.scene) on simulated recordings.

    emseg simulate --suite CLIPS --seeds 0:7 --duration 0.5 --jobs 2
    python scripts/train_scene.py CLIPS --out python/emseg/data/scene_classifiers.json

Every recording gives some windows, of lengths in which its objects move some pixels against the background.
The parts of a window are those that emseg finds in it; a part moves if most of its events are of objects.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

import emseg
from emseg import scene
from emseg.metrics import event_moving_iou
from emseg.parts import Window, find_parts
from emseg.still_scene import sight, still_motion
from emseg.tracking import Tracker

Array = npt.NDArray[np.float64]
WINDOWS = 10
DISPLACEMENT = 8.0  # px of objects against the background, times .5 to 2


@dataclass
class Example:
    """Parts of a window: features by themselves and against possible backgrounds, and whether they move."""

    recording: str
    appearance: Array
    against: dict[int, Array]  # by part; -1 for none
    against_scene: Array | None  # against all that truly stands still
    firm: Array
    areas: list[float]
    sizes: list[int]
    moving: npt.NDArray[np.bool_]
    owners: npt.NDArray[np.int16]
    part_of_event: npt.NDArray[np.int16]


def background_flow(data: Any, frame: int) -> tuple[Array, Array, Array]:
    """Places and velocities (n,), (n,), (n, 2) of some still pixels, px and px/s, by depth and poses."""
    camera, poses, times = data["K"], data["gt_T_world_camera"], data["gt_t"]
    move = np.linalg.inv(poses[frame + 1]) @ poses[frame]
    y, x = np.mgrid[4 : int(data["height"]) : 8, 4 : int(data["width"]) : 8]
    depth = data["gt_depth"][frame][y, x].astype(np.float64)
    known = (data["gt_mask"][frame][y, x] == 0) & np.isfinite(depth) & (depth > 0)
    x, y, depth = x[known], y[known], depth[known]
    rays = np.stack(
        [(x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1], np.ones_like(depth)]
    )
    moved = move[:3, :3] @ (rays * depth) + move[:3, 3:]
    seconds = (times[frame + 1] - times[frame]) * 1e-6
    to_x = moved[0] / moved[2] * camera[0, 0] + camera[0, 2]
    to_y = moved[1] / moved[2] * camera[1, 1] + camera[1, 2]
    return x, y, np.stack([to_x - x, to_y - y], axis=-1) / seconds


def relative_speed(data: Any, time: int) -> float:
    """Median speed of the objects against the background around them, px/s; 150 where none is seen."""
    times, masks = data["gt_t"], data["gt_mask"]
    frame = int(np.clip(np.searchsorted(times, time), 2, len(times) - 3))
    x, y, flow = background_flow(data, frame)
    speeds = []
    for label in np.unique(masks[frame - 2 : frame + 3]):
        places = [np.argwhere(masks[f] == label) for f in (frame - 2, frame + 2)]
        if label <= 0 or min(map(len, places)) < 30:
            continue
        first, last = (place.mean(axis=0)[::-1] for place in places)
        velocity = (last - first) / ((times[frame + 2] - times[frame - 2]) * 1e-6)
        middle = (first + last) / 2
        weight = np.exp(-((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / (2 * 40.0**2)) + 1e-6
        speeds.append(float(np.linalg.norm(velocity - weight @ flow / weight.sum())))
    return max(1.0, float(np.median(speeds))) if speeds else 150.0


def examples_of(path: Path) -> list[Example]:
    """The examples of a recording, a window each."""
    data = dict(np.load(path))
    t, width, height = data["t"], int(data["width"]), int(data["height"])
    segmenter = emseg.Segmenter(width, height, config=emseg.Config(threads=1, background="widest"))
    tracker = Tracker(width, height)
    random = np.random.default_rng(sum(path.name.encode()))
    examples = []
    for place in np.linspace(0.06, 0.9, WINDOWS):
        begin = t[0] + place * (t[-1] - t[0])
        duration = DISPLACEMENT / relative_speed(data, begin) * random.uniform(0.5, 2)
        first, last = np.searchsorted(t, [begin, begin + 1e6 * np.clip(duration, 0.01, 0.15)])
        last = min(last, first + 300_000)
        if last - first < 500:
            continue
        events = emseg.EventArray(*(data[c][first:last] for c in "xytp"), width=width, height=height)
        found = segmenter.find_motions(events)
        groups, _ = tracker.split(events, found.labels, found.models, found.t_ref)
        parts = [p for p in find_parts(events, groups) if len(p.own) >= scene.MIN_EVENTS]
        if not parts:
            continue
        seconds = 1e-6 * max(1, int(events.t[-1] - events.t[0]))
        loss = partial(segmenter.motion_losses, t_ref=found.t_ref, duration=seconds)
        window = Window(events, seconds, loss)
        owners = data["label"][first:last].astype(np.int16)
        large = sorted(range(len(parts)), key=lambda k: -parts[k].area)[:4]
        part_of_event = np.full(len(events), -1, np.int16)
        for k, part in enumerate(parts):
            part_of_event[part.own] = k
        moving = np.array([(owners[p.own] > 0).sum() * 2 > (owners[p.own] >= 0).sum() for p in parts])
        still = [p for p, moves in zip(parts, moving, strict=True) if not moves]
        scene_features = None
        if still:
            own = np.array([scene.appearance(part, window) for part in still])
            firm = [scene.firmness(part, window) for part in still]
            sights = [sight(part, window) for part in still]
            flow = still_motion(still, window, scene.ambiguity(own), firm, sights)
            largest = max(still, key=lambda p: p.area)
            scene_features = np.array([scene.motion_against(p, largest, window, flow) for p in parts])
        examples.append(
            Example(
                path.stem,
                np.array([scene.appearance(part, window) for part in parts]),
                {
                    b: np.array(
                        [scene.motion_against(p, parts[b] if b >= 0 else None, window) for p in parts]
                    )
                    for b in [-1, *large]
                },
                scene_features,
                np.array([scene.firmness(part, window) for part in parts]),
                [part.area for part in parts],
                [len(part.own) for part in parts],
                moving,
                owners,
                part_of_event,
            )
        )
    return examples


def train(
    features: Array, moving: Array, weight: Array, *, hidden: int = 6, decay: float = 3e-3
) -> scene.Perceptron:
    """Least mean logistic loss, weights decaying; deterministic."""
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-3
    z, sign, weight = (features - mean) / scale, 2 * moving - 1, weight / weight.sum()
    n = z.shape[1]
    cuts = np.cumsum([n * hidden, hidden, hidden])
    random = np.random.default_rng(0)
    start = np.concatenate(
        [random.normal(0, 0.3, n * hidden), np.zeros(hidden), random.normal(0, 0.3, hidden), [0]]
    )

    def objective(values: Array) -> tuple[float, Array]:
        flat, bias, out, level = np.split(values, cuts)
        inner = flat.reshape(n, hidden)
        active = np.tanh(z @ inner + bias)
        logit = active @ out + level[0]
        value = weight @ np.logaddexp(0, -sign * logit) + decay * ((inner**2).sum() + (out**2).sum())
        slope = -weight * sign / (1 + np.exp(np.clip(sign * logit, -50, 50)))
        back = np.outer(slope, out) * (1 - active**2)
        gradient = [
            (z.T @ back + 2 * decay * inner).ravel(),
            back.sum(axis=0),
            active.T @ slope + 2 * decay * out,
        ]
        return float(value), np.concatenate([*gradient, [slope.sum()]])

    solution = minimize(objective, start, jac=True, method="L-BFGS-B", options={"maxiter": 400}).x
    flat, bias, out, level = np.split(solution, cuts)
    return scene.Perceptron(mean, scale, flat.reshape(n, hidden), bias, out, float(level[0]))


def both_features(example: Example, classifier: scene.Perceptron) -> Array:
    """Of every part, by itself and against the background chosen."""
    large = [k for k in example.against if k >= 0]
    own = example.appearance[large]
    areas, firm = [example.areas[k] for k in large], example.firm[large]
    chosen = scene.choose_background(areas, own, classifier(own), firm)
    return np.hstack([example.appearance, example.against[-1 if chosen is None else large[chosen]]])


Classifiers = tuple[scene.Perceptron, scene.Perceptron, scene.Perceptron]


def train_all(examples: list[Example]) -> Classifiers:
    """Three networks: by appearance, against one part, against all that truly stands still."""

    def columns(chosen: list[Example]) -> tuple[Array, Array]:
        moving = np.concatenate([e.moving for e in chosen]).astype(np.float64)
        # A window counts once, its parts by the root of their events.
        return moving, np.concatenate([np.sqrt(e.sizes) / np.sqrt(e.sizes).sum() for e in chosen])

    first = train(np.concatenate([e.appearance for e in examples]), *columns(examples))
    second = train(np.concatenate([both_features(e, first) for e in examples]), *columns(examples))
    known = [(e, e.against_scene) for e in examples if e.against_scene is not None]
    scenes = np.concatenate([np.hstack([e.appearance, against]) for e, against in known])
    third = train(scenes, *columns([e for e, _ in known]))
    return first, second, third


def score(examples: list[Example], classifiers: Classifiers) -> dict[str, Array]:
    """Moving IoU by one part's motion, by that of all that stands still, and at best; mean by recording."""
    figures: dict[str, list[list[float]]] = {}
    for example in examples:
        if (example.owners > 0).sum() < 200:
            continue
        by_part = classifiers[1](both_features(example, classifiers[0])) > 0
        by_scene = by_part
        if example.against_scene is not None:
            by_scene = classifiers[2](np.hstack([example.appearance, example.against_scene])) > 0
        row = []
        for moving in (by_part, by_scene, example.moving):
            labels = np.where(example.part_of_event >= 0, moving[example.part_of_event], 0).astype(np.int32)
            row.append(event_moving_iou(example.owners, labels))
        figures.setdefault(example.recording, []).append(row)
    return {name: np.nanmean(rows, axis=0) for name, rows in figures.items()}


def main() -> None:
    """Train, report, and write the weights if asked to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("clips", type=Path, nargs="+", help="folders of simulated recordings")
    parser.add_argument("--out", type=Path, help="file of weights; none: only report")
    parser.add_argument("--test", type=Path, nargs="*", default=[], help="folders to report on only")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()

    def read(folders: list[Path]) -> list[Example]:
        files = sorted(path for folder in folders for path in folder.rglob("*.npz"))
        with ProcessPoolExecutor(arguments.jobs) as pool:
            return [example for found in pool.map(examples_of, files) for example in found]

    examples = read(arguments.clips)
    names = sorted({e.recording for e in examples})
    halves = [[e for e in examples if names.index(e.recording) % 2 == half] for half in (0, 1)]
    held_out = [score(halves[1 - h], train_all(halves[h])) for h in (0, 1)]
    both = np.array([row for figures in held_out for row in figures.values()])
    print("moving IoU by a part, by the scene, at best")
    print(f"{len(examples)} windows; other half's recordings: {both.mean(axis=0).round(3)}")
    classifiers = train_all(examples)
    if arguments.test:
        figures = score(read(arguments.test), classifiers)
        for name, row in figures.items():
            print(f"{name:28s}", row.round(2))
        print("mean", np.mean(list(figures.values()), axis=0).round(3))
    if arguments.out:
        weights = {
            name: {
                field: np.round(getattr(c, field), 5).tolist()
                for field in ("mean", "scale", "hidden", "bias", "out", "level")
            }
            for name, c in zip(("appearance", "part", "scene"), classifiers, strict=True)
        }
        arguments.out.write_text(json.dumps(weights) + "\n")


if __name__ == "__main__":
    main()
