"""Batch normalisation over the batch of all processes.

`torch.nn.SyncBatchNorm` does the same on GPUs only. The statistics and their gradients go through
differentiable sums over the processes, so that the share that a process sees does not matter.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.nn import functional


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
    """Batch normalisation with the mean and variance of the batch of all processes."""

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
        if self.weight is None:
            return normal
        scaled: Tensor = normal * self.weight.view(shape) + self.bias.view(shape)
        return scaled

    def _check_input_dim(self, input: Tensor) -> None:
        """Any number of dimensions from two on."""

    def _follow(self, mean: Tensor, variance: Tensor) -> None:
        """Move the running statistics towards those of this batch."""
        if self.running_mean is None or self.running_var is None:
            return
        if self.num_batches_tracked is not None:
            self.num_batches_tracked.add_(1)
        momentum = self.momentum
        if momentum is None:
            momentum = 1 / float(self.num_batches_tracked or 1)
        self.running_mean.lerp_(mean.to(self.running_mean.dtype), momentum)
        self.running_var.lerp_(variance.to(self.running_var.dtype), momentum)


def share_batch_norm(model: nn.Module) -> None:
    """Put `SharedBatchNorm` in each batch normalisation's place, with its weights and names."""
    for module in model.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.__class__ = SharedBatchNorm  # keeps weights, mode, precision and device
