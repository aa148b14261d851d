"""Settings, training from the command line, checkpoints, export, pictures and the comparison."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from nets_fixtures import random_batch, small_network, torch
from test_nets_slices import suite  # noqa: F401  (a fixture)
from typer.testing import CliRunner

from emseg.cli import app
from emseg.nets.build import build_networks
from emseg.nets.checkpoints import TrainedNetworks, load_networks, save_networks
from emseg.nets.comparison import Row, mask_figures, object_boxes, table_of
from emseg.nets.export import Deployed, export_torchscript
from emseg.nets.figures import DepthFigures, FlowFigures, MaskFigures
from emseg.nets.pictures import depth_picture, flow_picture, mask_picture, wheel_picture
from emseg.nets.settings import NetworkSettings, RunSettings
from emseg.yaml_files import ConfigError

RUN = """
network: {growth_rate: 4, final_map_size: 8, height: 65}
slices: {longest: 90}
training: {learning_rate: 3.0e-3, epochs: 2, batch_size: 2, seed: 1}
"""


def invoke(*arguments):
    return CliRunner().invoke(app, [str(each) for each in arguments])


@pytest.fixture(scope="module")
def trained(suite, tmp_path_factory) -> Path:  # noqa: F811
    """The folder of a short training."""
    folder = tmp_path_factory.mktemp("trained")
    (folder / "run.yaml").write_text(RUN)
    result = invoke(
        "nets", "train", suite, "--out", folder / "run", "--config", folder / "run.yaml", "--threads", 1
    )
    assert result.exit_code == 0, result.output
    return folder / "run"


# ---- settings ----------------------------------------------------------------------------------------------


def test_settings_go_to_yaml_and_back(tmp_path):
    chosen = RunSettings(network=small_network("edn"))
    path = tmp_path / "run.yaml"
    path.write_text(chosen.to_yaml())
    assert RunSettings.from_yaml(path) == chosen


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("network: {grow_rate: 4}", r"network\.grow_rate: unknown setting, did you mean 'growth_rate'\?"),
        ("training: {epochs: 0}", r"training\.epochs: .*greater than or equal to 1, found 0"),
        ("training: {zoom: [1.3, 1.1]}", "expected 1 ≤ low ≤ high ≤ 4"),
        ("network: {norm: layer}", r"network\.norm"),
    ],
)
def test_bad_settings_are_named(tmp_path, text, message):
    path = tmp_path / "run.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        RunSettings.from_yaml(path)


# ---- training ----------------------------------------------------------------------------------------------


def test_training_leaves_what_is_needed(trained):
    run = json.loads((trained / "run.json").read_text())
    assert run["seed"] == 1
    assert run["epochs"] == 2
    assert run["labels"] == "truth"
    assert 0 <= run["validation"]["mask/iou"] <= 1
    assert run["training_targets"] > run["validation_targets"] > 0
    assert (trained / "metrics.csv").exists()
    assert list((trained / "tensorboard").glob("events*"))
    networks = load_networks(trained / "best.safetensors")
    assert networks.threshold == run["threshold"]
    assert networks.settings.network.growth_rate == 4


def test_validation_loss_is_the_best_one_logged(trained):
    import csv

    with (trained / "metrics.csv").open() as file:
        logged = [
            float(line["validation/total"]) for line in csv.DictReader(file) if line["validation/total"]
        ]
    run = json.loads((trained / "run.json").read_text())
    assert run["validation_loss"] == pytest.approx(min(logged[:2]), rel=1e-6)


def test_training_is_taken_up_again(suite, trained, tmp_path):  # noqa: F811
    import shutil

    folder = tmp_path / "run"
    shutil.copytree(trained, folder)
    result = invoke(
        *("nets", "train", suite, "--out", folder, "--config", trained.parent / "run.yaml"),
        *("--set", "training.epochs=3", "--resume", "--threads", 1),
    )
    assert result.exit_code == 0, result.output
    assert "epoch 3 of 3" in result.output
    assert "epoch 2 of 3" not in result.output
    assert (folder / "metrics_1.csv").read_text() == (trained / "metrics.csv").read_text()


def test_the_engine_teaches(suite, tmp_path):  # noqa: F811
    (tmp_path / "run.yaml").write_text(RUN)
    result = invoke(
        *("nets", "train", suite, "--out", tmp_path / "run", "--config", tmp_path / "run.yaml"),
        *("--set", "training.epochs=1", "--labels", "engine", "--threads", 1),
    )
    assert result.exit_code == 0, result.output
    assert json.loads((tmp_path / "run/run.json").read_text())["labels"] == "engine"


def test_tuning_tries_and_keeps_the_best(suite, tmp_path):  # noqa: F811
    pytest.importorskip("optuna", reason="needs optuna: pip install 'emseg[nets]'")
    (tmp_path / "run.yaml").write_text(RUN)
    result = invoke(
        *("nets", "tune", suite, "--out", tmp_path / "tuned", "--config", tmp_path / "run.yaml"),
        *("--set", "training.epochs=1", "--trials", 2, "--threads", 1),
    )
    assert result.exit_code == 0, result.output
    best = RunSettings.from_yaml(tmp_path / "tuned/best.yaml")
    losses = [json.loads(path.read_text()) for path in sorted((tmp_path / "tuned").glob("trial_*/run.json"))]
    winner = min(losses, key=lambda run: run["validation_loss"])
    assert best.training.learning_rate == winner["settings"]["training"]["learning_rate"]


def test_evaluation_names_every_recording(suite, trained, tmp_path):  # noqa: F811
    out = tmp_path / "figures.json"
    checkpoint = trained / "best.safetensors"
    arguments = ("nets", "evaluate", suite, "--checkpoint", checkpoint, "--split", "validation", "--out", out)
    result = invoke(*arguments)
    assert result.exit_code == 0, result.output
    figures = json.loads(out.read_text())["figures"]
    assert set(figures) == {"roll_10003", "all"}
    # With one recording, all is that recording, and training saw the same.
    assert figures["all"] == figures["roll_10003"]
    run = json.loads((trained / "run.json").read_text())
    assert figures["all"]["mask/iou"] == pytest.approx(run["validation"]["mask/iou"], abs=1e-6)


def test_prediction_writes_arrays_and_pictures(suite, trained, tmp_path, caplog):  # noqa: F811
    recording = suite / "validation/roll_10003.npz"
    checkpoint = trained / "best.safetensors"
    result = invoke(
        "nets", "predict", recording, "--checkpoint", checkpoint, "--out", tmp_path, "--pictures", 1
    )
    assert result.exit_code == 0, result.output
    folder = tmp_path / "roll_10003"
    with np.load(folder / "predictions.npz") as found:
        n = len(found["t"])
        assert n > 0
        assert found["labels"].shape == found["depth"].shape == found["moving"].shape
        assert found["flow"].shape[:2] == (n, 2)
        threshold = load_networks(checkpoint).threshold
        assert np.array_equal(found["labels"] > 0, found["moving"] > np.float16(threshold)) or (
            np.mean((found["labels"] > 0) != (found["moving"] > threshold)) < 1e-3  # float16 rounds
        )
    assert len(list(folder.glob("*.png"))) == 1


def test_bad_usage_is_one_line(suite, trained, tmp_path):  # noqa: F811
    other = tmp_path / "x.safetensors"
    other.write_bytes(b"nothing")
    result = invoke("nets", "evaluate", suite, "--checkpoint", other)
    assert result.exit_code == 1
    assert "no safetensors file" in result.output
    result = invoke("nets", "train", suite, "--out", tmp_path, "--preset", "thesis/ecn-9")
    assert result.exit_code == 2
    assert "unknown preset 'thesis/ecn-9'" in " ".join(result.output.split())
    result = invoke("nets", "evaluate", suite, "--checkpoint", trained / "best.safetensors")
    assert result.exit_code == 1
    assert "no recordings for test" in result.output


# ---- checkpoints and export --------------------------------------------------------------------------------


@pytest.mark.parametrize("architecture", ["ecn", "redn"])
def test_a_checkpoint_gives_the_same_networks(architecture, tmp_path):
    chosen = small_network(architecture)
    networks = build_networks(chosen, seed=5).eval()
    path = tmp_path / "networks.safetensors"
    save_networks(path, TrainedNetworks(networks, RunSettings(network=chosen), 0.4, {"seed": 5}))
    again = load_networks(path)
    assert again.settings.network == chosen
    assert (again.threshold, again.about) == (0.4, {"seed": 5})
    batch = random_batch(chosen)
    with torch.inference_mode():
        ours, theirs = (pair(batch.target, batch.references) for pair in (networks, again.networks))
    assert torch.equal(ours[0][0], theirs[0][0])
    assert torch.equal(ours[1].maps[0], theirs[1].maps[0])


class Trap:
    """Leaves a trace when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (self.path, "w"))


def test_no_checkpoint_runs_code(suite, trained, tmp_path):  # noqa: F811
    import shutil

    trace = tmp_path / "trace"
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(pickle.dumps(Trap(str(trace))))
    with pytest.raises(ValueError, match="no safetensors file"):
        load_networks(bad)
    folder = tmp_path / "run"
    shutil.copytree(trained, folder)
    state = torch.load(folder / "last.ckpt", weights_only=True) | {"trap": Trap(str(trace))}
    torch.save(state, folder / "last.ckpt")
    result = invoke(
        *("nets", "train", suite, "--out", folder, "--config", trained.parent / "run.yaml"),
        *("--set", "training.epochs=3", "--resume", "--threads", 1),
    )
    assert result.exit_code != 0
    assert not trace.exists()


@pytest.mark.parametrize("architecture", ["ecn", "edn", "redn"])
@pytest.mark.filterwarnings("ignore:.torch.jit:DeprecationWarning")
def test_torchscript_agrees(architecture, tmp_path):
    chosen = small_network(architecture)
    networks = build_networks(chosen, seed=2).eval()
    trained = TrainedNetworks(networks, RunSettings(network=chosen), 0.5, {})
    path = tmp_path / "networks.pt"
    export_torchscript(trained, path, width=52, height=40)
    batch = random_batch(chosen, count=3)
    with torch.inference_mode():
        ours = Deployed(networks)(batch.target, batch.references)
        theirs = torch.jit.load(str(path))(batch.target, batch.references)
    for a, b in zip(ours, theirs, strict=True):
        assert torch.allclose(a, b, rtol=1e-4, atol=1e-5)


# ---- figures -----------------------------------------------------------------------------------------------


def test_mask_figures_by_hand():
    batch = random_batch(NetworkSettings(), size=(40, 52), count=1)
    mask = torch.full((1, 40, 52), -1)
    mask[0, 0, :6] = torch.tensor([0, 0, 0, 1, 2, 1])
    moving = torch.zeros(1, 1, 40, 52)
    moving[0, 0, 0, :6] = torch.tensor([0.1, 0.1, 0.9, 0.9, 0.9, 0.1])
    active = torch.ones_like(mask).bool()
    active[0, 0, 0] = False
    figures = MaskFigures()
    figures.update(moving, batch._replace(mask=mask, active=active))
    found = {name: float(value) for name, value in figures.compute(0.5).items()}
    assert found["iou"] == pytest.approx(2 / 4)
    assert found["dice"] == pytest.approx(4 / 6)
    assert found["accuracy"] == pytest.approx(3 / 5)
    assert found["iou_all_moving"] == pytest.approx(3 / 5)
    iou, dice, accuracy = mask_figures(
        mask[0].numpy(), (moving[0, 0] > 0.5).long().numpy(), active[0].numpy()
    )
    assert (iou, dice, accuracy) == pytest.approx((2 / 4, 4 / 6, 3 / 5))


def test_depth_and_flow_figures_of_the_truth_are_perfect():
    batch = random_batch(NetworkSettings())
    depth, flow = DepthFigures(), FlowFigures()
    assert depth.compute() == flow.compute() == {}
    depth.update(3 * batch.depth[:, None], batch)
    flow.update(batch.flow, batch)
    assert {name: float(value) for name, value in depth.compute().items()} == pytest.approx(
        {"abs_rel": 0, "rmse": 0, "delta_1": 1, "delta_2": 1, "delta_3": 1}, abs=1e-5
    )
    assert {name: float(value) for name, value in flow.compute().items()} == {"epe": 0, "3pe": 0}
    flow.reset()
    flow.update(batch.flow + torch.tensor([3.0, 4.0])[:, None, None], batch)
    assert float(flow.compute()["epe"]) == pytest.approx(5, rel=1e-5)
    assert float(flow.compute()["3pe"]) == 100


# ---- pictures ----------------------------------------------------------------------------------------------


def test_near_is_bright_and_unknown_is_tinted():
    picture = depth_picture(np.array([[1.0, 2.0, 8.0, 0.0]]), nearest=1, farthest=8)
    assert picture[0, :3, 0].tolist() == [255, 109, 0]  # linear in the inverse
    assert picture[0, 3].tolist() == [40, 40, 44]


def test_wheels_have_their_anchors():
    r = 0.5**0.5
    directions = {"right": (1, 0), "up": (0, -1), "left": (-1, 0), "down": (0, 1)}
    directions |= {
        "upper right": (r, -r),
        "upper left": (-r, -r),
        "lower right": (r, r),
        "lower left": (-r, r),
    }
    flow = np.array(list(directions.values()), np.float64).T[:, None]
    colours = dict(zip(directions, flow_picture(flow, most=1)[0].tolist(), strict=True))
    assert colours == {
        "right": [255, 0, 0],
        "up": [0, 255, 0],
        "left": [0, 0, 255],
        "down": [0, 255, 255],
        "upper right": [255, 0, 255],
        "upper left": [128, 0, 128],
        "lower right": [255, 165, 0],
        "lower left": [255, 255, 0],
    }
    still = np.zeros((2, 1, 1))
    assert flow_picture(still, most=1)[0, 0].tolist() == [0, 0, 0]
    assert flow_picture(still, wheel="middlebury", most=1)[0, 0].tolist() == [255, 255, 255]
    middlebury = flow_picture(flow, wheel="middlebury", most=1)[0]
    assert middlebury[0].tolist() == [255, 0, 0]  # right
    assert middlebury[2, 2] > 200  # left: between cyan and blue
    assert middlebury[3, 0] > 200  # down: yellow
    assert wheel_picture("middlebury", side=33).shape == (33, 33, 3)


def test_masks_are_coloured_where_active():
    labels = np.array([[0, 1, 2, -1]])
    picture = mask_picture(labels, np.array([[True, True, False, True]]))
    assert picture[0, 0].tolist() == [118, 118, 118]
    assert len({tuple(colour) for colour in picture[0].tolist()}) == 3  # the last two are dark


# ---- comparison --------------------------------------------------------------------------------------------


def test_boxes_of_labels_and_of_their_parts():
    labels = np.zeros((20, 30), np.int64)
    labels[2:8, 3:9] = 1
    labels[12:18, 20:26] = 1
    labels[0, 0] = 2  # too small
    assert object_boxes(labels, parts="whole").tolist() == [[3, 2, 23, 16]]
    assert object_boxes(labels, parts="connected").tolist() == [[3, 2, 6, 6], [20, 12, 6, 6]]


def test_tables_leave_out_what_is_not_defined():
    nan = float("nan")
    rows = [Row("a", 0, 0.5, 0.25, 0.4, 0.9, 1.0), Row("a", 1, nan, 0.75, 0.4, 0.9, nan)]
    table = table_of({"engine": rows}, {"engine": (12.3, 456.0)})
    assert "| engine | 50.0 | 50.0 | 40.0 | 90.0 | 100.0 | 12 | 456 |" in table
    assert "event_iou 1, mask_iou 0" in table


def test_the_comparison_runs_and_says_what_was_claimed(suite, trained, tmp_path):  # noqa: F811
    checkpoint = trained / "best.safetensors"
    arguments = ("compare", suite, "--split", "validation", "--checkpoint", checkpoint)
    result = invoke(*arguments, "--out", tmp_path, "--pictures", 1)
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "compare.json").read_text())
    methods = {each["method"]: each for each in content["methods"]}
    assert list(methods) == ["engine", "run", "all background", "all moving"]
    counts = {len(each["rows"]) for each in methods.values()}
    assert len(counts) == 1
    assert methods["all background"]["means"]["mask_iou"] == 0
    assert methods["all background"]["means"]["detection"] == 0
    assert methods["engine"]["means"]["event_iou"] > 0.3
    assert "76.81 %" in (tmp_path / "compare.md").read_text()
    assert "nothing in this table was measured on EV-IMO" in (tmp_path / "compare.md").read_text()
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 1
