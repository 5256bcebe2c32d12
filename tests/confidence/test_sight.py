"""What a network sees in the glass, through a window and without."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from hadr.confidence.sight import observe
from hadr.models.network_input import DepthOutput, HADRInput
from hadr.models.window import WindowConfig, through_window


class Echo(nn.Module):
    """Sees colours, and answers with half a metre."""

    def __init__(self, view: WindowConfig | None) -> None:
        super().__init__()
        self.eye, self.config = nn.Identity(), SimpleNamespace(view=view)

    @through_window
    def forward(self, inputs: HADRInput) -> DepthOutput:
        self.eye(inputs.color)
        return DepthOutput(0.5 * inputs.mask, inputs.mask)


@pytest.mark.parametrize("view", [None, WindowConfig(size=40, margin=2.0)])
def test_what_is_seen_is_that_of_the_glass(view: WindowConfig | None) -> None:
    color = torch.zeros(1, 3, 48, 64)
    mask = torch.zeros(1, 48, 64, dtype=torch.bool)
    mask[:, 12:24, 40:56] = True
    color[:, 0] = mask  # red in the glass, and green around it
    color[:, 1] = ~mask
    intrinsics = torch.tensor([[60.0, 60.0, 31.5, 23.5]])
    nothing = torch.zeros(1, 21, 3), torch.zeros(1, 21, 2)
    inputs = HADRInput(color, 0.8 * ~mask, mask, intrinsics, *nothing)
    picture = np.zeros((48, 64, 3), np.uint8), mask[0].numpy()
    one = observe(Echo(view).eval(), "eye", inputs, (0.8 * ~mask)[0].numpy(), None, *picture)
    assert one.seen.tolist() == pytest.approx([1, 0, 0], abs=0.06)
    assert torch.equal(one.output.restored, mask)
