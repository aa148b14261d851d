"""Evaluating data sets: every protocol by hand, the report, and `emseg evaluate` from end to end."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import emseg
from emseg.cli import app
from emseg.datasets import BoxTrack, FlowTrack, ImageTrack, LabelledRecording, Truth, open_dataset
from emseg.evaluation.protocols import PROTOCOLS, event_truth, score_recording
from emseg.evaluation.published import PUBLISHED, published_for
from emseg.evaluation.report import OURS, merged_rows, text_table
from emseg.evaluation.run import evaluate_dataset
from emseg.evaluation.segmented import SegmentedRecording, SegmentedWindow, segment_recording
from emseg.evaluation.views import extreme_views
from emseg.render import BOX_DTYPE

WIDTH, HEIGHT = 60, 40
SQUARE = (10, 5, 20, 20)  # x, y, w, h of the object
STOP_US = 200_000


def recording(**truth: object) -> LabelledRecording:
    """0.2 s in two windows: 4000 events of an object in a square, 4000 of the background beside it."""
    n = 8000
    rng = np.random.default_rng(0)
    own = np.arange(n) % 2 == 0
    x, y, w, h = SQUARE
    columns = np.where(own, x + rng.integers(0, w, n), 35 + rng.integers(0, 25, n))
    rows = np.where(own, y + rng.integers(0, h, n), rng.integers(0, HEIGHT, n))
    t = np.arange(n) * STOP_US // n
    events = emseg.EventArray(columns, rows, t, np.zeros(n, int), width=WIDTH, height=HEIGHT)
    return LabelledRecording("made", events, truth=Truth(**{"scene": "moving", **truth}))  # type: ignore[arg-type]


def owners() -> np.ndarray:
    return np.where(np.arange(8000) % 2 == 0, 1, 0)


def mask() -> np.ndarray:
    image = np.zeros((HEIGHT, WIDTH), np.int32)
    x, y, w, h = SQUARE
    image[y : y + h, x : x + w] = 7
    return image


def masks(image: np.ndarray) -> ImageTrack:
    return ImageTrack(np.arange(0, STOP_US + 1, 10_000), lambda k: image)


def found(labels: np.ndarray, *, velocity: tuple[float, float] = (0, 0)) -> SegmentedRecording:
    boxes = np.array([(1, *SQUARE)], BOX_DTYPE) if (labels > 0).any() else np.empty(0, BOX_DTYPE)
    models = [emseg.MotionModel("translation", velocity, label) for label in np.unique(labels[labels >= 0])]
    windows = [SegmentedWindow(k, k + 4000, 50_000 + 25 * k, models, boxes) for k in (0, 4000)]
    return SegmentedRecording(labels.astype(np.int32), windows, 1.0, 1.0)


def figures(made: LabelledRecording, result: SegmentedRecording) -> dict[tuple[str, str], tuple[float, ...]]:
    return {(figure.protocol, figure.name): figure.values for figure in score_recording(made, result)}


def test_a_right_answer_by_every_protocol() -> None:
    boxes = BoxTrack(np.array([30_000, 150_000]), np.array([SQUARE, SQUARE], float))
    scored = figures(recording(labels=owners(), masks=masks(mask()), boxes=boxes), found(owners()))
    assert scored["events", "moving IoU"] == (1, 1)
    assert scored["events", "object IoU"] == (1, 1)
    assert scored["events", "clusters per motion"] == (1, 1)
    assert scored["tracks", "identity switches"] == (0,)
    assert scored["owner boxes", "detection rate"] == scored["eed", "detection rate"] == (1, 1)
    # masks at 20, 50, .. 170 ms: every 25 ms of those each 10 ms, where there are events 12.5 ms about them
    assert scored["mask 40 Hz", "mask IoU"] == scored["mask 40 Hz", "Dice"] == (1,) * 6
    assert scored["mask 40 Hz", "pixel accuracy"] == (1,) * 6
    # the square's own corners may have no event
    assert all(0.98 < value <= 1 for value in scored["mask dense", "mask IoU, hulls filled"])
    # the truth of points is dilated by 2 px, which reaches no event of the background
    assert scored["points", "point IoU"] == (1,) * 6
    assert scored["labels", "labels in a window"] == (2, 2)
    assert scored["labels", "events in moving labels"] == (0.5, 0.5)
    assert ("still", "events in moving labels") not in scored


def test_a_wrong_answer_by_every_protocol() -> None:
    """The background is called moving, and so is the object from the second window on, in another track."""
    labels = 1 - owners()
    labels[4000:] += 2 * owners()[4000:]
    boxes = BoxTrack(np.array([30_000, 150_000, 400_000]), np.array([SQUARE] * 3, float))
    scored = figures(recording(labels=owners(), masks=masks(mask()), boxes=boxes), found(labels))
    assert scored["events", "moving IoU"] == (0, 0.5)
    assert scored["events", "moving IoU, oracle"] == (1, 1)
    assert scored["tracks", "identity switches"] == (0,)
    eed = scored["eed", "detection rate"]
    assert eed[:2] == (0, 1)
    assert np.isnan(eed[2])  # after the last event
    assert scored["mask 40 Hz", "mask IoU"][0] == 0
    assert 0.3 < scored["mask 40 Hz", "mask IoU"][-1] < 0.5


def test_small_windows_are_skipped() -> None:
    truth = owners()
    truth[4000:][np.cumsum(truth[4000:]) > 199] = 0
    scored = figures(recording(labels=truth), found(truth))
    assert scored["events", "moving IoU"][0] == 1
    assert np.isnan(scored["events", "moving IoU"][1])
    assert len(scored["owner boxes", "detection rate"]) == 1


def test_events_take_their_truth_from_the_nearest_mask() -> None:
    """Object 7 in the mask of 40 ms, nothing in that of 60 ms, unknown in that of 120 ms."""
    images = [mask(), mask() * 0, mask() * 0 - 1]
    track = ImageTrack(np.array([40_000, 60_000, 120_000]), lambda k: images[k])
    made = recording(masks=track)
    truth = event_truth(made)
    assert truth is not None
    expected = np.full(8000, -1)
    t = made.events.t
    expected[(t >= 15_000) & (t < 50_000)] = 7 * owners()[(t >= 15_000) & (t < 50_000)]
    expected[(t >= 50_000) & (t < 85_000)] = 0
    np.testing.assert_array_equal(truth, expected)
    assert event_truth(recording()) is None


def test_unknown_pixels_of_masks_do_not_count() -> None:
    image = mask()
    image[:, 35:] = -1  # where all of the background's events are
    scored = figures(recording(masks=masks(image)), found(np.ones(8000, int)))
    assert scored["mask 40 Hz", "mask IoU"] == (1,) * 6
    assert scored["mask 40 Hz", "pixel accuracy"] == (1,) * 6


def test_masks_of_another_size_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r"made: mask \d+ has shape \(39, 60\), expected the sensor's \(40, 60\)"
    ):
        score_recording(recording(masks=masks(mask()[1:])), found(owners()))


def test_still_scenes() -> None:
    scored = figures(recording(labels=owners() * 0, scene="still"), found(owners()))
    assert scored["still", "events in moving labels"] == (0.5, 0.5)
    assert ("events", "moving IoU") not in scored
    assert ("owner boxes", "detection rate") not in scored


def test_flow_is_the_motion_of_the_labels() -> None:
    flow = np.full((HEIGHT, WIDTH, 2), np.nan)
    flow[:, :35] = [1.5, -3.0]  # of 30 and -60 px/s over 50 ms
    track = FlowTrack(np.array([10_000, 120_000]), np.array([60_000, 170_000]), lambda k: flow)
    right = figures(recording(flow=track), found(owners(), velocity=(30, -60)))
    np.testing.assert_allclose(right["flow", "end-point error, px"], [0, 0], atol=1e-3)
    wrong = figures(recording(flow=track), found(owners(), velocity=(30, 20)))
    np.testing.assert_allclose(wrong["flow", "end-point error, px"], [4, 4], atol=1e-3)
    assert wrong["flow", "3PE, %"] == (100, 100)
    lens = emseg.Camera(WIDTH, HEIGHT, fx=50, fy=50, cx=30, cy=20, distortion=(-0.1, 0, 0, 0))
    assert ("flow", "3PE, %") not in figures(replace(recording(flow=track), camera=lens), found(owners()))


def test_published_figures_have_a_source_and_a_protocol() -> None:
    assert len(PUBLISHED) == 3 + 1 + 6 * 5 + 5
    for figure in PUBLISHED:
        assert figure.source
        assert figure.protocol in PROTOCOLS
        assert 0 < figure.value < 1
    unconfirmed = {(f.dataset, f.method) for f in PUBLISHED if not f.confirmed}
    assert unconfirmed == {("eed", "EMSMC"), ("evimo", "EMSGC")}  # EMSGC's own figure
    assert {f.group for f in PUBLISHED if not f.confirmed} == {""}
    fast = [f for f in published_for("evimo") if f.group == "fast" and f.protocol == "mask 40 Hz"]
    assert {f.method: f.value for f in fast} == {
        "EMSGC": 0.43,
        "SpikeMS": 0.38,
        "Un-EVIMO": 0.44,
        "EVDodgeNet": 0.60,
        "EV-IMO network": 0.67,
        "Moving Border Ownership": 0.63,
    }


def test_ours_stand_before_the_published_and_skipped_are_counted() -> None:
    made = recording(masks=masks(mask()))
    scored = score_recording(made, found(owners()))
    first = [("table", figure) for figure in scored]
    second = [("box", replace(figure, values=(0.5, float("nan")))) for figure in scored]
    rows = merged_rows("evimo", [*first, *second])
    table = [row for row in rows if (row.protocol, row.name) == ("mask 40 Hz", "mask IoU")]
    ours = {row.group: (row.value, row.items, row.skipped) for row in table if row.method == OURS}
    assert ours == {"table": (1, 6, 0), "box": (0.5, 1, 1), "": (6.5 / 7, 7, 1)}
    of_table = [row.method for row in table if row.group == "table"]
    assert of_table[0] == OURS
    assert len(of_table) == 7
    text = text_table(rows)
    assert "TNNLS 2021 (arXiv 2012.08730): 76.81 %; not confirmed" in text
    assert text.count("not confirmed") == 1
    assert max(map(len, text.split("\nsources\n")[0].splitlines())) < 110  # what a terminal shows in a line
    # Nothing of ours stands beside what others found on "fast": it is not shown, only written.
    assert any(row.group == "fast" for row in rows)
    assert " fast " not in text
    assert "mask 40 Hz: moving mask at pixels with events, 40 Hz" in text
    assert "Sanket et al., EVDodgeNet, ICRA 2020" in text
    assert " 7 frames        1 " in text


def test_the_worst_windows_are_shown_first() -> None:
    labels = owners()
    labels[4000:] = 0
    views = extreme_views(recording(labels=owners()), found(labels), count=1)
    assert [view.score for view in views] == [0, 1]
    assert views[0].caption == "made, 100 to 200 ms: score 0.00"
    assert views[0].picture.dtype == np.uint8
    without = extreme_views(recording(), found(labels), count=1)
    assert all(np.isnan(view.score) for view in without)
    assert "0 to 100 ms: no truth" in without[0].caption  # the window with most that moves


SCENE = """
duration: 0.2
seed: 5
camera: {width: 96, height: 72, motion: {velocity: [0.6, 0, 0]}, fx: 90}
bodies:
- shape: {kind: rectangle, size: [9, 9]}
  motion: {position: [0, 0, 3], rotation: [0, 10, 0]}
- shape: {kind: ball, radius: 0.4}
  motion: {position: [0, 0, 2], velocity: [-1.2, 0.4, 0]}
"""


@pytest.fixture(scope="module")
def evimo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set in EV-IMO's layout, and a damaged recording beside it."""
    from emseg.simulation.evimo import write_evimo

    root = tmp_path_factory.mktemp("evimo")
    (root / "small.yaml").write_text(SCENE)
    write_evimo(root / "eval" / "table" / "seq_00.npz", emseg.simulate(root / "small.yaml"))
    return root


def test_the_engine_on_a_data_set(evimo: Path) -> None:
    dataset = open_dataset("evimo", evimo)
    seen = []
    found = evaluate_dataset(dataset, emseg.Config(), progress=lambda *what: seen.append(what))
    assert not found.failed
    (row,) = found.recordings
    assert row["events"] == len(dataset[0].events) == seen[-1][1] == seen[-1][2]
    assert found.about["settings"]["lambda_smooth"] == emseg.Config().lambda_smooth
    figures = {(row.protocol, row.name): row for row in found.rows if row.method == OURS and not row.group}
    assert figures["events", "moving IoU, oracle"].value > 0.5
    assert figures["mask 40 Hz", "mask IoU"].items >= 4
    part = evaluate_dataset(dataset, emseg.Config(), seconds=0.05)
    assert part.recordings[0]["seconds"] <= 0.05
    direct = segment_recording(dataset.load(0, span=(0, 0.05)), emseg.Config())
    assert part.recordings[0]["windows"] == len(direct.windows)


def test_the_command(evimo: Path, tmp_path: Path) -> None:
    run = CliRunner().invoke(app, ["evaluate", "evimo", "--root", str(evimo), "--out", str(tmp_path / "out")])
    assert run.exit_code == 0, run.output
    assert "EV-IMO network" in run.output
    assert "evimo, 1 recording, settings auto: " in run.output
    written = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert {"dataset", "version", "commit", "settings", "machine", "figures", "recordings"} <= set(written)
    with (tmp_path / "out" / "evaluation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(written["figures"])
    assert all(row["source"] for row in rows)
    page = (tmp_path / "out" / "evaluation.html").read_text()
    assert page.count("data:image/png;base64,") == min(4, written["recordings"][0]["windows"])
    assert "EMSGC" in page
    assert "http" not in page  # it shows without a network


def test_recordings_that_cannot_be_read_are_named(evimo: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    (root / "broken").mkdir(parents=True)
    (root / "broken" / "events.txt").write_text("0.1 5 5 1\n")
    (root / "broken" / "meta.txt").write_text("nothing")
    (root / "seq_00.npz").symlink_to(evimo / "eval" / "table" / "seq_00.npz")
    run = CliRunner().invoke(app, ["evaluate", "evimo", "--root", str(root), "--seconds", "0.05"])
    assert run.exit_code == 1
    assert "failed: broken:" in run.output
    assert "evimo, 1 recording," in run.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate"], "expected a data set and where it lies"),
        (["evaluate", "imagenet", "--root", "."], "no data set 'imagenet'"),
        (["evaluate", "evimo", "--root", "ROOT", "--preset", "none"], "none"),
        (["evaluate", "evimo", "--root", "ROOT", "--recording", "x"], "no recording of that name"),
    ],
)
def test_wrong_usage(arguments: list[str], message: str, evimo: Path) -> None:
    run = CliRunner().invoke(app, [str(evimo) if word == "ROOT" else word for word in arguments])
    assert run.exit_code == 2
    assert message in " ".join(run.output.replace("│", " ").split())


def test_the_list_of_data_sets() -> None:
    run = CliRunner().invoke(app, ["evaluate", "--list"])
    assert run.exit_code == 0
    assert "hkust-ems" in run.output
