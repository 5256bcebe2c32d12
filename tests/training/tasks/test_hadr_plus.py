import math
from dataclasses import replace

import pytest
import torch

from hadr.data.samples import open_samples
from hadr.models.hadr_plus import HADRPlusOutput
from hadr.training.frames.batches import load_frames
from hadr.training.tasks.hadr_plus import plus_losses


@pytest.fixture(scope="module")
def frames():
    return load_frames(open_samples("train")[:4], (256, 144))


def output_of(batch, candidates, logits, scale):
    """An output as a network would give it that is the same on every ray, in metres off truth."""
    rays = batch.inputs.mask.nonzero()
    truth = batch.true_depth[batch.inputs.mask]
    candidate = truth[:, None] + torch.tensor(candidates)
    scores = torch.tensor(logits).expand(len(rays), -1)
    depth = torch.zeros_like(batch.true_depth)
    depth[batch.inputs.mask] = candidate[:, scores[0].argmax()]
    return HADRPlusOutput(
        depth=depth,
        confidence=torch.zeros_like(depth),
        restored=batch.inputs.mask,
        rays=rays,
        candidate=candidate,
        logits=scores,
        log_scale=torch.full_like(candidate, math.log(scale)),
    )


def test_terms_by_hand(frames):
    batch = frames.take(range(2))
    assert (batch.true_depth[batch.inputs.mask] > 0).all()
    # Two candidates 1 cm before and 3 cm behind, with probabilities 3/4 and 1/4, scale 2 cm.
    output = output_of(batch, [-0.01, 0.03], [math.log(3.0), 0.0], 0.02)
    terms = plus_losses(output, batch)
    density = (0.75 * math.exp(-0.5) + 0.25 * math.exp(-1.5)) / 0.04
    assert terms["likelihood"].item() == pytest.approx(-math.log(density), rel=1e-4)
    assert terms["depth"].item() == pytest.approx(0.75 * 0.01 + 0.25 * 0.03, rel=1e-4)
    assert terms["mae"].item() == pytest.approx(0.01, rel=1e-4)
    assert terms["step"].item() == pytest.approx(0.0, abs=1e-6)  # shifted, but of the right shape


def test_the_step_and_the_loss_by_hand(frames):
    """Three rows of four rays to a wall: 9 steps to the right, 2 mm too long each, and 8 down."""
    wall = frames.take([0])
    mask = torch.zeros_like(wall.inputs.mask)
    mask[0, 50:53, 60:64] = True
    batch = replace(
        wall,
        inputs=replace(wall.inputs, mask=mask),
        true_depth=torch.full_like(wall.true_depth, 0.5),
    )
    output = output_of(batch, [0.0], [0.0], 0.02)
    off = 0.002 * (output.rays[:, 2:] - 60)  # 3 mm in the mean
    terms = plus_losses(replace(output, candidate=output.candidate + off), batch)
    step = 0.002 * 9 / 17
    assert terms["step"].item() == pytest.approx(step, rel=1e-3)
    expected = math.log(0.04) + 0.003 / 0.02 + 20 * 0.003 + 50 * step
    assert terms["loss"].item() == pytest.approx(expected, abs=1e-4)


def test_the_hands_plane_is_scored_by_itself(frames):
    batch = frames.take([0])
    output = output_of(batch, [0.0], [0.0], 0.02)
    without = plus_losses(output, batch)
    assert "plane" not in without
    plane = (batch.true_depth[batch.inputs.mask] - 0.03).requires_grad_()
    terms = plus_losses(replace(output, plane=plane), batch)
    assert terms["plane"].item() == pytest.approx(0.03, rel=1e-4)
    assert (terms["loss"] - without["loss"]).item() == pytest.approx(20 * 0.03, rel=1e-3)
    terms["loss"].backward()
    assert (plane.grad < 0).all()  # a step down the gradient moves it back, away from the camera


def test_each_frame_counts_the_same(frames):
    batch = frames.take([0, 1])
    output = output_of(batch, [0.0], [0.0], 0.02)
    off = output.rays[:, 0] == 1
    wrong = replace(output, candidate=output.candidate + 0.02 * off[:, None])
    assert plus_losses(wrong, batch)["depth"].item() == pytest.approx(0.01, rel=1e-4)


def test_rays_without_a_true_depth_do_not_count(frames):
    batch = frames.take([0])
    holes = batch.true_depth.clone()
    row, column = batch.inputs.mask[0].nonzero()[10].tolist()
    holes[0, row, column] = 0
    terms = plus_losses(output_of(batch, [0.01], [0.0], 0.02), replace(batch, true_depth=holes))
    assert terms["mae"].item() == pytest.approx(0.01, rel=1e-4)
