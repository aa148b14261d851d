"""The bundled recordings: whole, as made, and true to the geometry they claim."""

from pathlib import Path

import numpy as np
import pytest

from emseg import _core
from emseg.datasets import bundled, made_scene

SHARED_RECORDING = Path(__file__).parents[3] / "shared" / "data" / "real" / "cars_davis346.aedat4"


def load(name):
    with np.load(bundled()[name]) as file:
        return dict(file)


@pytest.fixture(scope="module")
def scene():
    return load("made_scene")


@pytest.mark.parametrize(("name", "width", "height"), [("cars", 346, 260), ("made_scene", 240, 180)])
def test_bundled_events_pass_the_door(name, width, height):
    events = load(name)
    assert (events["width"], events["height"]) == (width, height)
    _core.check_events(*(events[k] for k in "xytp"), width=width, height=height)
    assert set(np.unique(events["p"])) == {0, 1}


def test_bundled_recordings_keep_their_licence_beside_them():
    notice = bundled()["cars"].with_suffix(".LICENSE").read_text()
    assert "Permission is hereby granted" in notice
    assert "International Centre for Neuromorphic Systems" in notice


def test_cars_are_the_events_of_the_recording():
    dv = pytest.importorskip("dv_processing")
    if not SHARED_RECORDING.exists():
        pytest.skip(f"no recording at {SHARED_RECORDING}")
    reader = dv.io.MonoCameraRecording(str(SHARED_RECORDING))
    batches = []
    while reader.isRunning():
        if (batch := reader.getNextEventBatch()) is not None:
            batches.append(batch.numpy())
    original = np.concatenate(batches)
    events = load("cars")
    assert len(original) == 78_830
    for ours, theirs in zip("xytp", ("x", "y", "timestamp", "polarity"), strict=True):
        np.testing.assert_array_equal(events[ours], original[theirs])


def test_made_scene_is_reproduced_exactly(scene):
    again = made_scene.make()
    assert again.keys() == scene.keys()
    for key, column in again.items():
        assert column.dtype == scene[key].dtype
        np.testing.assert_array_equal(column, scene[key])


def test_truth_agrees_with_the_outlines(scene):
    """Objects' events lie on the objects, background's beside them, where the outlines are by arithmetic."""
    x, y, seconds = scene["x"].astype(float), scene["y"].astype(float), scene["t"] / 1e6
    _, disc, box = made_scene.SURFACES

    def from_pivot(surface):
        offset = (x - surface.pivot[0]) + 1j * (y - surface.pivot[1]) - complex(*surface.velocity) * seconds
        return offset * np.exp(-1j * surface.turn * seconds)

    to_disc, to_box = from_pivot(disc), from_pivot(box)
    disc_distance = np.abs(to_disc) - 23
    box_distance = np.maximum(np.abs(to_box.real) - 24, np.abs(to_box.imag) - 17)
    slack = 1.0  # half a pixel of soft edge, and the motion within one millisecond
    label = scene["label"]
    assert (disc_distance[label == 1] < slack).all()
    assert (box_distance[label == 1] > -slack).all()  # the box is in front
    assert (box_distance[label == 2] < slack).all()
    assert (disc_distance[label == 0] > -slack).all()
    assert (box_distance[label == 0] > -slack).all()
    assert all((label == k).sum() > 9_000 for k in range(3))


@pytest.mark.parametrize("label", [0, 1, 2])
@pytest.mark.parametrize("start_us", [0, 180_000, 365_000])
def test_each_label_is_sharpest_under_its_own_motion(scene, start_us, label):
    """Warped by their surface's motion, events fall on fewer pixels than by one 40 px/s off, or another's."""
    chosen = (scene["t"] >= start_us) & (scene["t"] < start_us + 30_000) & (scene["label"] == label)
    position = scene["x"][chosen] + 1j * scene["y"][chosen]
    seconds, reference = scene["t"][chosen] / 1e6, (start_us + 15_000) / 1e6

    def sharpness(surface, velocity_error=0):
        pivot, velocity = complex(*surface.pivot), complex(*surface.velocity) + velocity_error
        offset = position - pivot - velocity * seconds
        warped = pivot + velocity * reference + offset * np.exp(1j * surface.turn * (reference - seconds))
        pixel = np.rint(warped.real) * 1000 + np.rint(warped.imag)
        counts = np.unique(pixel, return_counts=True)[1]
        return (counts**2).sum() / counts.sum()

    own = made_scene.SURFACES[label]
    wrong = [sharpness(surface) for surface in made_scene.SURFACES if surface is not own]
    wrong += [sharpness(own, 40 * direction) for direction in (1, 1j, -1, -1j)]
    assert sharpness(own) > max(wrong)


def test_noise_is_as_frequent_as_promised(scene):
    assert (scene["label"] == -1).sum() == round(0.1 * 240 * 180 * 0.4)  # rate, pixels, seconds


def test_another_seed_makes_another_scene(monkeypatch):
    monkeypatch.setattr(made_scene, "DURATION_US", 10_000)
    first, second = made_scene.make(), made_scene.make(seed=1)
    assert not np.array_equal(first["t"], second["t"])
