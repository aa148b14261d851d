"""The benchmarks run, check their answers, and would notice wrong ones."""

from __future__ import annotations

import copy
import json
import os
import shutil
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


def test_sequences(tmp_path: Path) -> None:
    arguments = ("--scenes", "made_scene", "cars", "--seconds", "0.06")
    printed, written = run_bench("sequences", *arguments, json_path=tmp_path / "sequences.json")
    assert "made_scene" in printed
    made, cars = written["recordings"]
    for row in (made, cars):
        assert [run["threads"] for run in row["runs"]] == [1, 2]
        for run in row["runs"]:
            assert run["windows"] >= 1
            assert run["wall_s"] * run["mega_events_a_second"] * 1e6 == pytest.approx(row["events"])
            assert run["latency_p50_s"] <= run["latency_p95_s"] <= run["wall_s"]
            assert run["real_time_factor"] == pytest.approx(row["seconds"] / run["wall_s"])
        assert row["cold"]["cpu_s"] > 0
    # A window in which too few events are of objects has no figure.
    assert 1 <= made["warm"]["moving_iou_oracle_windows"] <= made["runs"][0]["windows"]
    assert made["warm"]["moving_iou_oracle"] > 0.5
    assert made["cold"]["moving_iou_oracle"] > 0.5
    assert cars["warm"] == {}  # its truth is boxes


def test_sequences_notice_what_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench import recordings
    from bench.sequences import check_run, check_same

    import emseg

    recording = recordings.load("made_scene", 0.02)
    half = len(recording.events) // 2
    cold = [emseg.segment(part) for part in (recording.events[:half], recording.events[half:])]
    one, two = cold
    two.start, two.stop = half, half + len(two.events)
    check_run(recording, [one, two])
    check_same(recording, [one, two], [one, two])
    wrong = {
        f"windows end at {half}": [one],
        "follows one that ends at 0": [two],
        f"follows one that ends at {half}": [one, one],
    }
    for message, windows in wrong.items():
        with pytest.raises(AssertionError, match=message):
            check_run(recording, windows)
    with pytest.raises(AssertionError, match="1 windows, 2 by"):
        check_same(recording, [one], [one, two])
    other = copy.copy(two)
    other.labels = 1 - two.labels
    with pytest.raises(AssertionError, match="depend on the number of threads"):
        check_same(recording, [one, two], [one, other])


def test_accuracy(tmp_path: Path) -> None:
    """On a folder of its own, of recordings as `emseg simulate` writes them and one without truth."""
    sim = tmp_path / "sim" / "test"
    sim.mkdir(parents=True)
    data = ROOT / "python" / "emseg" / "datasets" / "data"
    shutil.copy(data / "made_scene.npz", sim / "made.npz")
    arguments = ("--sim", str(sim.parent), "--reference", str(tmp_path), "--span", "0.1", "--jobs", "1")
    pictures = ("--pictures", str(tmp_path / "pictures"), "--worst", "1")
    printed, written = run_bench("accuracy", *arguments, *pictures, json_path=tmp_path / "accuracy.json")
    assert "made" in printed
    assert {"machine", "commit", "versions", "settings"} <= set(written)
    (row,) = written["scenes"]
    assert row["seconds"] == pytest.approx(0.1, abs=0.01)
    assert row["windows"] == len(row["each"]) >= 1
    assert row["events"] == sum(window["stop"] - window["start"] for window in row["each"])
    assert row["moving_iou_oracle"] > 0.5
    assert row["boxes"] > 0
    assert 0 <= row["detection_rate"] <= 1
    assert set(row["switches"]) == {"1", "2"}
    assert written["mean"]["moving_iou_oracle"] == row["moving_iou_oracle"]
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["made_1.png"]
    shutil.copy(data / "cars_davis346.npz", sim)
    command = [sys.executable, "-m", "bench.accuracy", *arguments]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "made" in done.stdout
    assert "cars_davis346.npz: holds no label, expected the truth per event" in done.stderr


def test_accuracy_keeps_small_windows_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.recordings import Recording
    from bench.scoring import scored, summary

    import emseg
    from emseg.render import BOX_DTYPE

    # Two windows of 1000 events: 300 of an object, all found; 100, with a false object beside it.
    t = np.arange(2000)
    truth = np.zeros(2000, np.int64)
    truth[:300] = truth[1000:1100] = 1
    x = np.where(truth == 1, 10 + t % 5, 50 + t % 20)
    events = emseg.EventArray(x, x, t, t % 2, width=80, height=80)
    recording = Recording("made", events, truth)
    labels = np.where(truth == 1, 4, 0)
    labels[1100:1190] = 5
    boxes = np.array([(4, 10, 10, 5, 5)], BOX_DTYPE)
    found = [scored(recording, k, k + 1000, labels[k : k + 1000], boxes, k + 500) for k in (0, 1000)]
    row = summary(recording, found, 2.0)
    assert (row["windows"], row["small"]["windows"], row["skipped"]) == (2, 1, 0)
    assert (row["moving_iou_deployed"], row["detection_rate"], row["boxes"]) == (1.0, 1.0, 1)
    assert row["small"]["moving_iou_deployed"] == 100 / 190
    assert row["small"]["falsely_moving"] == 90 / 900
    assert (row["switches"], row["tracked"]) == ({1: 0}, 1.0)
    assert row["mega_events_a_cpu_second"] == 1e-3


def run_experiments(*arguments: str, out: Path) -> dict[str, Any]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", "bench.experiments", *arguments, "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    written: dict[str, Any] = json.loads((out / "experiments.json").read_text(encoding="utf-8"))
    return written


def test_experiments(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="curves need the extra 'viz'")
    suite = ("--suite", str(tmp_path / "suite"), "--seeds", "11000:11001", "--duration", "0.04")
    written = run_experiments(*suite, "--scenes", "evimo", "--parameters", "lambda_data", out=tmp_path)
    assert {"machine", "commit", "versions", "settings", "seeds", "durations"} <= set(written)
    runs = written["runs"]
    assert [run["what"] for run in runs] == ["thesis", "published", "auto", *["lambda_data"] * 5]
    assert all(run["cpu_s"] > 0 and run["peak_mb"] >= 0 for run in runs)
    # The sweep passes through the thesis' own settings.
    swept = next(run for run in runs[3:] if run["value"] == 1)
    for name in ("moving_iou_deployed", "object_iou", "labels", "windows"):
        assert swept[name] == runs[0][name]
    page = (tmp_path / "experiments.md").read_text(encoding="utf-8")
    assert f"commit {written['commit']}, seeds 11000, the middle" in page
    assert "![lambda_data](experiments_lambda_data.svg)" in page
    curves = (tmp_path / "experiments_lambda_data.svg").read_text(encoding="utf-8")
    assert f"commit {written['commit']}, seeds 11000, the middle" in curves
    (tmp_path / "experiments.md").unlink()
    run_experiments("--redraw", out=tmp_path)  # of what was measured
    assert (tmp_path / "experiments.md").read_text(encoding="utf-8") == page
    assert (tmp_path / "experiments_lambda_data.svg").read_text(encoding="utf-8") == curves


def test_experiments_vary_one_parameter_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.experiment_runs import EXPERIMENTS, PARAMETERS, Run, hands_runs, parameter_runs

    import emseg

    recordings = [Run("", name, Path("x.npz"), "", emseg.Config(), 0, 0.1) for name in EXPERIMENTS]
    runs = parameter_runs(recordings, list(PARAMETERS), windows=2)
    assert len(runs) == len(EXPERIMENTS) * sum(map(len, PARAMETERS.values()))
    for run in runs:
        thesis = vars(emseg.Config.preset(EXPERIMENTS[run.experiment].thesis))
        assert run.most_events == 2 * thesis["num_events_per_image"]
        changed = {name: value for name, value in vars(run.config).items() if thesis[name] != value}
        changed.pop("threads", None)
        names = ("bracket_row", "bracket_col") if run.what == "bracket" else (run.what,)
        assert changed == {} or changed == dict.fromkeys(names, run.value)
    swept = hands_runs(recordings, windows=2)
    assert {(run.config.lambda_smooth, run.config.lambda_label) for run in swept} == {
        (smooth, label) for smooth in (20, 30) for label in range(0, 9_000, 1_000)
    }
    assert len(swept) == 18


def test_experiments_go_on_where_they_were(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from dataclasses import replace

    from bench.experiment_runs import Run, keep_figures, kept_figures, key_of, measure
    from bench.experiments import run_all

    import emseg

    made = ROOT / "python" / "emseg" / "datasets" / "data" / "made_scene.npz"
    config = emseg.Config(threads=1, num_events_per_image=10_000)
    run = Run("a", "hands", made, "", config, 0, 1.0, most_events=30_000)
    figures = measure(run)
    assert (figures["events"], figures["windows"], figures["cut_short"]) == (30_000, 3, False)
    assert 0 < figures["cpu_s"] < figures["process_cpu_s"]
    assert 0 < figures["peak_mb"] < figures["process_peak_mb"]
    short = measure(replace(run, most_cpu_s=0.0))
    assert (short["windows"], short["cut_short"]) == (1, True)

    # The name a run is kept by tells apart all that changes figures, and nothing else.
    key = key_of(run)
    assert key == key_of(replace(run, what="b", value=3.0))
    for other in (
        replace(run, config=replace(config, lambda_data=2.0)),
        replace(run, most_events=20_000),
        replace(run, path=made.with_name("cars_davis346.npz")),
    ):
        assert key_of(other) != key
    assert kept_figures(tmp_path, key) is None
    keep_figures(tmp_path, key, figures)
    assert kept_figures(tmp_path, key) == figures
    # Both rows come from the run that is kept: no process is started.
    monkeypatch.setattr("bench.experiments.measure", None)
    rows, failed = run_all([run, replace(run, what="b", value=3.0)], 1, tmp_path)
    assert [(row["what"], row["value"]) for row in rows] == [("a", None), ("b", 3.0)]
    assert all(row["cpu_s"] == figures["cpu_s"] for row in rows)
    assert failed == []
    (tmp_path / f"{key}.json").write_text('{"cpu_s"', encoding="utf-8")
    assert kept_figures(tmp_path, key) is None  # damaged: to be measured again


def test_experiments_take_public_recordings(tmp_path: Path) -> None:
    import emseg
    from emseg.simulation.evimo import write_evimo
    from emseg.simulation.suite import suite_scene

    made = emseg.simulate(suite_scene("collision_table", 1, duration=0.06))
    write_evimo(tmp_path / "EV-IMO" / "table.npz", made)
    data = ("--data", f"evimo={tmp_path / 'EV-IMO'}")
    runs = run_experiments("--scenes", "evimo", "--only", "settings", *data, out=tmp_path)["runs"]
    assert [run["what"] for run in runs] == ["thesis", "published", "auto"]
    assert {run["recording"] for run in runs} == {"table"}
    assert all(run["moving_iou_oracle"] > 0.3 for run in runs)


def test_growth(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="plots need the extra 'viz'")
    arguments = ("--events", "2000", "6000", "--size", "200x150", "--pools", "4", "8", "--repeats", "1")
    plots = ("--plot", str(tmp_path / "plots"))
    printed, written = run_bench("growth", *arguments, *plots, json_path=tmp_path / "growth.json")
    assert "exponent of the events" in printed
    assert [row["events"] for row in written["events"]] == [2000, 6000]
    for row in (*written["events"], *written["pools"]):
        assert sum(row["stages_cpu_s"].values()) == pytest.approx(row["cpu_s"])
    assert all(row["peak_mb_over_events"] > 0 for row in written["events"])
    assert written["events"][1]["accuracy"] > 0.8
    assert [row["threads"] for row in written["threads"]] == [1, 2]
    assert len(list((tmp_path / "plots").glob("*.svg"))) == 3


def test_growth_finds_the_exponents_of_power_laws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.growth import exponents, local_exponents

    rows = [{"events": n, "cpu_s": 3e-6 * n**1.5, "stages_cpu_s": {"graph": 2.0 * n}} for n in (10, 100, 700)]
    assert exponents(rows, "events") == pytest.approx({"all": 1.5, "graph": 1.0})
    assert local_exponents(rows, "events") == [None, pytest.approx(1.5), pytest.approx(1.5)]


def test_outlines_move_alike_for_any_number_of_events(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the true labels hold is sharpest under its true motion."""
    monkeypatch.syspath_prepend(str(ROOT))
    from bench.moving_outlines import VELOCITIES, moving_outlines

    import emseg

    for count in (5000, 20_000):
        window = moving_outlines(count, 320, 240)
        assert len(window.events) == count
        assert window.truth is not None
        assert np.count_nonzero(window.truth == -1) == count // 50
        for label in range(len(VELOCITIES)):
            own = window.events[window.truth == label]
            assert len(own) > count / 25
            sharpness = [
                float(emseg.iwe(own, emseg.MotionModel("translation", v), 25_000).var())
                for v in (*VELOCITIES, (0.0, 0.0))
            ]
            assert int(np.argmax(sharpness)) == label


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
