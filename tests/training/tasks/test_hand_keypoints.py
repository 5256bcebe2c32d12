"""The keypoint network's training: scores by hand, chance, empty hands."""

import math
from dataclasses import replace

import pytest
import torch

from hadr.hand import FINGERS
from hadr.models.blocks.resnet import UNetConfig
from hadr.models.hand.keypoints import HandKeypointConfig
from hadr.models.hand.weighted_regression import JointMaps, maps_of_joints
from hadr.training.frames.batches import FrameTensors, blank_frames
from hadr.training.loop import chance, train
from hadr.training.recipe import Preset
from hadr.training.tasks.hand_keypoints import keypoint_losses, keypoint_scores
from hadr.training.tasks.task import Task

RECIPE = Preset(
    name="micro",
    width=96,
    height=64,
    network="hand-keypoints",
    model=HandKeypointConfig(
        UNetConfig((1, 1, 1, 1), widths=(16, 16, 32, 32), decoder=(32, 32, 32, 32)), crop=48
    ),
    augment=False,
)


def four_hands() -> FrameTensors:
    """Four bumpy hands beside a glass, each with keypoints on fingers of its own directions."""
    generator = torch.Generator().manual_seed(5)
    count, height, width = 4, 64, 96
    hand, held = (torch.zeros(count, height, width, dtype=torch.bool) for _ in range(2))
    hand[:, 16:48, 40:72] = True
    held[:, 16:48, 32:40] = True
    near = torch.linspace(0.5, 0.8, count)[:, None, None]
    v, u = torch.meshgrid(torch.arange(64.0), torch.arange(96.0), indexing="ij")
    waves = torch.rand(count, 2, generator=generator)[:, :, None, None] * 0.4
    bumps = 0.03 * torch.sin(waves[:, 0] * u + waves[:, 1] * v)
    depth = torch.where(hand, near + bumps, torch.full_like(bumps, 1.2))
    depth = torch.where(held, torch.zeros_like(depth), depth)
    direction = torch.randn(count, 5, 3, generator=generator)
    length = torch.tensor([0.02, 0.035, 0.05, 0.06])[:, None]
    fingers = 0.7 * torch.nn.functional.normalize(direction, dim=2)[:, :, None] * length
    keypoints = torch.cat((torch.zeros(count, 1, 3), fingers.flatten(1, 2)), dim=1)
    keypoints = (
        keypoints + torch.tensor([0.06, 0.0, 0.02]) * near + near * torch.tensor([0, 0, 1.0])
    )
    blank = blank_frames(count, (width, height))
    camera = torch.tensor([[110.0, 110.0, 47.5, 31.5]]).repeat(count, 1)
    inputs = replace(blank.inputs, depth=depth, mask=held, intrinsics=camera, keypoints=keypoints)
    return replace(
        blank,
        inputs=inputs,
        true_depth=depth,
        hand_mask=hand,
        object_mask=held,
        true_keypoints=keypoints,
    )


def test_a_score_of_whole_frames_is_the_same_in_any_batches() -> None:
    task, frames = Task(RECIPE), four_hands()
    torch.manual_seed(0)
    model = task.build().eval()
    scores = task.validate(model, frames, 3)
    assert next(iter(scores)) == "validation_keypoints_m", "it decides which epoch is the best"
    assert scores == pytest.approx(task.validate(model, frames, 4), rel=1e-4)
    assert scores["validation_seen"] == 1


def test_scores_by_hand() -> None:
    truth = torch.rand(2, 21, 3, generator=torch.Generator().manual_seed(0))
    found = truth.clone()
    found[:, list(FINGERS["index"]), 0] += torch.tensor([0.010, 0.019, 0.021, 0.060])
    found[1] += torch.tensor([0.0, 0.0, 0.03])
    scores = {name[11:]: value for name, value in keypoint_scores(found, truth).items()}
    index = torch.tensor([0.010, 0.019, 0.021, 0.060])
    second = (index.square() + 0.03**2).sqrt()
    total = index.sum() + second.sum() + 17 * 0.03
    assert scores["keypoints_m"] == pytest.approx(float(total) / 42, rel=1e-4)
    assert scores["within_20mm"] == pytest.approx(19 / 42)
    assert scores["wrist_m"] == pytest.approx(0.015, rel=1e-4)
    assert scores["thumb_m"] == pytest.approx(0.015, rel=1e-4)
    assert scores["index_m"] == pytest.approx(float((index + second).mean() / 2), rel=1e-4)
    assert scores["relative_m"] == pytest.approx(float(index.sum()) / 20, rel=1e-3)
    areas = [1 - e / 0.05 for e in (*index.tolist(), *second.tolist()) if e < 0.05]
    assert scores["auc_50mm"] == pytest.approx((17 + 17 * 0.4 + sum(areas)) / 42, rel=1e-4)


def test_the_loss_of_perfect_maps_is_zero_and_an_error_counts_by_its_size() -> None:
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 3, 5, 5, generator=generator) - 0.5
    joints = torch.rand(2, 21, 3, generator=generator) - 0.5
    valid = torch.ones(2, 5, 5, dtype=torch.bool)
    both = torch.tensor([True, True])
    perfect = maps_of_joints(joints, points, valid, 2.0)
    terms = keypoint_losses(perfect, joints, points, valid, both, 2.0)
    assert float(terms["loss"]) < 1e-9
    # the first frame's truth moves by 0.1 along x: smooth L1 with its knee at 0.01 gives 0.095 / 3
    moved = joints + torch.tensor([[[0.1, 0, 0]], [[0, 0, 0]]])
    terms = keypoint_losses(perfect, moved, points, valid, both, 2.0)
    assert float(terms["joints"]) == pytest.approx(0.095 / 3 / 2, rel=1e-4)
    assert float(terms["error_m"]) == pytest.approx(0.05, rel=1e-4)
    second = keypoint_losses(perfect, moved, points, valid, torch.tensor([False, True]), 2.0)
    assert float(second["loss"]) < 1e-9


def test_a_heat_that_is_wrong_counts_only_on_valid_pixels() -> None:
    points, joints = torch.zeros(1, 3, 1, 2), torch.zeros(1, 21, 3)
    valid = torch.tensor([[[True, False]]])
    truth = maps_of_joints(joints, points, valid, 1.0)
    for pixel, wanted in ((0, (0.1 - 0.005) / 4), (1, 0.0)):
        heat = truth.heat.clone()
        heat[..., pixel] -= 0.1
        terms = keypoint_losses(
            JointMaps(truth.offset, heat, truth.weight),
            joints, points, valid, torch.tensor([True]), 1.0,
        )  # fmt: skip
        assert float(terms["maps"]) == pytest.approx(wanted, abs=1e-7)


def test_a_hand_without_depth_does_not_count_and_does_not_stop_the_training() -> None:
    task = Task(RECIPE)
    torch.manual_seed(0)
    model = task.build().eval()
    frames = four_hands()
    blind = frames.take([0, 1])
    blind.inputs.depth[1][blind.hand_mask[1]] = 0
    alone = task.losses(model, frames.take([0]), 0, chance(0, 0, 0))
    both = task.losses(model, blind, 0, chance(0, 0, 0))
    for name, value in alone.items():
        torch.testing.assert_close(both[name], value)
    none = task.losses(model, blind.take([1]), 0, chance(0, 0, 0))
    assert float(none["loss"].detach()) == 0
    none["loss"].backward()
    scores = task.validate(model, blind, 2)
    one = task.validate(model, frames.take([0]), 1)
    assert scores == pytest.approx({**one, "validation_seen": 0.5}, rel=1e-4)
    unseen = task.validate(model, blind.take([1]), 1)
    assert unseen.pop("validation_seen") == 0
    assert all(math.isnan(value) for value in unseen.values())
    (row,) = train(RECIPE, frames, blind, stop_after=1, progress=False).history
    assert row["validation_seen"] == 0.5
    with pytest.raises(ValueError, match="stop_after must be at least 1, got 0"):
        train(RECIPE, frames, blind, stop_after=0, progress=False)


def test_augmentation_follows_from_the_generator_alone() -> None:
    task = Task(replace(RECIPE, augment=True))
    torch.manual_seed(0)
    model = task.build().eval()
    batch = four_hands().take([0, 1])
    first, again, other = (
        float(task.losses(model, batch, 0, chance(0, 0, step))["loss"].detach())
        for step in (0, 0, 1)
    )
    assert first == again != other
