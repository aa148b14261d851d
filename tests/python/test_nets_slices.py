"""Event slices against NumPy; datasets, augmentation and splits."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from nets_fixtures import random_batch, small_network, torch

import emseg
from emseg.nets.augmentation import augmented, flipped, zoomed
from emseg.nets.geometry import instantaneous_flow
from emseg.nets.losses import Batch
from emseg.nets.recordings import SimulatedRecording, find_recordings, split_by_name
from emseg.nets.settings import NetworkSettings, SliceSettings, TrainingSettings
from emseg.nets.slices import (
    SizedBatches,
    SliceDataset,
    as_channels,
    event_slices,
    reference_steps,
    shrunk_intrinsics,
)
from emseg.nets.teacher import EngineLabels, label_image
from emseg.simulation import simulate
from emseg.simulation.suite import suite_scene

SLICES = SliceSettings(longest=90)
NETWORK = small_network("ecn")


@pytest.fixture(scope="module")
def suite(tmp_path_factory) -> Path:
    """Two recordings of different sensors to learn from, one to validate with."""
    folder = tmp_path_factory.mktemp("suite")
    for name, seed, split in (("roll", 1, "train"), ("strobe", 1, "train"), ("roll", 10_003, "validation")):
        (folder / split).mkdir(exist_ok=True)
        simulate(suite_scene(name, seed, duration=0.15)).save(folder / split / f"{name}_{seed:05d}.npz")
    return folder


# ---- slices ------------------------------------------------------------------------------------------------


def slices_by_numpy(events, times, width_us, shrink):
    """Plain NumPy, pixel by pixel sums with np.add.at."""
    h, w = events.height // shrink, events.width // shrink
    images = np.zeros((len(times), 3, h, w), np.uint8)
    for image, time in zip(images, times, strict=True):
        start = time - width_us // 2
        inside = (events.t >= start) & (events.t < start + width_us)
        x, y = events.x[inside] // shrink, events.y[inside] // shrink
        p, t = events.p[inside], events.t[inside]
        on = (x < w) & (y < h)
        x, y, p, t = x[on], y[on], p[on], t[on]
        counts = np.zeros((2, h, w))
        np.add.at(counts, (p.astype(int), y, x), 1)
        total = np.zeros((h, w))
        np.add.at(total, (y, x), (t - start) / width_us)
        both = counts.sum(0)
        mean = np.divide(total, both, out=np.zeros((h, w)), where=both > 0)
        image[:] = [
            np.minimum(255, 50 * counts[1]),
            np.floor(255 * mean + 0.5 + 1e-9),
            np.minimum(255, 50 * counts[0]),
        ]
    return images


@st.composite
def small_recordings(draw):
    width, height = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    n = draw(st.integers(0, 80))
    x = draw(hnp.arrays(np.uint16, n, elements=st.integers(0, width - 1)))
    y = draw(hnp.arrays(np.uint16, n, elements=st.integers(0, height - 1)))
    t = np.sort(draw(hnp.arrays(np.int64, n, elements=st.integers(-500, 500))))
    p = draw(hnp.arrays(np.uint8, n, elements=st.integers(0, 1)))
    return emseg.EventArray(x, y, t, p, width=width, height=height)


@given(small_recordings(), st.lists(st.integers(-600, 600), max_size=4), st.integers(1, 400), st.data())
@settings(deadline=None)
def test_slices_equal_numpys(events, times, width_us, data):
    shrink = data.draw(st.integers(1, min(events.width, events.height)))
    times = np.array(times, np.int64)
    ours = emseg._core.event_slices(
        events.x, events.y, events.t, events.p, events.width, events.height, times, width_us, shrink
    )
    theirs = slices_by_numpy(events, times, width_us, shrink)
    assert ours.shape == theirs.shape
    difference = ours.astype(int) - theirs
    assert not difference[:, [0, 2]].any()
    assert np.abs(difference[:, 1]).max(initial=0) <= 1  # a mean at half a step may round either way


def test_slices_of_a_recording_equal_numpys(suite):
    events = SimulatedRecording(suite / "train/roll_00001.npz").events
    times = np.array([40_000, 75_000], np.int64)
    for longest, shrink in ((346, 1), (100, 3)):
        chosen = SliceSettings(longest=longest)
        assert chosen.shrink(events.width, events.height) == shrink
        ours = event_slices(events, times, chosen).astype(int)
        assert ours.max() == 255
        assert np.abs(ours - slices_by_numpy(events, times, 50_000, shrink)).max() <= 1


def test_one_channel_counts_all_events():
    image = np.array([[[[50]], [[130]], [[100]]], [[[255]], [[10]], [[50]]]], np.uint8)
    assert torch.allclose(as_channels(image, 1).flatten(), torch.tensor([150 / 255, 1.0]))
    assert as_channels(image, 3).shape == (2, 3, 1, 1)


def test_references_lie_on_both_sides():
    assert reference_steps(2) == [-1, 1]
    assert reference_steps(4) == [-2, -1, 1, 2]
    assert reference_steps(1) == [1]


def test_shrunk_intrinsics_keep_the_corner_of_the_image():
    K = np.array([[100.0, 0, 49.5], [0, 90, 29.5], [0, 0, 1]])  # the centre of 100x60
    small = shrunk_intrinsics(K, 4)
    assert np.allclose(small, [[25, 0, 12], [0, 22.5, 7], [0, 0, 1]])  # that of 25x15


# ---- datasets ----------------------------------------------------------------------------------------------


def test_a_target_is_what_the_recording_says(suite):
    recording = SimulatedRecording(suite / "train/roll_00001.npz")
    dataset = SliceDataset([recording], SLICES, NETWORK)
    name, time = dataset.origin(1)
    assert name == "roll_00001"
    moment = recording.times.tolist().index(time)
    item = dataset[1]
    s = SLICES.shrink(recording.events.width, recording.events.height)
    h, w = recording.events.height // s, recording.events.width // s
    assert item.target.shape == (3, h, w)
    assert item.references.shape == (2, 3, h, w)
    images = event_slices(recording.events, time + np.array([0, -25_000, 25_000]), SLICES)
    assert torch.equal(item.target, torch.from_numpy(images[0]) / 255)
    assert torch.equal(item.references, torch.from_numpy(images[1:]) / 255)
    assert item.offsets.tolist() == [-0.5, 0.5]
    assert np.array_equal(item.mask.numpy(), recording.mask(moment)[s // 2 :: s, s // 2 :: s][:h, :w])
    assert np.array_equal(item.active.numpy(), images[0].any(axis=0))
    # Flow over a slice of 50 ms, of which the simulator gives 10.
    flow = recording.flow(moment)[:, s // 2 :: s, s // 2 :: s][:, :h, :w] * 0.05 / s
    known = np.isfinite(flow)
    assert np.allclose(item.flow.numpy()[known], flow[known], rtol=2e-3, atol=1e-3)
    assert torch.isfinite(item.poses).all()


def test_targets_keep_their_distance_and_have_whole_slices(suite):
    recording = SimulatedRecording(suite / "train/roll_00001.npz")
    dataset = SliceDataset([recording], SLICES, NETWORK)
    times = [dataset.origin(k)[1] for k in range(len(dataset))]
    assert min(times) >= 25_000 + 25_000
    assert max(times) <= recording.times[-1] - 50_000
    assert np.diff(times).min() >= 25_000
    with pytest.raises(ValueError, match="no target"):
        SliceDataset([recording], SliceSettings(width=1.0), NETWORK)


def test_batches_have_one_size_each(suite):
    dataset = SliceDataset(find_recordings(suite, "train"), SLICES, NETWORK)
    assert len({dataset.size(k) for k in range(len(dataset))}) == 2
    torch.manual_seed(0)
    for order in ("random", "given"):
        batches = SizedBatches(dataset, 2, order=order)
        drawn = list(batches)
        assert len(drawn) == len(batches)
        assert sorted(itertools.chain.from_iterable(drawn)) == list(range(len(dataset)))
        assert all(len({dataset.size(k) for k in batch}) == 1 for batch in drawn)


def test_splits_are_by_sequence(suite, tmp_path):
    assert [each.name for each in find_recordings(suite, "train")] == ["roll_00001", "strobe_00001"]
    with pytest.raises(ValueError, match="no recordings for test"):
        find_recordings(suite, "test")
    names = [f"sequence_{k}" for k in range(2000)]
    shares = [
        sum(split_by_name(name) == split for name in names) for split in ("train", "validation", "test")
    ]
    assert shares == pytest.approx([1600, 200, 200], abs=60)


def test_files_of_other_simulators_may_lack_flow(suite, tmp_path):
    with np.load(suite / "train/roll_00001.npz") as archive:
        arrays = {key: archive[key] for key in archive.files if key not in ("gt_flow", "D")}
    np.savez(tmp_path / "other.npz", **arrays)
    (recording,) = find_recordings(tmp_path, "all")
    item = SliceDataset([recording], SLICES, NETWORK)[0]
    assert torch.isnan(item.flow).all()
    assert item.depth.any()


def test_a_file_that_is_no_simulation_is_refused(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, x=np.zeros(1))
    with pytest.raises(ValueError, match=r"x\.npz: lacks y, expected a recording"):
        _ = SimulatedRecording(path).events


# ---- the engine as teacher ---------------------------------------------------------------------------------


def test_label_image_is_the_majority_without_noise():
    x = np.array([0, 0, 0, 1, 1, 2], np.uint16)
    events = emseg.EventArray(
        x, np.zeros(6, np.uint16), np.arange(6), np.ones(6, np.uint8), width=4, height=1
    )
    labels = np.array([2, 0, 2, -1, 0, -1])
    assert label_image(events, labels).tolist() == [[2, 0, -1, -1]]


def test_the_teacher_knows_nothing_but_the_engines_labels(suite):
    recording = SimulatedRecording(suite / "train/roll_00001.npz")
    teacher = EngineLabels(recording, width=SLICES.width, believed=1.0)
    mask = teacher.mask(5)
    assert mask.shape == (recording.events.height, recording.events.width)
    assert (mask == 0).any()
    assert (mask > 0).any()
    share = np.count_nonzero(mask > 0) / np.count_nonzero(mask >= 0)
    doubted = EngineLabels(recording, width=SLICES.width, believed=share - 0.01)
    assert (doubted.mask(5) == -1).all()
    item = SliceDataset([teacher], SLICES, NETWORK)[0]
    assert set(item.mask.unique().tolist()) > {-1}
    assert not item.depth.any()
    assert torch.isnan(item.poses).all()
    assert torch.isnan(item.flow).all()
    with pytest.raises(ValueError, match="no target"):
        SliceDataset([EngineLabels(recording, width=0.05, believed=0)], SLICES, NETWORK, without_mask="drop")


# ---- augmentation ------------------------------------------------------------------------------------------


def one_target() -> Batch:
    """A target whose flow follows from its depth and pose."""
    batch = random_batch(NetworkSettings(), count=1)
    pose = torch.tensor([[0.03, -0.02, 0.05, 0.01, 0.02, -0.03]])
    flow = instantaneous_flow(batch.depth[:, None], pose, batch.K)
    batch = batch._replace(flow=flow, poses=pose[:, None].expand(-1, 2, -1))
    return Batch(*(part[0] for part in batch))


def flow_again(item: Batch) -> torch.Tensor:
    return instantaneous_flow(item.depth[None, None], item.poses[:1], item.K[None])[0]


def test_a_mirror_image_is_a_scene_of_its_own():
    item = one_target()
    mirrored = flipped(item)
    assert torch.allclose(flow_again(mirrored), mirrored.flow, atol=1e-4)
    assert mirrored.K[0, 2] == item.target.shape[2] - 1 - item.K[0, 2]
    again = flipped(mirrored)
    assert all(torch.equal(a, b) for a, b in zip(again, item, strict=True))


def test_a_zoomed_image_is_a_scene_of_its_own():
    item = one_target()
    h, w = item.mask.shape
    large = zoomed(item, (2 * h, 3 * w), (11, 17))
    # Depth comes from the nearest pixel: compare where the neighbours have the same.
    assert torch.allclose(flow_again(large).mean(), large.flow.mean(), rtol=0.02)
    shift = item.K.clone()
    assert large.K[0, 0] == 3 * shift[0, 0]
    assert large.K[1, 1] == 2 * shift[1, 1]
    y, x = 20, 30
    assert large.mask[y, x] == item.mask[(y + 11) // 2, (x + 17) // 3]
    assert torch.allclose(
        large.flow[:, y, x], item.flow[:, (y + 11) // 2, (x + 17) // 3] * torch.tensor([3.0, 2.0])
    )
    # A pixel's ray stays its own.
    ray = (x - large.K[0, 2]) / large.K[0, 0]
    assert float(ray) == pytest.approx(
        float(((x + 17 + 0.5) / 3 - 0.5 - shift[0, 2]) / shift[0, 0]), abs=1e-5
    )


def test_augmentation_keeps_sizes_and_kinds():
    item = one_target()
    torch.manual_seed(5)
    seen = set()
    for _ in range(12):
        changed = augmented(item, TrainingSettings())
        assert [part.shape for part in changed] == [part.shape for part in item]
        assert [part.dtype for part in changed] == [part.dtype for part in item]
        assert set(changed.mask.unique().tolist()) <= {0, 1}
        seen.add(tuple(changed.K.flatten().tolist()))
    assert len(seen) == 12
    still = augmented(item, TrainingSettings(flip=0, zoom=(1, 1)))
    assert all(torch.equal(a, b) for a, b in zip(still, item, strict=True))
