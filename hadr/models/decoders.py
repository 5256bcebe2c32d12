"""The two decoders of a ray-voxel pair, the positional encoding and the activation they end with.

A pair's embedding is the concatenation of what belongs to its ray, its voxel and itself. The first
layer of a decoder is linear, so its product with the concatenation is the sum of three products;
the ray's and the voxel's are computed once for each ray and voxel instead of once for each pair.

Source: paper, "Depth Prediction" and equation 2; the widths are those of the published code.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

SLOPE = 0.02
"""Slope of the decoders' LeakyReLU for negative values."""


def encode_position(values: Tensor, levels: int) -> Tensor:
    """Append to (N, D) sines and cosines of rising frequency: gamma in the paper.

    Frequencies are 2^0, ..., 2^(levels - 1) radians per unit (no pi). Gives (N, D (1 + 2 levels)):
    the values, then sine and cosine of each frequency.
    """
    parts = [values]
    for level in range(levels):
        parts += [torch.sin(values * 2**level), torch.cos(values * 2**level)]
    return torch.cat(parts, dim=1)


def leaky_clamp(values: Tensor) -> Tensor:
    """Keep values in about 0..1 with a slope of 0.01 outside: max(min(x, .01 x + .99), .01 x)."""
    return torch.maximum(torch.minimum(values, 0.01 * values + 0.99), 0.01 * values)


class SplitLinear(nn.Linear):
    """A Linear on the concatenation of `parts`, given by their widths, computed part by part.

    The weights are one matrix, the same as those of `nn.Linear(sum(parts), out)`; `part` multiplies
    with the columns of one part, and the sum over all parts plus the bias is the Linear's output.
    """

    def __init__(self, parts: Sequence[int], out: int) -> None:
        super().__init__(sum(parts), out)
        self.parts = tuple(parts)

    def part(self, number: int, values: Tensor) -> Tensor:
        """Multiply one part with its columns, without the bias: (N, parts[n]) to (N, out)."""
        start = sum(self.parts[:number])
        return functional.linear(values, self.weight[:, start : start + self.parts[number]])


class PairDecoder(nn.Module):
    """An MLP from a pair's embedding to one number.

    Args:
        parts: Widths of the embedding's parts; the first three are ray, voxel and pair.
        hidden: Widths of the hidden layers.
        last_bias: Start of the last layer's bias; None leaves it random.
    """

    def __init__(
        self, parts: Sequence[int], hidden: Sequence[int], last_bias: float | None = None
    ) -> None:
        super().__init__()
        self.first = SplitLinear(parts, hidden[0])
        widths = [*hidden, 1]
        self.rest = nn.ModuleList(nn.Linear(width, out) for width, out in pairwise(widths))
        if last_bias is not None:
            nn.init.constant_(self.rest[-1].bias, last_bias)  # type: ignore[arg-type]

    def begin(
        self, ray: Tensor, voxel: Tensor, pair: Tensor, ray_of: Tensor, voxel_of: Tensor
    ) -> Tensor:
        """Compute the first layer, before its activation, of each pair: (pairs, hidden[0]).

        From what belongs to the rays, (rays, parts[0]), the voxels, (voxels, parts[1]), and the
        pairs alone, (pairs, parts[2]), and each pair's ray and voxel, (pairs,), long.
        """
        from_ray = self.first.part(0, ray).index_select(0, ray_of)  # (pairs, 256)
        from_voxel = self.first.part(1, voxel).index_select(0, voxel_of)  # (pairs, 256)
        return from_ray + from_voxel + self.first.part(2, pair) + self.first.bias

    def finish(self, first: Tensor) -> Tensor:
        """Go on from the first layer to the output: (pairs, hidden[0]) to (pairs,)."""
        values = first
        for layer in self.rest:
            values = layer(functional.leaky_relu(values, SLOPE))  # 256 -> 128 -> 64 -> 1
        return values.squeeze(1)


class OffsetDecoder(nn.Module):
    """Where along the ray the surface lies in the voxel, refined in steps.

    The offset starts at 0.001; each step sees the embedding and the current offset and adds to it.
    It ends with the leaky clamp, so an offset outside of 0..1 still has a gradient. The last bias
    starts at 0.5 / steps: after all steps a fresh network says about the middle of the range, and
    no offset starts clamped, which would leave the decoder a hundredth of its gradient.

    Args:
        parts: Widths of ray, voxel and pair part.
        hidden: Widths of the hidden layers.
        steps: How often the decoder runs.
    """

    start = 0.001
    offset_width = 16

    def __init__(self, parts: Sequence[int], hidden: Sequence[int], steps: int = 2) -> None:
        super().__init__()
        self.steps = steps
        self.embed_offset = nn.Linear(1, self.offset_width)
        self.decoder = PairDecoder((*parts, self.offset_width), hidden, last_bias=0.5 / steps)

    def forward(
        self, ray: Tensor, voxel: Tensor, pair: Tensor, ray_of: Tensor, voxel_of: Tensor
    ) -> Tensor:
        """Compute the offset of each pair, about 0..1; arguments as `PairDecoder.begin`."""
        first = self.decoder.begin(ray, voxel, pair, ray_of, voxel_of)  # (pairs, 256)
        offset = first.new_full((len(first),), self.start)
        for _ in range(self.steps):
            embedded = self.embed_offset(offset.unsqueeze(1))  # (pairs, 16)
            offset = offset + self.decoder.finish(first + self.decoder.first.part(3, embedded))
        return leaky_clamp(offset)
