from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import Tensor

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import frame_mean
from hadr.training.presets import preset
from hadr.training.tasks.task import Task


def losses(depth: Tensor, batch: FrameTensors) -> dict[str, Tensor]:
    """The loss of a network that says this depth."""
    task, answer = Task(preset("tiny", "unet-hand")), SimpleNamespace(depth=depth)
    return task.losses(lambda _: answer, batch, 0, torch.Generator())


def batch_of(frames: FrameTensors, truth: Tensor, counted: Tensor) -> FrameTensors:
    few = frames.take(range(len(truth)))
    return replace(few, inputs=replace(few.inputs, mask=counted), true_depth=truth)


def test_depth_and_steps_by_hand_and_each_frame_counts_the_same(frames: FrameTensors) -> None:
    truth = torch.full((2, 2, 3), 0.5)
    depth = truth.clone()
    depth[0] += torch.tensor([[0.01, 0.01, 0.03], [0.01, 0.0, 9.0]])
    depth[1] += 0.04  # displaced as a whole: no wrong step
    counted = torch.ones(2, 2, 3, dtype=torch.bool)
    counted[0, 1, 2] = False
    counted[1, 1] = False
    found = losses(depth, batch_of(frames, truth, counted))
    # frame 0: (10 + 10 + 30 + 10 + 0) / 5 = 12 mm; frame 1: 40 mm
    assert found["depth"].item() == pytest.approx(0.026, abs=1e-6)
    # frame 0: columns 0, 20, 10 and rows 0, 10 mm over five steps = 8 mm; frame 1: 0
    assert found["step"].item() == pytest.approx(0.004, abs=1e-6)
    assert found["loss"].item() == pytest.approx(20 * 0.030, rel=1e-5)


def test_frames_in_which_nothing_counts_do_not_count(frames: FrameTensors) -> None:
    assert frame_mean(torch.tensor([6.0, 0.0]), torch.tensor([2, 0])).item() == 3
    depth, nothing = torch.ones(1, 2, 2, requires_grad=True), torch.zeros(1, 2, 2)
    found = losses(depth, batch_of(frames, nothing, nothing.bool()))
    found["loss"].backward()
    assert found["loss"].item() == 0
    assert torch.equal(depth.grad, nothing)
