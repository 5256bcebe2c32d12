"""A plane on which the held object lies, roughly: one depth and two slopes a frame."""

from __future__ import annotations

import torch
from torch import Tensor

UNITS = (0.03, 0.4, 0.4)
"""Units of a plane: metres of depth, and metres of depth a metre across and down."""


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
