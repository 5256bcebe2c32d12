from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from hadr.rivals.tode import TODEConfig
from hadr.training.frames.batches import FrameTensors, blank_frames
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    network="tode",
    model=TODEConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.0, width=16),
)


def losses(image: Tensor, batch: FrameTensors) -> dict[str, Tensor]:
    """The loss of a network that says this image."""
    answer = SimpleNamespace(image=image)
    return Task(MICRO).losses(lambda _: answer, batch, 0, torch.Generator())


def by_hand() -> tuple[Tensor, FrameTensors]:
    """Two frames of 3 x 4 pixels before a wall at 0.5 m, and an answer.

    In the first one it is a wall that turns away by 45 degrees, in the second one a wall 0.1 m
    too far. There one pixel's truth is unknown, and the answer nonsense.
    """
    u = (torch.arange(4.0) - 1.5) / 40
    image = torch.stack(((0.5 / (1 - u)).expand(3, 4), torch.full((3, 4), 0.6)))
    truth = torch.full((2, 3, 4), 0.5)
    image[1, 1, 1], truth[1, 1, 1] = 5.0, 0.0
    on_object = torch.zeros(2, 3, 4, dtype=torch.bool)
    on_object[0, :, :2] = True
    on_object[1, 0, 0] = True
    blank = blank_frames(2, (4, 3))
    camera = torch.tensor([[40.0, 40.0, 1.5, 1.0]]).repeat(2, 1)
    # the network was told another mask
    inputs = replace(blank.inputs, depth=truth, mask=~blank.inputs.mask, intrinsics=camera)
    return image, replace(blank, inputs=inputs, true_depth=truth, object_mask=on_object)


def test_the_loss_by_hand() -> None:
    image, batch = by_hand()
    found = losses(image, batch)
    column = [abs(0.5 / (1 - (c - 1.5) / 40) - 0.5) for c in range(4)]
    depth = (3 * sum(column[:2]) + 0.1) / 7
    everywhere = (3 * sum(column) + 11 * 0.1) / 23
    turned = 1 - 0.5**0.5
    # Six normals a frame; three of the second one need the unknown pixel. On the object: 4 and 1.
    normals, all_normals = 4 * turned / 5, 6 * turned / 9
    assert found["depth"].item() == pytest.approx(depth, abs=1e-6)
    assert found["depth_everywhere"].item() == pytest.approx(everywhere, abs=1e-6)
    assert found["normals"].item() == pytest.approx(normals, abs=1e-4)
    assert found["normals_everywhere"].item() == pytest.approx(all_normals, abs=1e-4)
    total = depth + 0.01 * everywhere + 0.1 * (normals + 0.01 * all_normals)
    assert found["loss"].item() == pytest.approx(total, abs=2e-5)


def test_the_perfect_answer_costs_nothing(frames) -> None:
    for name, value in losses(frames.true_depth, frames).items():
        assert value.item() == pytest.approx(0, abs=1e-6), name


def test_without_truth_or_without_an_answer_gradients_stay_numbers() -> None:
    image, batch = by_hand()
    for answer, truth in ((image, torch.zeros_like(image)), (0 * image, batch.true_depth)):
        answer = answer.clone().requires_grad_()
        found = losses(answer, replace(batch, true_depth=truth))
        found["loss"].backward()
        assert torch.isfinite(found["loss"])
        assert torch.isfinite(answer.grad).all()
        assert (found["loss"].item() > 0) == bool(truth.any())
