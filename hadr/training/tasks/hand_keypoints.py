"""What the hand-keypoint network is trained by, and how its keypoints are scored.

Besides what the loop changes in frames (mirror, zoom, roll), each step of the training moves the
cube a little, scales it, and adds noise to the depth, the same for all frames of the batch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.hand import FINGERS
from hadr.models.hand.cube import HandCube
from hadr.models.hand.keypoints import MAP_STRIDE, HandKeypointNet, hand_cube, keypoints_where_seen
from hadr.models.hand.weighted_regression import JointMaps, joints_of_maps, maps_of_joints
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import mean_of
from hadr.training.recipe import Preset

SHIFT_M = 0.02
"""Largest shift of the cube along each axis, metres."""
SCALE = 0.1
"""The cube's side is changed by up to this share."""
NOISE_M = 0.003
"""Standard deviation of the noise added to the depth, metres."""
KNEE = 0.01
"""Where the smooth L1 loss bends from squares to absolute values; 1 is half of the cube's side."""
DENSE_WEIGHT = 0.1
"""Weight of the dense maps' loss beside the joints'."""
NEAR_M = 0.02
AUC_TO_M = 0.05


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch; frames whose hand has no depth do not count."""
    config: Any = recipe.model
    seen = (batch.hand_mask & (batch.inputs.depth > 0)).flatten(1).any(dim=1)  # (B,)
    # a frame without a hand stays in the batch, and counts nowhere
    blank = ~seen[:, None, None]
    inputs = replace(
        batch.inputs,
        depth=torch.where(blank, torch.ones_like(batch.inputs.depth), batch.inputs.depth),
    )
    hand = batch.hand_mask | blank
    cube = hand_cube(config, inputs, hand)
    depth = torch.where(hand, inputs.depth, torch.zeros_like(inputs.depth))
    if recipe.augment:
        cube, depth = _change(cube, depth, generator)
    crop = cube.crop(depth)  # (B, 1, S, S)
    points, valid = cube.points(crop, MAP_STRIDE)  # (B, 3, h, w) and (B, h, w)
    seen = seen & valid.flatten(1).any(dim=1)
    valid = valid | ~seen[:, None, None]
    joints = cube.into(batch.true_keypoints)  # (B, 21, 3)
    found = model(crop)
    terms = keypoint_losses(found, joints, points, valid, seen, config.reach)
    return terms | {"error_m": terms["error_m"] * (cube.side_m / 2)}


def validate(model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
    """Score the keypoints found in whole frames; the cube lies where the masks say.

    Only frames that show enough of a hand are scored (`keypoints_where_seen`), all numbers are NaN
    where none does; "validation_seen" is their share.
    """
    network = cast(HandKeypointNet, model)
    device = next(model.parameters()).device
    found = []
    for batch in frames.batches(batch_size):
        part = batch.to(device)
        found.append(keypoints_where_seen(network, part.inputs, part.hand_mask).cpu())
    keypoints = torch.cat(found)
    seen = (keypoints != 0).flatten(1).any(dim=1)  # (N,)
    scores = keypoint_scores(keypoints[seen], frames.true_keypoints.cpu()[seen])
    return scores | {"validation_seen": float(seen.float().mean())}


def _change(cube: HandCube, depth: Tensor, generator: torch.Generator) -> tuple[HandCube, Tensor]:
    """Move and scale the cubes and disturb the depth, the same in each frame."""
    shift = (torch.rand(3, generator=generator) * 2 - 1) * SHIFT_M
    scale = 1 + (float(torch.rand(1, generator=generator)) * 2 - 1) * SCALE
    noise = torch.randn(depth.shape[1:], generator=generator) * NOISE_M
    moved = replace(cube, center=cube.center + shift.to(cube.center), side_m=cube.side_m * scale)
    return moved, torch.where(depth > 0, (depth + noise.to(depth)).clamp(min=0.01), depth)


def keypoint_losses(
    found: JointMaps, joints: Tensor, points: Tensor, valid: Tensor, counted: Tensor, reach: float
) -> dict[str, Tensor]:
    """Compute the loss and its terms: smooth L1 of joints and, on valid pixels, of the maps.

    Joints are (B, J, 3), surface points (B, 3, h, w) in the cube; the error is in its half sides.
    """
    frames = counted.to(points.dtype)
    result = joints_of_maps(found, points, valid, reach)  # (B, J, 3)
    off = functional.smooth_l1_loss(result, joints, beta=KNEE, reduction="none").mean(dim=(1, 2))
    truth = maps_of_joints(joints, points, valid, reach)
    miss = functional.smooth_l1_loss(found.offset, truth.offset, beta=KNEE, reduction="none")
    miss = miss.mean(dim=(1, 2)) * 3 + functional.smooth_l1_loss(
        found.heat, truth.heat, beta=KNEE, reduction="none"
    ).mean(dim=1)  # (B, h, w)
    dense = (miss * valid).sum(dim=(1, 2)) / (4 * valid.sum(dim=(1, 2)))
    error = (result - joints).norm(dim=2).mean(dim=1).detach()
    number = counted.sum()
    terms = {
        name: mean_of((values * frames).sum(), number)
        for name, values in (("joints", off), ("maps", dense), ("error_m", error))
    }
    return {"loss": terms["joints"] + DENSE_WEIGHT * terms["maps"], **terms}


def keypoint_scores(found: Tensor, truth: Tensor) -> dict[str, float]:
    """Score keypoints (N, 21, 3), metres: numbers by their names in a training's history.

    The first is the mean distance over frames and joints, in metres as all that end in ``_m``;
    "within_20mm": the share nearer than 20 mm; "auc_50mm": the area under the curve "share nearer
    than t", t from 0 to 50 mm, divided by 50 mm; "relative_m": both hands moved to their wrists.
    """
    distance = (found - truth).norm(dim=2)  # (N, 21)
    moved = (found - found[:, :1]) - (truth - truth[:, :1])
    scores = {
        "keypoints_m": distance.mean(),
        "within_20mm": (distance < NEAR_M).float().mean(),
        "auc_50mm": (1 - distance / AUC_TO_M).clamp(min=0).mean(),
        "wrist_m": distance[:, 0].mean(),
        **{f"{name}_m": distance[:, list(joints)].mean() for name, joints in FINGERS.items()},
        "relative_m": moved.norm(dim=2)[:, 1:].mean(),
    }
    return {f"validation_{name}": float(value) for name, value in scores.items()}
