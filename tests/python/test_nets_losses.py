"""Losses, warping and flow, against the simulator's truth and plain formulas."""

import numpy as np
import pytest
from nets_fixtures import random_batch, small_network, torch
from scipy.spatial.transform import Rotation

from emseg.nets.geometry import (
    ego_pose,
    instances,
    instantaneous_flow,
    inverse_warp,
    moving_probability,
    pixel_grid,
    pixel_pose,
    rigid_flow,
    scaled_intrinsics,
)
from emseg.nets.losses import (
    depth_loss,
    even_pose_loss,
    mask_loss,
    photometric_loss,
    pose_distance,
    smoothness_loss,
    total_loss,
    total_variation,
)
from emseg.nets.outputs import PoseOutput, depth_at
from emseg.nets.settings import LossSettings, NetworkSettings
from emseg.nets.slices import relative_poses
from emseg.simulation import simulate
from emseg.simulation.scene import Scene

SCENE = {
    "seed": 3,
    "duration": 0.06,
    "camera": {
        "width": 120,
        "height": 90,
        "fx": 100.0,
        "fy": 105.0,
        "motion": {"velocity": [1.2, -0.6, 0.9], "spin": [12.0, -18.0, 15.0]},
    },
    "bodies": [
        {
            "name": "wall",
            "parts": [
                {
                    "name": "plane",
                    "shape": {"kind": "rectangle", "size": [8.0, 8.0]},
                    "texture": {"kind": "clouds", "grain": 0.5},
                }
            ],
            "motion": {"position": [0.0, 0.0, 2.0], "rotation": [0.0, 25.0, 0.0]},
        },
    ],
}


@pytest.fixture(scope="module")
def truth():
    return simulate(Scene.model_validate(SCENE)).truth


@pytest.fixture(scope="module")
def K():
    camera = simulate(Scene.model_validate(SCENE), truth="poses").camera
    return torch.tensor(camera.K, dtype=torch.float32)[None]


def as_map(image):
    return torch.from_numpy(np.ascontiguousarray(image, np.float32))[None, None]


def camera_pose(truth, target, other):
    pose = relative_poses(truth.T_world_camera, truth.t, target, truth.t[[other]])
    return torch.tensor(pose, dtype=torch.float32)


# ---- geometry ----------------------------------------------------------------------------------------------


def test_relative_poses_are_those_of_the_matrices(truth):
    a, b = truth.T_world_camera[[1, 4]]
    relative = np.linalg.inv(a) @ b
    pose = camera_pose(truth, 1, 4)[0].double().numpy()
    assert np.allclose(pose[:3], relative[:3, 3], atol=1e-6)
    assert np.allclose(Rotation.from_rotvec(pose[3:]).as_matrix(), relative[:3, :3], atol=1e-6)


def test_flow_from_true_depth_and_pose_is_the_simulators(truth, K):
    """The simulator promises its flow to 0.01 px (docs/simulation.md)."""
    for moment in (0, 3):
        flow = rigid_flow(as_map(truth.depth[moment]), camera_pose(truth, moment, moment + 1), K)
        error = np.abs(flow[0].numpy() - truth.flow[moment])
        assert np.abs(truth.flow[moment]).max() > 0.3
        assert error.max() < 0.01


def test_instantaneous_flow_is_the_limit_of_small_motions(truth, K):
    depth, pose = as_map(truth.depth[2]), camera_pose(truth, 2, 5)
    exact = [rigid_flow(depth.double(), (share * pose).double(), K.double()) / share for share in (1, 1e-4)]
    linear = instantaneous_flow(depth.double(), pose.double(), K.double())
    assert (linear - exact[0]).abs().max() > 1e-2
    assert (linear - exact[1]).abs().max() < 1e-3


def test_an_objects_flow_follows_from_its_own_pose():
    """Relative to an object that moves, the camera moves the other way."""
    moving = {
        **SCENE,
        "bodies": [
            *SCENE["bodies"],
            {
                "name": "board",
                "label": 1,
                "parts": [{"name": "plane", "shape": {"kind": "rectangle", "size": [0.4, 0.4]}}],
                "motion": {
                    "position": [0.0, 0.0, 1.0],
                    "velocity": [-0.8, 0.5, 0.1],
                    "spin": [0.0, 0.0, 30.0],
                },
            },
        ],
    }
    simulation = simulate(Scene.model_validate(moving))
    truth = simulation.truth
    cameras, boards = truth.T_world_camera[[2, 3]], truth.T_world_object[[2, 3], 0]
    # The camera as the board sees it, before and after.
    before, after = (np.linalg.inv(board) @ camera for board, camera in zip(boards, cameras, strict=True))
    relative = np.linalg.inv(before) @ after
    pose = np.concatenate([relative[:3, 3], Rotation.from_matrix(relative[:3, :3]).as_rotvec()])
    mask = torch.from_numpy(truth.mask[2] == 1)
    assert mask.sum() > 500
    poses = torch.where(
        mask,
        torch.tensor(pose, dtype=torch.float32)[:, None, None],
        camera_pose(truth, 2, 3)[0][:, None, None],
    )[None]
    K = torch.tensor(simulation.camera.K, dtype=torch.float32)[None]
    flow = rigid_flow(as_map(truth.depth[2]), poses, K)[0].numpy()
    assert np.abs(flow - truth.flow[2]).max() < 0.01
    ego = rigid_flow(as_map(truth.depth[2]), camera_pose(truth, 2, 3), K)[0].numpy()
    assert np.abs(ego - truth.flow[2])[:, mask].min() > 0.1


def test_scaled_intrinsics_project_to_scaled_pixels():
    K = torch.tensor([[[100.0, 0, 50], [0, 90, 30], [0, 0, 1]]])
    small = scaled_intrinsics(K, (60, 100), (15, 50))
    point = torch.tensor([0.2, -0.1, 1.0])
    x, y, _ = (K[0] @ point).tolist()
    u, v, _ = (small[0] @ point).tolist()
    assert u == pytest.approx((x + 0.5) / 2 - 0.5, abs=1e-5)
    assert v == pytest.approx((y + 0.5) / 4 - 0.5, abs=1e-5)


@pytest.mark.parametrize("padding", ["zeros", "border"])
def test_warping_without_motion_changes_nothing_and_beyond_is_padding(padding):
    image = 0.5 + torch.rand(1, 2, 9, 11)
    K = torch.tensor([[[10.0, 0, 5], [0, 10, 4], [0, 0, 1]]])
    depth = torch.ones(1, 1, 9, 11)
    warped, valid = inverse_warp(image, depth, torch.zeros(1, 6), K, padding=padding)
    assert torch.allclose(warped, image, atol=1e-5)
    assert valid.all()
    right = torch.tensor([[-0.3, 0, 0, 0, 0, 0]])  # the points are seen 3 px further right
    warped, valid = inverse_warp(image, depth, right, K, padding=padding)
    assert torch.allclose(warped[..., :8], image[..., 3:], atol=1e-5)
    assert valid[..., :8].all()
    assert not valid[..., 8:].any()
    beyond = warped[..., 8:]
    wanted = torch.zeros_like(beyond) if padding == "zeros" else image[..., -1:].expand_as(beyond)
    assert torch.allclose(beyond, wanted, atol=1e-5)


def test_points_behind_the_camera_are_not_valid():
    depth = torch.ones(1, 1, 9, 11)
    K = torch.tensor([[[10.0, 0, 5], [0, 10, 4], [0, 0, 1]]])
    _, valid = inverse_warp(torch.rand(1, 1, 9, 11), depth, torch.tensor([[0, 0, 2.0, 0, 0, 0]]), K)
    assert not valid.any()


# ---- what a pose output means ------------------------------------------------------------------------------


def made_output(maps, components):
    return PoseOutput(components[:, :1], components, [maps])


def test_pixel_poses_and_masks_of_a_mixture():
    chosen = NetworkSettings(components=3)
    maps = torch.zeros(1, 3, 2, 3)
    maps[0, 0, 0], maps[0, 1, 1, 0], maps[0, 2, 1, 1:] = 1, 1, 0.9
    maps[0, 0, 1, 1:] = 0.1
    components = torch.arange(18.0).view(1, 3, 6)
    output = made_output(maps, components)
    poses = pixel_pose(output, chosen)
    assert torch.equal(poses[0, :, 0, 0], components[0, 0])
    assert torch.allclose(poses[0, :, 1, 2], 0.1 * components[0, 0] + 0.9 * components[0, 2])
    moving = moving_probability(output, chosen, torch.ones(1, 1, 2, 3), torch.eye(3)[None])
    assert torch.allclose(moving, torch.tensor([[[[0.0, 0, 0], [1, 0.9, 0.9]]]]))
    assert instances(output, chosen, moving, threshold=0.95).tolist() == [[[0, 0, 0], [1, 0, 0]]]
    assert instances(output, chosen, moving, threshold=0.5).tolist() == [[[0, 0, 0], [1, 2, 2]]]


def test_motion_over_a_slice_from_poses_of_references():
    chosen = NetworkSettings(maps="none")
    velocity = torch.arange(6.0)
    offsets = torch.tensor([[-0.5, 1.5]])
    output = PoseOutput(offsets[..., None] * velocity, torch.zeros(1, 0, 6), [])
    assert torch.allclose(ego_pose(output, chosen, offsets), velocity[None])
    with pytest.raises(ValueError, match="no masks"):
        moving_probability(output, chosen, torch.ones(1, 1, 2, 2), torch.eye(3)[None])
    with pytest.raises(ValueError, match="no poses of pixels"):
        pixel_pose(output, chosen)


# ---- photometric -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ssim", [0.0, 0.3])
def test_photometric_loss_is_least_for_the_truth(truth, K, ssim):
    target, reference = as_map(truth.frame[0]), as_map(truth.frame[5])
    depth, pose = as_map(truth.depth[0]), camera_pose(truth, 0, 5)
    chosen = LossSettings(ssim=ssim)

    def loss(depth, pose):
        return float(photometric_loss(target, reference, depth, pose, K, settings=chosen))

    best = loss(depth, pose)
    still = loss(depth, torch.zeros(1, 6))
    assert best < 0.1 * still  # what is left is interpolation
    if not ssim:
        assert best < 2e-3  # of an intensity of 0 .. 1
    for wrong in (1.5, 0.6):
        assert loss(wrong * depth, pose) > 2 * best
    for axis in range(6):
        turned = pose.clone()
        turned[0, axis] += 0.02
        assert loss(depth, turned) > 2 * best
    assert loss(depth, -pose) > still


def test_the_thesis_form_rewards_dissimilarity(truth, K):
    """L1 + λ SSIM: of two equally wrong images it prefers the one that is less alike."""
    target, reference = as_map(truth.frame[0]), as_map(truth.frame[5])
    depth, pose = as_map(truth.depth[0]), camera_pose(truth, 0, 5)

    def extra(form, pose):
        with_ssim = LossSettings(ssim=1, photometric_form=form)
        values = [photometric_loss(target, reference, depth, pose, K, settings=s) for s in (with_ssim, None)]
        return float(values[0] - values[1])

    right, wrong = pose, torch.zeros(1, 6)
    assert extra("corrected", right) < extra("corrected", wrong)
    assert extra("thesis", right) > extra("thesis", wrong)
    assert extra("thesis", right) == pytest.approx(1 - extra("corrected", right), abs=1e-5)


def test_only_pixels_seen_by_both_count():
    target = torch.zeros(1, 1, 9, 11)
    reference = torch.zeros(1, 1, 9, 11)
    reference[..., :3] = 1  # seen by the reference alone
    K = torch.tensor([[[10.0, 0, 5], [0, 10, 4], [0, 0, 1]]])
    pose = torch.tensor([[-0.3, 0, 0, 0, 0, 0]])
    assert float(photometric_loss(target, reference, torch.ones(1, 1, 9, 11), pose, K)) < 1e-6


# ---- the other parts ---------------------------------------------------------------------------------------


def test_mask_loss_is_cross_entropy_where_the_mask_is_known():
    mask = torch.tensor([[[0, 1, -1, 2]]])
    background = torch.tensor([[[[0.8, 0.3, 0.0, 0.1]]]])
    flat = torch.ones(1, 1, 1, 4)
    corrected = mask_loss(background, mask, flat, settings=LossSettings())
    assert float(corrected) == pytest.approx(-np.log([0.8, 0.7, 0.9]).mean(), rel=1e-5)
    thesis = mask_loss(background, mask, flat, settings=LossSettings(mask_form="thesis"))
    assert float(thesis) == pytest.approx(np.mean([0.2, 0.3, 0.1]), rel=1e-5)
    unknown = mask_loss(
        background, torch.full_like(mask, -1), flat, settings=LossSettings(mask_form="thesis")
    )
    assert float(unknown) == pytest.approx(1 - background.mean().item(), rel=1e-5)


def test_total_variation_by_hand():
    maps = torch.tensor([[[[0.0, 1.0], [3.0, 1.0]]]])
    assert float(total_variation(maps)) == pytest.approx((1 + 2) / 2 + (3 + 0) / 2)
    assert float(total_variation(torch.ones(1, 2, 1, 1))) == 0


def test_smoothness_spares_planes_and_the_thesis_form_is_constant_for_p_1():
    y, x = torch.meshgrid(torch.arange(8.0), torch.arange(9.0), indexing="ij")
    plane = (1 + 0.1 * x + 0.2 * y)[None, None].double()
    bumpy = plane + 0.3 * (((x + y) % 2)[None, None])
    corrected = LossSettings()
    assert smoothness_loss(plane, settings=corrected) < 2e-3
    assert smoothness_loss(bumpy, settings=corrected) > 0.5
    constant = LossSettings(smoothness_form="thesis", smoothness_norm=1)
    values = [smoothness_loss(each, settings=constant) for each in (plane, bumpy)]
    assert values[0] == pytest.approx(1)
    assert values[1] == pytest.approx(1)
    other = LossSettings(smoothness_form="thesis", smoothness_norm=2)
    gradient = np.concatenate([np.diff(bumpy[0, 0], axis=1).ravel(), np.diff(bumpy[0, 0], axis=0).ravel()])
    wanted = np.abs(gradient).mean() / np.sqrt(np.mean(gradient**2))
    assert float(smoothness_loss(bumpy, settings=other)) == pytest.approx(wanted)


def test_even_pose_loss_by_hand():
    mask = torch.tensor([[[0, 0, 1, 1, -1]]])
    ego = torch.zeros(1, 6)
    pose = torch.zeros(1, 6, 1, 5)
    assert float(even_pose_loss(pose, ego, mask)) == 0
    pose[0, 0, 0] = torch.tensor([0.0, 1, 3, 5, 5])
    variation = (1 + 2 + 2 + 0) / 24
    background = 1 / 12
    on_object = (1 + 1) / 12
    assert float(even_pose_loss(pose, ego, mask)) == pytest.approx(variation + background + on_object)
    two = torch.cat([mask, mask])  # objects of different images are different objects
    poses = torch.cat([torch.zeros(1, 6, 1, 5), torch.full((1, 6, 1, 5), 9.0)])
    assert float(even_pose_loss(poses, torch.tensor([[0.0] * 6, [9.0] * 6]), two)) == 0


def test_pose_distance_is_blind_to_the_scale_of_the_scene():
    true = torch.tensor([[[0.2, 0, 0, 0, 0, 0.1]]])
    depth = torch.full((1, 4, 4), 2.0)
    predicted = torch.tensor([[[0.1, 0, 0, 0, 0, 0.1]]])
    assert float(pose_distance(predicted, true, depth)) < 1e-5
    assert float(pose_distance(predicted, 2 * true, 2 * depth)) == pytest.approx(0.1, rel=1e-3)  # rotation
    assert float(pose_distance(predicted + 0.3, true, depth)) == pytest.approx(0.3 * 6**0.5, rel=1e-4)
    assert float(pose_distance(predicted, torch.full_like(true, torch.nan), depth)) == 0


def test_depth_loss_is_blind_to_scale_and_to_what_is_far_or_unknown():
    true = torch.tensor([[[1.0, 2.0, 4.0, 0.0, 50.0]]])
    depth = torch.tensor([[[[0.5, 1.0, 2.0, 9.0, 0.1]]]])
    assert float(depth_loss(depth, true)) == pytest.approx(1)  # max(d/d*, d*/d) is 1 at best
    wrong = depth_loss(torch.tensor([[[[1.0, 1, 1, 1, 1]]]]), true)
    d = 7 / 3
    wanted = np.mean([abs(d - t) / t + max(d / t, t / d) for t in (1, 2, 4)])
    assert float(wrong) == pytest.approx(wanted, rel=1e-5)
    assert float(depth_loss(depth, torch.zeros_like(true))) == 0


def test_total_is_the_weighted_sum_at_all_scales():
    from emseg.nets.build import build_networks

    chosen = small_network("ecn")
    batch = random_batch(chosen)
    disparities, output = build_networks(chosen).train()(batch.target, batch.references)
    weights = LossSettings(photometric=2, mask=3, smoothness=5, pose=7, depth=11)
    losses = total_loss(disparities, output, batch, chosen, weights)
    wanted = sum(w * part.item() for w, part in zip((2, 3, 5, 7, 11), losses[:5], strict=True))
    assert losses.total.item() == pytest.approx(wanted, rel=1e-5)
    finest = total_loss(disparities[:1], output, batch, chosen, LossSettings())
    depth = depth_at(disparities[0])
    assert finest.depth.item() == pytest.approx(depth_loss(depth, batch.depth).item(), rel=1e-5)
    thesis = LossSettings(
        photometric_form="thesis", ssim=0.1, mask_form="thesis", smoothness_form="thesis", pose_form="thesis"
    )
    literal = total_loss(disparities, output, batch, chosen, thesis)
    assert torch.isfinite(torch.stack(list(literal))).all()
    poses = output.poses * batch.offsets[..., None]
    distance = pose_distance(poses, batch.poses, batch.depth)
    assert literal.pose.item() == pytest.approx(distance.item(), rel=1e-5)


def test_the_grid_counts_from_the_upper_left():
    grid = pixel_grid(torch.zeros(1, 1, 2, 3))
    assert grid.tolist() == [[[[0, 1, 2], [0, 1, 2]], [[0, 0, 0], [1, 1, 1]]]]
