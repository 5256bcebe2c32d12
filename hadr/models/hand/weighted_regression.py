"""Adaptive weighting regression: joints from dense maps, and the dense maps of joints.

Each pixel i sees the surface at p_i and says for each joint J in which direction it lies, the unit
offset o_i, and how near it is, the heat h_i = max(0, (k - |J - p_i|) / k). So each pixel proposes a
place for the joint, p_i + k (1 - h_i) o_i, and the proposals are averaged with weights
softmax(30 h_i + w_i) over the valid pixels: near ones count the most, and the network's own weight
w_i moves that where it has learned better. With w = 0 this is the rule of the reference.

Source: Huang et al. 2020, "AWR: Adaptive Weighting Regression for 3D Hand Pose Estimation".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

SHARPNESS = 30.0
"""The factor before the heat in the softmax."""


@dataclass(frozen=True)
class JointMaps:
    """What each pixel says of each joint.

    Attributes:
        offset: Unit vector from the pixel's point to the joint, shape (B, J, 3, h, w).
        heat: 1 at the joint, 0 from the distance `reach` on, shape (B, J, h, w).
        weight: Further logit of the pixel's weight, shape (B, J, h, w).
    """

    offset: Tensor
    heat: Tensor
    weight: Tensor


def maps_of_joints(joints: Tensor, points: Tensor, valid: Tensor, reach: float) -> JointMaps:
    """Compute the maps that say exactly where joints (B, J, 3) are, in the unit of the points.

    From each pixel's surface point (B, 3, h, w), which pixels have one (B, h, w), and the reach k.
    The maps are zero in invalid pixels, the offset also where a joint is beyond reach; the weight
    is zero.
    """
    away = joints[:, :, :, None, None] - points[:, None]  # (B, J, 3, h, w)
    distance = away.norm(dim=2)  # (B, J, h, w)
    near = valid[:, None] & (distance < reach)
    heat = torch.where(near, (reach - distance) / reach, torch.zeros_like(distance))
    unit = away / distance.clamp(min=1e-9)[:, :, None]
    offset = torch.where(near[:, :, None], unit, torch.zeros_like(unit))
    return JointMaps(offset, heat, torch.zeros_like(heat))


def joints_of_maps(maps: JointMaps, points: Tensor, valid: Tensor, reach: float) -> Tensor:
    """Average the pixels' proposals for each joint: (B, J, 3), in the unit of the points.

    Points, valid pixels and reach as of `maps_of_joints`; ValueError for a crop without valid
    pixel.
    """
    empty = (~valid.flatten(1).any(dim=1)).nonzero().flatten()
    if len(empty):
        raise ValueError(
            f"crop {int(empty[0])} of the batch has no valid pixel: no depth was measured on a "
            "hand there"
        )
    score = SHARPNESS * maps.heat + maps.weight  # (B, J, h, w)
    score = score.masked_fill(~valid[:, None], -torch.inf).flatten(2)  # (B, J, h w)
    share = score.softmax(dim=2)
    step = (reach * (1 - maps.heat))[:, :, None] * maps.offset  # (B, J, 3, h, w)
    known = torch.where(valid[:, None], points, torch.zeros_like(points))
    proposal = (known[:, None] + step).flatten(3)  # (B, J, 3, h w)
    return torch.einsum("bjn,bjcn->bjc", share, proposal)
