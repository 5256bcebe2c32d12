"""A first guess from the hand alone: the plane on which the held object lies, roughly.

Fingers that hold a glass say where it is and how it leans. A small network that sees nothing but
the 21 keypoints in metres around the crop's centre answers with one plane a frame: depth at the
centre and two slopes. What it cannot say, the object's own shape, is left to the pictures.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

UNITS = (0.03, 0.4, 0.4)
"""Units of the answer: metres of depth, and metres of depth a metre across and down."""
POINT_M = 0.1
"""Unit of the keypoints' positions, metres."""


class HandPlane(nn.Module):
    """From keypoints to a plane.

    Args:
        width: Width of the two hidden layers.
    """

    def __init__(self, width: int = 256) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(21 * 3 + 2, width),
            nn.SiLU(),
            nn.Linear(width, width),
            nn.SiLU(),
            nn.Linear(width, 3),
        )

    def forward(self, points: Tensor, middle: Tensor) -> Tensor:
        """Guess the plane of each frame.

        Args:
            points: Keypoints in metres, shape (B, 21, 3): across and down from the crop's centre
                at the hand's depth, and z-depth relative to the hand's.
            middle: Direction of the crop's centre, x / z and y / z, shape (B, 2).

        Returns:
            Shape (B, 3): depth relative to the hand's at the centre in metres; its slopes across
            and down.
        """
        seen = torch.cat((points.flatten(1) / POINT_M, 3 * middle), dim=1)  # (B, 65)
        answer: Tensor = self.layers(seen)  # (B, 3)
        return answer * answer.new_tensor(UNITS)


def plane_picture(plane: Tensor, pixel: Tensor, size: int) -> Tensor:
    """Draw planes.

    Args:
        plane: Depth at the centre in metres and slopes, shape (B, 3).
        pixel: Metres that a pixel spans (across, down), shape (B, 2).
        size: Side of the picture in pixels.

    Returns:
        Depth relative to the hand's in metres, shape (B, size, size).
    """
    offset = torch.arange(size, device=plane.device, dtype=plane.dtype) - (size - 1) / 2
    across = (plane[:, 1] * pixel[:, 0])[:, None] * offset  # (B, size)
    down = (plane[:, 2] * pixel[:, 1])[:, None] * offset  # (B, size)
    return plane[:, 0, None, None] + down[:, :, None] + across[:, None, :]
