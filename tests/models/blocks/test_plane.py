from __future__ import annotations

import pytest
import torch

from hadr.models.blocks.plane import plane_picture


def test_a_plane_by_hand() -> None:
    # 5 cm before the hand; 0.2 m a metre to the right, falling downwards by 0.5 m a metre.
    plane = torch.tensor([[-0.05, 0.2, -0.5], [0.01, 0.0, 0.0]])
    picture = plane_picture(plane, torch.tensor([[0.01, 0.02], [0.01, 0.01]]), 3)
    across, down = 0.2 * 0.01, -0.5 * 0.02
    for row in range(3):
        for column in range(3):
            expected = -0.05 + across * (column - 1) + down * (row - 1)
            assert picture[0, row, column].item() == pytest.approx(expected, abs=1e-7)
    assert picture[1].flatten().tolist() == pytest.approx([0.01] * 9)
