"""Does a network still see? What a training says of itself after each epoch.

A colour encoder can collapse: whatever picture it is given, its maps soon hold nearly the same few
numbers, and the rest of the network learns without it. The loss falls on and shows nothing. Three
numbers show it: how many directions the encoder's features vary in, how strong the gradient is
that each part is given, and what it costs to see another frame's colours.

Source: Roy and Vetterli 2007, "The effective rank: a measure of effective dimensionality".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from hadr.metrics import mean_over_frames
from hadr.models.networks import Network
from hadr.training.evaluation import evaluate
from hadr.training.frames.batches import FrameTensors

PROBED = 48
"""Frames on which ranks and the cost of other colours are measured, at most."""


def effective_rank(features: Tensor) -> float:
    """Say in how many directions rows (N, C), or maps (B, C, H, W), vary: 1 to C, 0 in none.

    The exponential of the entropy of the variance's distribution over the principal directions.
    """
    if features.ndim == 4:
        features = features.permute(0, 2, 3, 1).flatten(0, 2)  # (N, C)
    rows = features.detach().double()
    spread = torch.linalg.svdvals(rows - rows.mean(dim=0)).square()  # (min(N, C),)
    total = float(spread.sum())
    # What is left of equal rows is rounding, not variance.
    if total <= 1e-12 * float(rows.square().sum()) or not math.isfinite(total):
        return 0.0
    share = spread / total
    return float(torch.exp(-torch.xlogy(share, share).sum()))


@contextmanager
def recorded_stages(encoder: nn.Module) -> Iterator[list[list[Tensor]]]:
    """Keep the maps that an encoder's stages give while it is used: a list a stage.

    An encoder is a backbone of `transformers`, a module that gives all maps, or a list of stages.
    """
    kept: list[list[Tensor]] = []
    stages: Any = getattr(getattr(encoder, "encoder", None), "stages", None)
    if stages is None and isinstance(encoder, nn.ModuleList):
        stages = encoder

    def keep(number: int) -> Callable[..., None]:
        def hook(_module: nn.Module, _given: Any, output: Any) -> None:
            maps = getattr(output, "feature_maps", output)
            for place, values in enumerate([maps] if isinstance(maps, Tensor) else maps, number):
                while len(kept) <= place:
                    kept.append([])
                kept[place].append(values.detach())

        return hook

    parts = [encoder] if stages is None else list(stages)
    hooks = [part.register_forward_hook(keep(number)) for number, part in enumerate(parts)]
    try:
        yield kept
    finally:
        for hook in hooks:
            hook.remove()


def with_other_colors(frames: FrameTensors) -> FrameTensors:
    """Give each frame the colours of the one half of them away; all else stays."""
    rolled = frames.inputs.color.roll(len(frames) // 2, dims=0)
    return replace(frames, inputs=replace(frames.inputs, color=rolled))


def diagnose(
    network: nn.Module, kind: Network, frames: FrameTensors, batch_size: int
) -> dict[str, float]:
    """Measure whether a depth network sees, on at most `PROBED` of some frames, evenly spread.

    Gives `rank_1`, `rank_2`, ... of the stages of its first encoder, if it has one, and
    `color_gain_m`: by how much the RMSE, metres, grows with another frame's colours.
    """
    step = -(-len(frames) // PROBED)
    probed = frames.take(range(0, len(frames), step))
    first, *_ = [*kind.encoders_of(network).values(), nn.ModuleList()]
    with recorded_stages(first) as stages:
        own = mean_over_frames(evaluate(network, probed, batch_size)).rmse_m
    ranks = {f"rank_{n}": effective_rank(torch.cat(maps)) for n, maps in enumerate(stages, 1)}
    other = mean_over_frames(evaluate(network, with_other_colors(probed), batch_size)).rmse_m
    return ranks | {"color_gain_m": other - own}


def gradient_norms(network: nn.Module, encoders: Iterable[str]) -> dict[str, Tensor]:
    """Give the length of the gradient, `gradient_NAME`, of each encoder and other child."""
    parts: dict[str, list[Tensor]] = {}
    for name, weight in network.named_parameters():
        if weight.grad is None:
            continue
        encoder = next((path for path in encoders if name.startswith(path + ".")), None)
        parts.setdefault(encoder or name.split(".")[0], []).append(weight.grad)
    return {
        f"gradient_{part}": torch.stack([values.norm() for values in some]).norm()
        for part, some in parts.items()
    }
