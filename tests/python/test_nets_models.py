"""The networks: their sizes, shapes, norms, and that they learn."""

import hashlib
import itertools
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nets_fixtures import random_batch, small_network, torch

from emseg.nets import resnet
from emseg.nets.build import build_networks, parameter_count
from emseg.nets.edn import DispNetS, PoseExpNet
from emseg.nets.figures import predict
from emseg.nets.losses import total_loss
from emseg.nets.norms import FeatureDecorrelation, GroupNorm, make_norm, whiten
from emseg.nets.presets import PRESETS, REPORTED, preset
from emseg.nets.settings import LossSettings, NetworkSettings, RunSettings
from emseg.nets.training import SegmentationModule

ARCHITECTURES = ("ecn", "edn", "redn")
MAPS = ("none", "explainability", "pixel_pose", "mixture", "disparity")


def test_importing_emseg_imports_no_torch():
    light = "emseg, emseg.cli, emseg.nets.settings, emseg.nets.presets, emseg.nets.recordings"
    code = f"import {light}, sys; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def counts(**options):
    networks = build_networks(NetworkSettings(**options))
    return parameter_count(networks.depth), parameter_count(networks.pose)


def test_parameter_counts_of_ecn_are_the_originals():
    assert counts(init_planes=32, growth_rate=32, final_map_size=4, references=4) == (3_146_171, 806_776)
    assert sum(counts(growth_rate=8, final_map_size=8, references=4)) == 150_465
    assert sum(counts(growth_rate=4, final_map_size=8, references=2)) == 40_183


@pytest.mark.parametrize("norm", ["batch", "instance", "group", "decorrelation"])
def test_norms_have_as_many_parameters(norm):
    assert sum(counts(growth_rate=4, final_map_size=8, norm=norm)) == 40_183


def test_parameter_counts_of_edn_are_the_originals():
    def pose(maps):
        return parameter_count(PoseExpNet(NetworkSettings(architecture="edn", maps=maps)))

    assert parameter_count(DispNetS(NetworkSettings(architecture="edn"))) == 31_596_900
    assert [pose(maps) for maps in ("none", "explainability", "mixture")] == [1_590_668, 3_340_388, 3_347_800]


def test_parameter_count_of_the_resnet_trunk_is_resnet18s():
    assert parameter_count(resnet.ResNetTrunk(3)) == 683_072


@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("maps", MAPS)
def test_shapes_for_odd_sizes(architecture, maps):
    references, channels = (4, 1) if maps == "mixture" else (2, 3)
    chosen = small_network(architecture, maps=maps, references=references, in_channels=channels)
    networks = build_networks(chosen)
    h, w = 37, 51
    target, neighbours = torch.rand(2, channels, h, w), torch.rand(2, references, channels, h, w)
    disparities, output = networks.train()(target, neighbours)
    assert disparities[0].shape == (2, 1, h, w)
    assert len(disparities) > 1
    poses = references if maps in ("none", "explainability", "disparity") else 1
    assert output.poses.shape == (2, poses, 6)
    assert output.components.shape == (2, 4 if maps == "mixture" else 0, 6)
    width = {"none": None, "explainability": references, "pixel_pose": 6, "mixture": 4, "disparity": 1}[maps]
    for disparity, each in itertools.zip_longest(disparities, output.maps if width else disparities):
        assert disparity.shape[2:] == each.shape[2:]
        assert each.shape[1] == (width or 1)
    assert all(bool(((d > 0.01) & (d < 10.01)).all()) for d in disparities)
    with torch.inference_mode():
        finest, output = networks.eval()(target, neighbours)
    assert len(finest) == 1
    assert len(output.maps) == (width is not None)


@pytest.mark.parametrize("architecture", ARCHITECTURES)
def test_any_size_from_a_few_pixels_on(architecture):
    networks = build_networks(small_network(architecture)).eval()
    for h, w in ((9, 13), (64, 16), (130, 173)):
        disparities, output = networks(torch.rand(1, 3, h, w), torch.rand(1, 2, 3, h, w))
        assert disparities[0].shape == (1, 1, h, w)
        assert torch.isfinite(disparities[0]).all()
        assert torch.isfinite(output.maps[0]).all()


def test_a_mixture_shares_rotation_and_shares_add_up():
    networks = build_networks(small_network("ecn"))
    _, output = networks(torch.rand(2, 3, 40, 52), torch.rand(2, 2, 3, 40, 52))
    assert torch.equal(output.components[:, 0], output.poses[:, 0])
    assert torch.equal(output.components[..., 3:], output.components[:, :1, 3:].expand(-1, 4, -1))
    assert all(torch.allclose(maps.sum(1), torch.ones_like(maps[:, 0]), atol=1e-6) for maps in output.maps)


def test_levels_follow_the_map_size():
    def scales(final_map_size, scale_factor=0.5):
        chosen = NetworkSettings(growth_rate=2, final_map_size=final_map_size, scale_factor=scale_factor)
        images = torch.rand(1, 3, 260, 20)
        disparities = build_networks(chosen).depth.train()(images)
        return [d.shape[2] for d in disparities]

    assert scales(4) == [260, 130, 65, 32, 16, 8]  # and a last map of 4, below the coarsest prediction
    assert scales(8) == [260, 130, 65, 32, 16]
    assert scales(32, 0.75) == [260, 130, 97, 72, 54]  # the last map is 40 high: 30 would be too small


def test_settings_without_effect_are_named(caplog):
    build_networks(NetworkSettings(architecture="edn", maps="none", growth_rate=8, final_map_size=4))
    assert "growth_rate has no effect on edn" in caplog.text
    assert "final_map_size has no effect on edn" in caplog.text


def test_weights_depend_on_the_seed_alone():
    first, again, other = (build_networks(small_network("ecn"), seed=seed) for seed in (1, 1, 2))
    pairs = list(zip(first.parameters(), again.parameters(), strict=True))
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(first.depth.cascade.stem.weight, other.depth.cascade.stem.weight)


# ---- norms -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [16, 32, 48])
def test_group_norm_is_torchs_but_for_the_unbiased_variance(channels):
    x = 5 + 3 * torch.randn(2, channels, 6, 7, generator=torch.Generator().manual_seed(0))
    n = channels // 16 * 42
    theirs = torch.nn.functional.group_norm(x.double(), 16, eps=1e-5 * (n - 1) / n)
    ours = GroupNorm(channels).double()(x.double())
    assert torch.allclose(ours * (n / (n - 1)) ** 0.5, theirs, atol=1e-9)


def test_few_channels_are_normalised_each_by_itself():
    x = torch.randn(2, 5, 6, 7).double()
    assert torch.allclose(GroupNorm(5).double()(x), make_norm("instance", 5).double()(x))
    normalised = GroupNorm(5).double()(x)
    assert torch.allclose(normalised.var((2, 3)), torch.ones(2, 5).double(), atol=1e-4)


@pytest.mark.parametrize("norm", ["instance", "group", "decorrelation"])
def test_a_map_of_one_pixel_stays_finite(norm):
    assert torch.isfinite(make_norm(norm, 20)(torch.randn(2, 20, 1, 1))).all()


@given(st.integers(0, 2**31), st.floats(0.5, 2))
@settings(max_examples=20, deadline=None)
def test_whitened_rows_have_the_identity_as_covariance(seed, spread):
    generator = torch.Generator().manual_seed(seed)
    mixing = torch.eye(16).double() + 0.05 * torch.randn(16, 16, generator=generator).double()
    rows = spread * mixing @ torch.randn(3, 16, 2000, generator=generator).double()
    rows = rows - rows.mean(2, keepdim=True)
    white = whiten(rows)
    covariance = white @ white.transpose(1, 2) / 2000
    # ε I is part of what is inverted: it is missing from the result's covariance.
    assert torch.allclose(covariance, torch.eye(16).double().expand(3, -1, -1), atol=1e-5 + 4e-5 / spread**2)


@pytest.mark.parametrize("channels", [8, 16, 32])
def test_decorrelation_whitens_the_super_channels(channels):
    x = 2 + torch.randn(2, channels, 30, 40, generator=torch.Generator().manual_seed(1)).double()
    y = FeatureDecorrelation(channels)(x).double()
    groups = min(16, channels)
    rows = y.view(2, -1, groups, 1200).transpose(1, 2).reshape(2, groups, -1)
    covariance = rows @ rows.transpose(1, 2) / rows.shape[2]
    assert torch.allclose(covariance, torch.eye(groups).double().expand(2, -1, -1), atol=1e-4)
    assert rows.mean(2).abs().max() < 1e-5


# ---- learning ----------------------------------------------------------------------------------------------

# Heads whose predictions no loss depends on: a disparity of the pose network is not supervised.
CASES = [
    *((architecture, "mixture") for architecture in ARCHITECTURES),
    *((architecture, "explainability") for architecture in ARCHITECTURES),
    ("ecn", "pixel_pose"),
]


@pytest.mark.parametrize(("architecture", "maps"), CASES)
def test_gradients_reach_every_parameter(architecture, maps):
    chosen = small_network(architecture, maps=maps)
    networks = build_networks(chosen).train()
    batch = random_batch(chosen, size=(72, 80) if architecture == "edn" else (40, 52))
    disparities, output = networks(batch.target, batch.references)
    total_loss(disparities, output, batch, chosen, LossSettings()).total.backward()
    without = [
        name
        for name, parameter in networks.named_parameters()
        if parameter.grad is None or not bool(parameter.grad.abs().sum() > 0)
    ]
    assert without == []
    assert all(torch.isfinite(parameter.grad).all() for parameter in networks.parameters())


@pytest.mark.parametrize(
    ("architecture", "rate", "steps"), [("ecn", 1e-2, 60), ("edn", 1e-3, 50), ("redn", 1e-3, 40)]
)
def test_one_batch_is_learnt_by_heart(architecture, rate, steps):
    chosen = small_network(architecture)
    networks = build_networks(chosen).train()
    batch = random_batch(chosen)
    optimiser = torch.optim.Adam(networks.parameters(), lr=rate, fused=True)
    weights = LossSettings(photometric=0, smoothness=0)
    losses = []
    for _ in range(steps):
        disparities, output = networks(batch.target, batch.references)
        loss = total_loss(disparities, output, batch, chosen, weights)
        optimiser.zero_grad()
        loss.total.backward()
        optimiser.step()
        losses.append(loss.total.item())
    assert losses[-1] < 0.5 * losses[0]
    # In training mode: batch statistics of two images are not yet those that running means have reached.
    moving = 1 - output.maps[0][:, 0]
    truth = batch.mask > 0
    hit = ((moving > 0.5) & truth).sum() / ((moving > 0.5) | truth).sum()
    assert hit > 0.8


@pytest.mark.parametrize("norm", ["batch", "group", "decorrelation"])
def test_half_precision_is_near_single(norm):
    chosen = small_network("ecn", norm=norm)
    module = SegmentationModule(build_networks(chosen), RunSettings(network=chosen))
    batch = random_batch(chosen)
    single, _, _ = module.losses(batch)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        half, disparities, output = module.losses(batch)
    assert {each.dtype for each in (*disparities, *output.maps, output.poses, half.total)} == {torch.float32}
    assert half.total.item() == pytest.approx(single.total.item(), rel=0.05)
    half.total.backward()
    assert all(torch.isfinite(each.grad).all() for each in module.networks.parameters())


def test_prediction_needs_no_training_mode():
    chosen = small_network("ecn")
    prediction = predict(build_networks(chosen).eval(), random_batch(chosen))
    assert prediction.moving.shape == (2, 1, 40, 52)
    assert prediction.flow.shape == prediction.ego_flow.shape == (2, 2, 40, 52)


# ---- weights of ResNet18 -----------------------------------------------------------------------------------


def made_weights():
    generator = torch.Generator().manual_seed(3)
    state = resnet.ResNetTrunk(3).state_dict()
    return {
        name: torch.rand(value.shape, generator=generator) if value.is_floating_point() else value
        for name, value in state.items()
    } | {"fc.weight": torch.zeros(1000, 512)}


def test_given_weights_are_frozen_but_for_a_tiled_first_convolution():
    weights = made_weights()
    networks = build_networks(small_network("redn"), resnet_weights=weights).train()
    depth, pose = networks.depth.trunk, networks.pose.trunk
    assert not any(parameter.requires_grad for parameter in depth.parameters())
    trained = [name for name, parameter in pose.named_parameters() if parameter.requires_grad]
    assert trained == ["conv1.weight"]
    assert torch.equal(depth.layer1[0].conv1.weight, weights["layer1.0.conv1.weight"])
    before = depth.bn1.running_mean.clone()
    image = torch.rand(1, 3, 40, 52)
    # Three frames alike are seen as the frame itself.
    alike = image.repeat(1, 3, 1, 1)
    assert torch.allclose(pose.conv1(alike), depth.conv1(image), rtol=1e-4, atol=1e-4)
    depth(image)
    assert torch.equal(depth.bn1.running_mean, before)


def test_without_weights_everything_trains_and_it_is_said(caplog):
    networks = build_networks(small_network("redn"))
    assert all(parameter.requires_grad for parameter in networks.parameters())
    assert "from scratch" in caplog.text


def test_weights_are_known_by_their_checksum(tmp_path: Path, monkeypatch):
    path = tmp_path / "resnet18.pth"
    torch.save(made_weights(), path)
    with pytest.raises(
        ValueError, match=r"SHA-256 begins \w{8}, expected a ResNet18 of torchvision: f37072fd"
    ):
        resnet.read_weights(path)
    monkeypatch.setattr(resnet, "KNOWN_WEIGHTS", (hashlib.sha256(path.read_bytes()).hexdigest()[:8],))
    assert "layer2.1.conv2.weight" in resnet.read_weights(path)


def test_weights_for_others_are_refused():
    with pytest.raises(ValueError, match="expected redn"):
        build_networks(small_network("ecn"), resnet_weights=made_weights())
    with pytest.raises(ValueError, match=r"weights lack bn1\.bias, expected those of torchvision"):
        build_networks(small_network("redn"), resnet_weights={"conv1.weight": torch.zeros(64, 3, 7, 7)})


# ---- presets -----------------------------------------------------------------------------------------------


def test_presets_are_the_eight_runs():
    rows = {
        name: (
            run.network.architecture,
            run.training.learning_rate,
            run.training.epochs,
            run.training.batch_size,
            run.network.growth_rate,
            run.network.final_map_size,
        )
        for name, run in PRESETS.items()
    }
    assert rows == {
        "thesis/ecn-1": ("ecn", 5e-5, 100, 15, 8, 4),
        "thesis/ecn-2": ("ecn", 1e-3, 30, 32, 4, 8),
        "thesis/ecn-3": ("ecn", 1e-5, 500, 32, 4, 8),
        "thesis/edn-1": ("edn", 5e-4, 30, 32, 4, 8),
        "thesis/edn-2": ("edn", 5e-5, 30, 15, 8, 4),
        "thesis/edn-3": ("edn", 1e-5, 30, 20, 8, 4),
        "thesis/redn-1": ("redn", 1e-2, 50, 32, 4, 8),
        "thesis/redn-2": ("redn", 1e-5, 50, 25, 8, 4),
    }
    assert set(REPORTED) == set(PRESETS)
    with pytest.raises(ValueError, match="unknown preset 'ecn'"):
        preset("ecn")
