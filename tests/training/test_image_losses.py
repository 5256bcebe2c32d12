from __future__ import annotations

import pytest
import torch

from hadr.training.image_losses import depth_and_steps, frame_mean


def test_depth_and_steps_by_hand_and_each_frame_counts_the_same() -> None:
    truth = torch.full((2, 2, 3), 0.5)
    depth = truth.clone()
    depth[0] += torch.tensor([[0.01, 0.01, 0.03], [0.01, 0.0, 9.0]])
    depth[1] += 0.04  # displaced as a whole: no wrong step
    counted = torch.ones(2, 2, 3, dtype=torch.bool)
    counted[0, 1, 2] = False
    counted[1, 1] = False
    error, steps = depth_and_steps(depth, truth, counted)
    # frame 0: (10 + 10 + 30 + 10 + 0) / 5 = 12 mm; frame 1: 40 mm
    assert error.item() == pytest.approx(0.026, abs=1e-6)
    # frame 0: columns 0, 20, 10 and rows 0, 10 mm over five steps = 8 mm; frame 1: 0
    assert steps.item() == pytest.approx(0.004, abs=1e-6)


def test_frames_in_which_nothing_counts_do_not_count() -> None:
    assert frame_mean(torch.tensor([6.0, 0.0]), torch.tensor([2, 0])).item() == 3
    nothing = torch.zeros(1, 2, 2, dtype=torch.bool)
    depth = torch.ones(1, 2, 2, requires_grad=True)
    error, steps = depth_and_steps(depth, torch.zeros(1, 2, 2), nothing)
    (error + steps).backward()
    assert error.item() == 0
    assert steps.item() == 0
    assert torch.equal(depth.grad, torch.zeros(1, 2, 2))
