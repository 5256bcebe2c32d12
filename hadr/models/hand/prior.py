"""What the hand says before any network: how far away it is, and its keypoints as pictures.

A hand that holds a glass is at the glass's distance, up to a few centimetres. Networks that are
given the hand's depth as the zero of their depths only learn those centimetres, and an object of
which they know nothing else is no farther off than the hand.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from hadr.models.hadr_input import HADRInput


def hand_depth(inputs: HADRInput) -> Tensor:
    """Give the hand's depth: the median z-depth of its 21 keypoints.

    Args:
        inputs: A batch of frames.

    Returns:
        Metres, shape (B,).

    Raises:
        ValueError: A frame has no hand in front of the camera.
    """
    median: Tensor = inputs.keypoints[:, :, 2].median(dim=1).values  # (B,)
    absent = (~(median > 0)).nonzero().flatten()
    if len(absent):
        number = int(absent[0])
        raise ValueError(
            f"frame {number} of the batch has no hand in front of the camera: the median depth of "
            f"its keypoints is {float(median[number]):.3g} m"
        )
    return median


def relative_depth(depth: Tensor, hand: Tensor, reach: float) -> Tensor:
    """Turn measured depth into two pictures: how far from the hand's, and whether it is near.

    Args:
        depth: z-depth in metres, shape (B, H, W); 0 = missing.
        hand: The hand's depth in metres, shape (B,).
        reach: Farthest distance from the hand's depth that is told apart, metres.

    Returns:
        Shape (B, 2, H, W): the difference in units of `reach`, cut off at -1 and 1 and 0 where
        depth is missing; 1 where depth was measured within `reach`.
    """
    difference = (depth - hand[:, None, None]) / reach  # (B, H, W)
    known = (depth > 0).to(depth.dtype)
    near = known * (difference.abs() < 1)
    return torch.stack((difference.clamp(-1, 1) * known, near), dim=1)


def keypoint_maps(
    uv: Tensor,
    height: Tensor,
    size: tuple[int, int],
    radius: float,
    groups: Sequence[Sequence[int]] = (tuple(range(21)),),
) -> Tensor:
    """Draw keypoints as blobs.

    Args:
        uv: Their pixels (column, row), shape (B, 21, 2).
        height: A value of each, such as its relative depth, shape (B, 21).
        size: (rows, columns) of the pictures.
        radius: Standard deviation of a blob in pixels.
        groups: Keypoints that share a picture.

    Returns:
        Shape (B, 2 G, rows, columns): for each of the G groups the sum of its blobs, then for
        each of them the sum of the blobs times their values.
    """
    rows, columns = (torch.arange(n, device=uv.device, dtype=uv.dtype) for n in size)
    across = torch.exp(-((uv[:, :, :1] - columns) ** 2) / (2 * radius**2))  # (B, 21, columns)
    along = torch.exp(-((uv[:, :, 1:] - rows) ** 2) / (2 * radius**2))  # (B, 21, rows)
    maps = []
    for value in (torch.ones_like(height), height):
        for group in map(list, groups):
            row = along[:, group] * value[:, group, None]  # (B, K, rows)
            maps.append(torch.einsum("bki,bkj->bij", row, across[:, group]))
    return torch.stack(maps, dim=1)
