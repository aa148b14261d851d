"""The benchmarks run, check their answers, and would notice wrong ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("maxflow", reason="the benchmarks need the extra 'reference'")
pytest.importorskip("numba", reason="the benchmarks need the extra 'reference'")

ROOT = Path(__file__).resolve().parents[2]


def run_bench(name: str, *arguments: str, json_path: Path) -> tuple[str, dict[str, Any]]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", f"bench.{name}", *arguments, "--json", str(json_path)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads(json_path.read_text(encoding="utf-8"))


def test_stages(tmp_path: Path) -> None:
    arguments = ("--windows", "made_scene", "--repeats", "1", "--fresh", "1", "--reference", "none")
    printed, written = run_bench("stages", *arguments, json_path=tmp_path / "stages.json")
    assert "made_scene" in printed
    assert {"machine", "commit", "versions", "settings"} <= set(written)
    (row,) = written["windows"]
    assert row["cold_cpu_s"] > 0
    assert row["import_cpu_s"] > 0
    assert row["peak_mb_over_numpy"] > 1
    assert row["true_labels"] == 3
    assert row["accuracy"] > 0.5
    assert {"graph", "model_pool", "labels", "refit"} <= set(row["stages_wall_s"])


def test_kernels(tmp_path: Path) -> None:
    printed, written = run_bench("kernels", "--events", "1000", json_path=tmp_path / "kernels.json")
    rows = written["rows"]
    assert all(row["ours_ms"] > 0 and row["peer_ms"] > 0 for row in rows)
    for what in ("graph", "warp + vote", "contrast", "motion fit", "max-flow", "expansion", "import emseg"):
        assert any(row["what"].startswith(what) for row in rows), what
        assert what in printed


def test_triangulations_may_differ_in_cocircular_diagonals_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.kernels import check_triangulation

    sides = [(0, 1), (0, 2), (1, 3), (2, 3)]

    def check(corners: list[tuple[int, int]], ours: tuple[int, int], theirs: tuple[int, int]) -> None:
        pixels = np.array(corners, np.int32)
        check_triangulation(pixels, np.array([*sides, ours], np.int32), np.array([*sides, theirs], np.int32))

    square = [(0, 0), (2, 0), (0, 2), (2, 2)]
    check(square, (0, 3), (1, 2))
    check(square, (0, 3), (0, 3))
    with pytest.raises(AssertionError, match="off its circle"):
        check([(0, 0), (2, 0), (0, 2), (3, 3)], (0, 3), (1, 2))
    with pytest.raises(AssertionError, match="without crossing"):
        check(square, (1, 0), (1, 2))


def test_published_energy_is_the_reference_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where labels leave models out, and where other solutions stand beside it on the same scale."""
    monkeypatch.syspath_prepend(str(ROOT))
    from bench import windows
    from bench.published import Solution, published_energies, reference_window

    from emseg import event_graph
    from emseg.reference import EventGraph, MotionModel, labeling_energy, unary_costs

    window = windows.load("made_scene")
    frame = reference_window(window).select(np.arange(3000))
    window = windows.BenchWindow("start", window.events[:3000])
    models = [MotionModel("translation", (v, 40.0)) for v in (-115.0, 0.0, 190.0)]
    labels = np.where(frame.pixel[:, 0] < 100, 2, 0)  # no event has label 1
    expected = labeling_energy(
        labels // 2,
        unary_costs(models[::2], frame),
        EventGraph(*event_graph(window.events)),
        lambda_smooth=30,
        label_cost=np.full(2, 8000),
    )
    solution = Solution(labels, models, frame)
    assert published_energies(window, [solution]) == [expected]
    assert published_energies(window, [solution, solution]) == published_energies(window, [solution]) * 2
