"""What a depth network says, besides the depth, about how far its answer can be trusted.

Signals that any network gives, or some: each is an image in which larger means surer. They are no
probabilities; `hadr.confidence_rule` makes one of them.

* ``network``: the network's own confidence, as log odds. For HADR that is the probability of the
  chosen voxel.
* ``candidates``: how close together a ray's candidate answers lie, each weighted with its
  probability. For HADR the answer in another voxel than the chosen one is taken as the middle of
  the ray's way through it.
* ``neighbours``: how close together the answers of the rays around lie. Surfaces are smooth; an
  answer that changes from pixel to pixel is wrong at most of them.

Spreads enter as minus the logarithm of (spread + 1 mm).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

FLOOR_M = 0.001
"""Added to a spread before the logarithm: differences below a millimetre mean nothing."""
LEAST_ODDS = 1e-4
"""Probabilities are kept this far from 0 and 1 before the log odds are taken."""
WINDOW = 0.055
"""Side of the window that counts as the neighbourhood, as a share of the image's width."""


def signals_of(output: Any) -> dict[str, Tensor]:
    """Collect the signals that a network's output holds.

    Args:
        output: What a depth network returned: `depth`, `confidence`, `restored` (B, H, W), and
            either `spread` (B, H, W) in metres or HADR's pairs.

    Returns:
        Signals by name, each (B, H, W); 0 where not restored.
    """
    restored = output.restored
    sure = output.confidence.clamp(LEAST_ODDS, 1 - LEAST_ODDS)
    found = {"network": torch.log(sure / (1 - sure))}
    if hasattr(output, "spread"):
        found["candidates"] = -torch.log(output.spread.clamp(min=0) + FLOOR_M)
    elif hasattr(output, "pairs"):
        found["candidates"] = -torch.log(candidate_spread(output) + FLOOR_M)
    spread = neighbour_spread(output.depth, restored)
    found["neighbours"] = -torch.log(spread + FLOOR_M)
    return {name: values * restored for name, values in found.items()}


def candidate_spread(output: Any) -> Tensor:
    """Standard deviation of a ray's candidate answers, by their probability.

    Args:
        output: What HADR returned.

    Returns:
        Metres along the ray, shape (B, H, W); 0 where there is no candidate, or one.
    """
    pairs, probability, chosen = output.pairs, output.probability, output.chosen
    distance = (pairs.t_in + pairs.t_out) / 2  # (pairs,)
    ray = (chosen >= 0).nonzero().squeeze(1)
    answered = output.points.index_select(0, ray).norm(dim=1)
    distance = distance.index_put((chosen.index_select(0, ray),), answered)
    blank = distance.new_zeros(pairs.n_rays)
    mean = blank.index_add(0, pairs.ray, probability * distance)  # (rays,)
    away = (distance - mean.index_select(0, pairs.ray)) ** 2
    variance = blank.index_add(0, pairs.ray, probability * away)
    image = torch.zeros_like(output.depth)
    return image.index_put(tuple(output.rays.unbind(dim=1)), variance.clamp(min=0).sqrt())


def neighbour_spread(depth: Tensor, known: Tensor) -> Tensor:
    """Standard deviation of the restored depth around each pixel.

    Args:
        depth: z-depth in metres, shape (B, H, W).
        known: Pixels that count, shape (B, H, W), bool.

    Returns:
        Metres, shape (B, H, W); 0 where nothing is known.
    """
    half = max(round(depth.shape[2] * WINDOW / 2), 1)
    side = 2 * half + 1
    weight = known.to(depth.dtype)
    # Relative to each frame's mean, so that squares of small differences keep their digits.
    count = weight.sum(dim=(1, 2), keepdim=True).clamp(min=1)
    middle = (depth * weight).sum(dim=(1, 2), keepdim=True) / count
    relative = (depth - middle) * weight
    stacked = torch.stack((weight, relative, relative**2), dim=1)  # (B, 3, H, W)
    sums = functional.avg_pool2d(stacked, side, stride=1, padding=half)
    share, mean, square = sums.unbind(dim=1)
    share = share.clamp(min=1e-9)
    variance = square / share - (mean / share) ** 2
    return variance.clamp(min=0).sqrt() * weight


def within_learned(output: Any, depth_range_m: tuple[float, float] | None) -> Tensor:
    """Mark restored pixels whose answer the network can have learned.

    Not learned are depths outside of the range that training has shown, and answers of HADR that
    its clamp has cut off: the network wanted an answer outside of the voxel that it chose. How
    many there are `results/confidence` says (`coverage`).

    Args:
        output: What a depth network returned.
        depth_range_m: Least and largest depth of the object in training, metres; None if unknown.

    Returns:
        Shape (B, H, W), bool; a part of `output.restored`.
    """
    good: Tensor = output.restored & (output.depth > 0)
    if depth_range_m is not None:
        good = good & (output.depth >= depth_range_m[0]) & (output.depth <= depth_range_m[1])
    if hasattr(output, "clamped"):
        good = good & ~output.clamped
    elif hasattr(output, "pairs"):
        good = good & ~clamped_answers(output)
    return good


def clamped_answers(output: Any) -> Tensor:
    """Mark the pixels whose offset lies at an end of the chosen voxel.

    Args:
        output: What HADR returned.

    Returns:
        Shape (B, H, W), bool.
    """
    cut = (output.offset <= 0) | (output.offset >= 1)
    image = torch.zeros_like(output.restored)
    return image.index_put(tuple(output.rays.unbind(dim=1)), cut)
