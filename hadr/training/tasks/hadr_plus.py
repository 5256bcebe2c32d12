"""What HADR-plus is trained by: how likely, how deep, which shape."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from hadr.models.hadr_plus import HADRPlusOutput
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import frame_mean
from hadr.training.recipe import Preset

DEPTH_WEIGHT = 20.0
"""Weight of a metre of expected depth error beside a nat of likelihood."""
STEP_WEIGHT = 50.0
"""Weight of a metre of error in the step from a ray to the next: the shape."""
PLANE_WEIGHT = 20.0
"""Weight of a metre of error of the plane guessed from the whole crop."""
SAME_SURFACE_M = 0.01
"""Neighbouring rays whose true depths differ by less see the same surface."""


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: likelihood, depth and shape, at the rays of the mask."""
    return plus_losses(model(batch.inputs), batch)


def plus_losses(output: HADRPlusOutput, batch: FrameTensors) -> dict[str, Tensor]:
    """Compute the loss and its terms, each frame counting the same; all but the first in metres.

    "likelihood": mean negative logarithm of the true depth's density, nats; "depth": mean absolute
    error that the probabilities let expect; "step": that of the step from a ray to the next on the
    same surface; "mae": that of the chosen candidates; "plane", where it is guessed: its.
    """
    frame, row, column = output.rays.unbind(dim=1)
    truth = batch.true_depth[frame, row, column]  # (rays,)
    counts = (truth > 0).to(truth.dtype)
    error = (output.candidate - truth[:, None]).abs()  # (rays, M)
    logarithm = output.logits.log_softmax(dim=1)
    density = logarithm - output.log_scale - math.log(2) - error / output.log_scale.exp()
    unlikely = -density.logsumexp(dim=1)  # (rays,)
    expected = (logarithm.exp() * error).sum(dim=1)  # (rays,)
    chosen = error.gather(1, output.logits.argmax(dim=1, keepdim=True))[:, 0]

    rays = torch.zeros(len(batch), dtype=truth.dtype, device=truth.device)
    rays = rays.index_add(0, frame, counts)

    def mean(values: Tensor) -> Tensor:
        return frame_mean(torch.zeros_like(rays).index_add(0, frame, values * counts), rays)

    terms = {
        "likelihood": mean(unlikely),
        "depth": mean(expected),
        "step": _step_error(output, batch),
        "mae": mean(chosen).detach(),
    }
    total = terms["likelihood"] + DEPTH_WEIGHT * terms["depth"] + STEP_WEIGHT * terms["step"]
    if output.plane is not None:
        terms["plane"] = mean((output.plane - truth).abs())
        total = total + PLANE_WEIGHT * terms["plane"]
    return {"loss": total, **terms}


def _step_error(output: HADRPlusOutput, batch: FrameTensors) -> Tensor:
    """Error in the step to the next pixel in row and column, where both see one surface."""
    frame, row, column = output.rays.unbind(dim=1)
    chosen = output.logits.argmax(dim=1, keepdim=True)
    depth = output.candidate.gather(1, chosen)[:, 0]  # (rays,)
    truth = batch.true_depth[frame, row, column]
    counts = (truth > 0) & (depth > 0)
    frames, height, width = batch.true_depth.shape
    number = torch.full((frames, height + 1, width + 1), -1, device=truth.device)
    number[frame, row, column] = torch.arange(len(truth), device=truth.device)
    total, count = depth.new_zeros(frames), depth.new_zeros(frames)
    for down, right in ((0, 1), (1, 0)):
        other = number[frame, row + down, column + right]  # (rays,); -1: no ray there
        step = truth[other] - truth
        pair = (other >= 0) & counts & counts[other] & (step.abs() < SAME_SURFACE_M)
        wrong = (depth[other] - depth - step).abs().clamp(max=SAME_SURFACE_M)
        total = total.index_add(0, frame, wrong * pair)
        count = count.index_add(0, frame, pair.to(count.dtype))
    return frame_mean(total, count)
