"""The training objective: depth, voxel probability and surface normals; what other losses share.

Source: paper, "Training Objective" and equation 3; ledger, rows 1 (weights) and 2 (over what the
depth loss runs).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor
from torch.nn import functional

from hadr.models.hadr import HADROutput
from hadr.models.network_input import masked_rays, ray_points
from hadr.ray_voxels import VoxelGrid, pair_of_true_point, segment_argmax, segment_log_softmax

DepthNorm = Literal["xyz", "z"]


def mean_of(total: Tensor, count: Tensor | int) -> Tensor:
    """Divide a sum by how many entered it; zeros where nothing counts."""
    number = torch.as_tensor(count, dtype=total.dtype, device=total.device).detach()
    least = torch.finfo(total.dtype).tiny
    return torch.where(number > 0, total / number.clamp(min=least), torch.zeros_like(total))


def mean_where(values: Tensor, counted: Tensor) -> Tensor:
    """Mean of the values that count (bool, the same shape), of the whole batch; 0 without any."""
    return mean_of((values * counted).sum(), counted.sum())


def frame_mean(total: Tensor, count: Tensor) -> Tensor:
    """Mean of the frames' own means, total (B,) by count (B,), where anything counts; 0 without."""
    counts = count > 0
    means = torch.where(counts, total / count.clamp(min=1e-6), torch.zeros_like(total))
    return mean_of(means.sum(), counts.sum())


@dataclass(frozen=True)
class LossWeights:
    """Weights of the three terms.

    Args:
        depth: Weight of the depth term.
        probability: Weight of the cross-entropy over each ray's voxels.
        normals: Weight of the normals' term.
        depth_over: "xyz": mean absolute error over the three coordinates of the predicted point;
            "z": over its z-depth alone.
    """

    depth: float = 200.0
    probability: float = 10.0
    normals: float = 0.5
    depth_over: DepthNorm = "xyz"


PRINTED = LossWeights()
"""As the paper prints them."""
CODED = LossWeights(probability=0.5, normals=10.0)
"""As the published code has them; LIDF's order too. The print has probably swapped the two."""
LIDF_WEIGHTS = LossWeights(depth=100.0, probability=0.5, normals=10.0)
"""LIDF's, as its published code has them; its refinement has no term for the probability."""


@dataclass(frozen=True)
class LossTerms:
    """The terms of one batch, unweighted, and how well the voxels are chosen.

    Attributes:
        depth: Metres.
        probability: Nats; ln K is what guessing among K voxels gives.
        normals: 0 = parallel, 1 = opposite.
        voxel_accuracy: Share of the rays, among those whose true voxel is a candidate, on which
            it is the most probable one.
        without_true_voxel: Share of the rays whose true voxel is no candidate.
    """

    depth: Tensor
    probability: Tensor
    normals: Tensor
    voxel_accuracy: Tensor
    without_true_voxel: Tensor

    def total(self, weights: LossWeights) -> Tensor:
        """Weigh and sum the three terms."""
        return (
            weights.depth * self.depth
            + weights.probability * self.probability
            + weights.normals * self.normals
        )


def depth_loss(points: Tensor, true_points: Tensor, over: DepthNorm = "xyz") -> Tensor:
    """Mean absolute error, metres, of points (R, 3) over x, y and z, or z alone; 0 without rays."""
    error = (points - true_points).abs()
    error = error if over == "xyz" else error[:, 2:]
    return mean_of(error.sum(), error.numel())


def probability_loss(log_probability: Tensor, true_pair: Tensor) -> Tensor:
    """Mean cross-entropy, nats, of log (P,) at each ray's true pair (R,); -1 does not count."""
    known = true_pair[true_pair >= 0]
    return mean_of(-log_probability.index_select(0, known).sum(), len(known))


def normals(cloud: Tensor) -> Tensor:
    """Unit normals (B, H - 1, W - 1, 3) of a cloud (B, H, W, 3): a column's step cross a row's."""
    to_column = cloud[:, :-1, 1:] - cloud[:, :-1, :-1]
    to_row = cloud[:, 1:, :-1] - cloud[:, :-1, :-1]
    return functional.normalize(torch.linalg.cross(to_column, to_row), dim=-1, eps=1e-9)


def normals_apart(cloud: Tensor, true_cloud: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
    """Compare the normals of two organised point clouds (B, H, W, 3), known (B, H, W) where bool.

    Gives 1 - cos of the angle between them, (B, H - 1, W - 1), and where both neighbours are known.
    """
    whole = known[:, :-1, :-1] & known[:, :-1, 1:] & known[:, 1:, :-1]
    return 1 - (normals(cloud) * normals(true_cloud)).sum(dim=-1), whole


def image_points(depth: Tensor, intrinsics: Tensor) -> Tensor:
    """Lift depth (B, H, W), metres, by fx, fy, cx, cy (B, 4): points (B, H, W, 3)."""
    pixels = masked_rays(torch.ones_like(depth, dtype=torch.bool))  # (B * H * W, 3)
    return ray_points(pixels, depth.flatten(), intrinsics).view(*depth.shape, 3)


def normals_loss(cloud: Tensor, true_cloud: Tensor, valid: Tensor) -> Tensor:
    """Mean of (1 - cos) / 2 of normals where both clouds (B, H, W, 3) are valid; 0..1."""
    apart, whole = normals_apart(cloud, true_cloud, valid)
    return mean_where(apart / 2, whole)


def hadr_losses(
    output: HADROutput,
    true_depth: Tensor,
    intrinsics: Tensor,
    grid: VoxelGrid,
    *,
    depth_over: DepthNorm = "xyz",
    ray_stride: int = 1,
) -> LossTerms:
    """Compute the terms for a batch of true z-depth (B, H, W), metres, 0 = unknown.

    Rays without a candidate voxel, and rays whose true depth is not known, count in no term. The
    intrinsics are fx, fy, cx, cy of each frame, (B, 4). Where only every n-th row and column was
    restored (`ray_stride`), the normals are those of the cloud of these pixels.
    """
    rays = output.rays
    depth = true_depth[rays[:, 0], rays[:, 1], rays[:, 2]]  # (rays,)
    true_points = ray_points(rays, depth, intrinsics)  # (rays, 3)
    counts = (output.chosen >= 0) & (depth > 0)
    counted = counts.nonzero().squeeze(1)

    nowhere = torch.full_like(true_points, torch.nan)
    true_pair = pair_of_true_point(
        output.pairs, output.occupied, torch.where(counts[:, None], true_points, nowhere), grid
    )  # (rays,)
    segments = (output.pairs.ray, output.pairs.n_rays)
    log_probability = segment_log_softmax(output.logits, *segments)
    best = segment_argmax(output.probability.detach(), *segments)
    known = true_pair >= 0

    # The rays as an organised cloud at every n-th pixel.
    frames, height, width = true_depth.shape
    shape = (frames, -(-height // ray_stride), -(-width // ray_stride))
    cell = (rays[:, 0], rays[:, 1] // ray_stride, rays[:, 2] // ray_stride)
    blank = true_points.new_zeros(*shape, 3)
    valid = torch.zeros(shape, dtype=torch.bool, device=rays.device).index_put(cell, counts)
    return LossTerms(
        depth=depth_loss(output.points[counted], true_points[counted], depth_over),
        probability=probability_loss(log_probability, true_pair),
        normals=normals_loss(
            blank.index_put(cell, output.points), blank.index_put(cell, true_points), valid
        ),
        voxel_accuracy=mean_of((best[known] == true_pair[known]).float().sum(), known.sum()),
        without_true_voxel=mean_of((counts & ~known).float().sum(), counts.sum()),
    )
