"""What the training loop needs to know of a network: how to build, score and validate it.

One loop (`hadr.training.loop`) trains every network. What differs from one network to the next is
a class with the four members of `Task`, built from a `Preset`.

**Means.** With several processes each sees its share of a batch, and the loop averages their
gradients. An average of averages is the average over the whole batch only where each counts the
same. So every mean in `losses` is taken with `shared_mean(total, count)`.

**Chance.** A process must not draw other numbers than one that sees the whole batch: from the
generator a task takes numbers for the batch (such as where strided rays begin), never one a
frame. Frames are augmented by the loop, each from its own seed; random layers are
`hadr.models.blocks.stochastic_depth.StochasticDepth`.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, distributed, nn

from hadr.training.batches import FrameTensors

__all__ = ["PicturedTask", "Task", "shared_mean"]


class Task(Protocol):
    """A network as the loop sees it."""

    @property
    def network(self) -> str:
        """The network's kind: one of `hadr.training.presets.NETWORKS`."""

    def build(self) -> nn.Module:
        """Build the network with fresh weights from torch's seeded generator.

        It has an attribute `config`, a frozen dataclass with `to_dict` and `from_dict`.
        """

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch in training.

        Args:
            model: The network; call it as a whole, never its parts, so that gradients of several
                processes are averaged.
            batch: Some frames, augmented already.
            epoch: Number of the epoch; the first is 0.
            generator: Numbers for the whole batch; the same in each process.

        Returns:
            "loss" is minimised, the rest is watched; one number each, each mean a `shared_mean`.
        """

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the network on frames that it does not learn from.

        Args:
            model: The network in evaluation mode.
            frames: The frames.
            batch_size: Frames at a time.

        Returns:
            Numbers by name. The first decides which epoch is the best: smaller is better.
        """


@runtime_checkable
class PicturedTask(Protocol):
    """A task that can also draw what its network makes of a frame."""

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw the network's answer on a few frames beside the truth: RGB, (H, W, 3) uint8."""


def shared_mean(total: Tensor, count: Tensor | int) -> Tensor:
    """Divide a sum by how many entered it, so that processes average to the whole batch's mean.

    Each process divides its own sum by the mean of all processes' counts: the mean over the
    processes of the results is then the sum of all totals by the sum of all counts.

    Args:
        total: Sum over this process's share of the batch, any shape.
        count: How many entered it, one number.

    Returns:
        The shape of `total`; zeros where nothing counts. With one process: total / count.
    """
    number = torch.as_tensor(count, dtype=total.dtype, device=total.device).detach().clone()
    if distributed.is_available() and distributed.is_initialized():
        distributed.all_reduce(number)
        number = number / distributed.get_world_size()
    least = torch.finfo(total.dtype).tiny
    return torch.where(number > 0, total / number.clamp(min=least), torch.zeros_like(total))
