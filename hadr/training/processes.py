"""Where a network is trained, and by how many processes: who sees which frames, how they agree.

Each step has one batch for all. A process takes a stretch of it, and after the backward pass the
gradients are averaged, so that all processes make the same step. Batch normalisation takes the
statistics of the whole batch; `torch.nn.SyncBatchNorm` does the same on GPUs only.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning_fabric.plugins.environments.lightning import LightningEnvironment
from lightning_fabric.strategies.ddp import DDPStrategy
from torch import Tensor, distributed, nn
from torch.nn import functional


def chosen_accelerator(wish: str) -> str:
    """Give "cuda" or "cpu" for "auto", "cpu" or "cuda"; ValueError for a CUDA that is not there."""
    cuda = torch.cuda.is_available()
    if wish == "cuda" and not cuda:
        raise ValueError("--accelerator cuda: PyTorch finds no CUDA device on this machine")
    return "cuda" if cuda and wish != "cpu" else "cpu"


class OneMachine(DDPStrategy):
    """Processes that meet at a file and talk over the loopback: no other machine reaches them.

    PyTorch's own meeting place would listen on all addresses, without a login.
    """

    def __init__(self, meeting: Path) -> None:
        super().__init__()
        self.meeting = meeting

    def setup_environment(self) -> None:
        """Connect the processes that Fabric starts; torchrun has connected its own."""
        if isinstance(self.cluster_environment, LightningEnvironment):
            for library in ("GLOO", "NCCL"):
                os.environ.setdefault(f"{library}_SOCKET_IFNAME", socket.if_indextoname(1))
            distributed.init_process_group(
                "nccl" if self.root_device.type == "cuda" else "gloo",
                store=distributed.FileStore(  # type: ignore[attr-defined]
                    str(self.meeting), self.num_processes
                ),
                rank=self.cluster_environment.local_rank(),
                world_size=self.num_processes,
            )
        super().setup_environment()


@dataclass(frozen=True)
class Share:
    """A process's stretch of a step's batch, as positions in the epoch's order.

    Attributes:
        start: First frame of the stretch.
        stop: One past its last frame.
        batch_start: First frame of the whole batch.
        batch_size: Frames in the whole batch.
    """

    start: int
    stop: int
    batch_start: int
    batch_size: int


def shares(frames: int, batch_size: int, process: int, processes: int) -> list[Share]:
    """Cut an epoch into steps and each step into stretches as even as possible.

    Gives the stretch of process number `process`, from 0, of each step of `batch_size` frames of
    all processes together. The last may be smaller; one with fewer frames than processes is left
    out.
    """
    found = []
    for first in range(0, frames, batch_size):
        size = min(batch_size, frames - first)
        if size < processes:
            break
        start, stop = (first + size * number // processes for number in (process, process + 1))
        found.append(Share(start, stop, first, size))
    return found


def average_gradients(network: nn.Module, processes: int) -> None:
    """Replace each gradient by its mean over the processes; where some have none, theirs is 0."""
    if processes == 1:
        return
    weights = [weight for weight in network.parameters() if weight.requires_grad]
    has = torch.tensor([float(weight.grad is not None) for weight in weights])
    parts = [
        (torch.zeros_like(weight) if weight.grad is None else weight.grad).flatten()
        for weight in weights
    ]
    flat = torch.cat([*parts, has.to(parts[0])])
    distributed.all_reduce(flat)
    *means, has = torch.split(flat, [*(weight.numel() for weight in weights), len(weights)])
    for weight, total, count in zip(weights, means, has.tolist(), strict=True):
        weight.grad = (total / processes).view_as(weight) if count > 0 else None


def average_numbers(numbers: Mapping[str, Tensor], processes: int) -> dict[str, float]:
    """Give each number's mean over the processes as a float."""
    values = torch.stack([value.detach().float() for value in numbers.values()])
    if processes > 1:
        distributed.all_reduce(values)
        values = values / processes
    return dict(zip(numbers, values.tolist(), strict=True))


class _SumOverProcesses(torch.autograd.Function):
    """The sum over the processes; what each process's loss owes to it flows back to all."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        total = values.clone()
        distributed.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        total = gradients[0].clone()
        distributed.all_reduce(total)
        return total


def _sum_over_processes(values: Tensor) -> Tensor:
    total: Tensor = _SumOverProcesses.apply(values)  # type: ignore[no-untyped-call]
    return total


class SharedBatchNorm(nn.modules.batchnorm._BatchNorm):
    """Batch normalisation with the mean and variance of the batch of all processes.

    It stands for one with weights, running statistics and a momentum; the networks have no other.
    """

    running_mean: Tensor
    running_var: Tensor
    num_batches_tracked: Tensor
    momentum: float

    def forward(self, values: Tensor) -> Tensor:
        """Normalise values of shape (B, C, ...)."""
        if not self.training:
            return functional.batch_norm(
                values, self.running_mean, self.running_var, self.weight, self.bias, eps=self.eps
            )
        axes = [axis for axis in range(values.ndim) if axis != 1]
        shape = [1, -1, *[1] * (values.ndim - 2)]
        own = values.new_tensor([values.numel() / values.shape[1]])
        sums = _sum_over_processes(torch.cat((values.sum(axes), own)))  # (C + 1,)
        count = sums[-1].detach()
        mean = sums[:-1] / count  # (C,)
        deviation = values - mean.view(shape)  # (B, C, ...)
        squares = _sum_over_processes(deviation.square().sum(axes))  # (C,)
        variance = squares / count  # (C,)
        self._follow(mean.detach(), variance.detach() * count / (count - 1).clamp(min=1))
        normal = deviation * torch.rsqrt(variance + self.eps).view(shape)
        scaled: Tensor = normal * self.weight.view(shape) + self.bias.view(shape)
        return scaled

    def _follow(self, mean: Tensor, variance: Tensor) -> None:
        """Move the running statistics towards those of this batch."""
        self.num_batches_tracked.add_(1)
        self.running_mean.lerp_(mean.to(self.running_mean.dtype), self.momentum)
        self.running_var.lerp_(variance.to(self.running_var.dtype), self.momentum)


def share_batch_norm(model: nn.Module) -> None:
    """Put `SharedBatchNorm` in each batch normalisation's place, with its weights and names."""
    for module in model.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.__class__ = SharedBatchNorm  # keeps weights, mode, precision and device
