from __future__ import annotations

import pytest
import torch

from hadr.models.hand_plane import HandPlane, plane_picture


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


def test_it_learns_a_tilted_plane_from_the_hands_tilt() -> None:
    torch.manual_seed(0)
    tilt = torch.linspace(-1, 1, 16)
    points = torch.zeros(16, 21, 3)
    points[:, :, 0] = torch.linspace(-0.05, 0.05, 21)
    points[:, :, 2] = tilt[:, None] * points[:, :, 0]  # the fingers lie on the plane
    truth = torch.stack((torch.full((16,), -0.03), tilt, 0 * tilt), dim=1)
    network = HandPlane(32)
    optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
    for _ in range(300):
        loss = (network(points, torch.zeros(16, 2)) - truth).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.02
