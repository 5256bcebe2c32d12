"""What the training loop needs to know of a network: how to build, score and validate it.

One loop (`hadr.training.loop`) trains every network. What differs from one network to the next is
the module that the table of networks (`hadr.models.networks`) names for its training: a function
(see `Loss`), `losses` if nothing else is said, and, where the network does not restore depth, a
function `validate(model, frames, batch_size)`.

From its generator a loss takes numbers for the batch, such as where strided rays begin; frames are
augmented by the loop, each from its own seed.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from hadr.metrics import mean_over_frames
from hadr.models.networks import network_of
from hadr.training.evaluation import evaluate
from hadr.training.frames.batches import FrameTensors
from hadr.training.recipe import Preset
from hadr.training.tasks.diagnosis import diagnose

Loss = Callable[[Preset, nn.Module, FrameTensors, int, torch.Generator], dict[str, Tensor]]
"""Scores a batch in training: recipe, network (called as a whole, never its parts), some frames,
augmented already, the epoch's number from 0, and a source of numbers for the whole batch. Of what
it gives "loss" is minimised and the rest watched; one number each, each mean a `mean_of`."""


class Task:
    """A network as the loop sees it.

    Args:
        recipe: The network and its schedule.

    Raises:
        ValueError: There is no such network, or its configuration is that of another one.
    """

    def __init__(self, recipe: Preset) -> None:
        self.recipe, self.kind = recipe, network_of(recipe.network)
        if not isinstance(recipe.model, self.kind.config_class()):
            raise ValueError(
                f"recipe {recipe.name!r} of {recipe.network!r} must have a {self.kind.config}, "
                f"got {type(recipe.model).__name__}"
            )
        self._module = importlib.import_module(self.kind.training)
        self.restores_depth = self.kind.answer == "depth"

    def build(self) -> nn.Module:
        """Build the network with fresh weights from torch's seeded generator, or named ones."""
        network: nn.Module = self.kind.network_class()(self.recipe.model)
        return network

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch in training, see `Loss`."""
        loss: Loss = getattr(self._module, self.kind.loss)
        return loss(self.recipe, model, batch, epoch, generator)

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the network: numbers by name, of which the first decides; smaller is better."""
        validate: Any = getattr(self._module, "validate", validate_depth)
        scores: dict[str, float] = validate(model, frames, batch_size)
        if self.restores_depth:
            scores |= diagnose(model, self.kind, frames, batch_size)
        return scores


def validate_depth(model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
    """Score restored depth on the object's pixels at the frames' own size, per-frame means."""
    scores = mean_over_frames(evaluate(model, frames, batch_size))
    return {
        "validation_rmse_m": scores.rmse_m,
        "validation_mae_m": scores.mae_m,
        "validation_delta_105": scores.delta_105,
    }
