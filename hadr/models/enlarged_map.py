"""A coarse feature map that stands for its bilinear enlargement, which is never made.

The backbone's features live on a grid of a quarter of the image's resolution. Rays and points need
them at single pixels of the full resolution, and means over small blocks of pixels. Both are sums
of a few coarse cells with known weights. A bilinear resize is separable, so along each axis it is
a matrix (pixels, cells), and so is the mean of each block of pixels: `EnlargedMap` multiplies
with these matrices where somebody looks. The results are those of the enlarged map, up to rounding.

A picture's height need not be a whole number of cells: the last one may reach beyond its end. A map
is therefore enlarged by the side of its cells and then cut, never squeezed into the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional


@dataclass(frozen=True)
class EnlargedMap:
    """A map (B, C, height, width) that is known by its coarse form alone.

    Args:
        coarse: Features on the coarse grid, shape (B, C, h, w).
        height: Height that the map stands for, pixels.
        width: Width that the map stands for, pixels.
        cell: Side of a coarse cell, pixels; the last ones may reach beyond the map.
    """

    coarse: Tensor
    height: int
    width: int
    cell: int

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(B, C, height, width)."""
        return self.coarse.shape[0], self.coarse.shape[1], self.height, self.width

    def dense(self) -> Tensor:
        """Make the map: (B, C, height, width)."""
        return enlarge(self.coarse, self.cell, (self.height, self.width))

    def at(self, pixels: Tensor) -> Tensor:
        """Look up the features of single pixels.

        Args:
            pixels: Rows (frame, row, column), shape (N, 3), long.

        Returns:
            Features, shape (N, C).
        """
        frame, row, column = pixels.unbind(dim=1)
        _, channels, cells, across = self.coarse.shape
        to_columns = enlargement(across, self.cell, self.width, self.coarse)  # (width, w)
        wide = to_columns @ self.coarse.permute(0, 2, 3, 1)  # (B, h, width, C)
        rows = wide.reshape(-1, channels)  # (B * h * width, C)
        # In row y lies the point (y + 0.5) / cell - 0.5 of the coarse grid, at least 0.
        position = ((row.to(rows.dtype) + 0.5) / self.cell - 0.5).clamp(min=0)
        upper = position.floor().long()
        below = (position - upper).unsqueeze(1)
        lower = (upper + 1).clamp(max=cells - 1)
        first, second = (
            rows.index_select(0, (frame * cells + cell) * self.width + column)
            for cell in (upper, lower)
        )  # (N, C)
        return torch.lerp(first, second, below)

    def block_means(self, frame: Tensor, top: Tensor, left: Tensor, side: int) -> list[Tensor]:
        """Average square blocks of pixels at several places of each of N boxes.

        Args:
            frame: Frame of each box, shape (N,), long.
            top: Upper rows of the blocks, shape (K, N), long; each block lies in the map.
            left: Left columns of the blocks, shape (K, N), long.
            side: Rows and columns of a block.

        Returns:
            K tensors of block means, each of shape (N, C).
        """
        if frame.numel() == 0:
            empty = self.coarse.new_zeros(0, self.coarse.shape[1])
            return [empty for _ in range(len(top))]
        # Only the part of the image in which blocks lie is computed.
        first_row, first_column = int(top.min()), int(left.min())
        rows = slice(first_row, int(top.max()) + 1)
        columns = slice(first_column, int(left.max()) + 1)
        _, channels, cells, across = self.coarse.shape
        like, cell = self.coarse, self.cell
        to_rows = block_enlargement(cells, cell, self.height, side, like)[rows]  # (Y, h)
        to_columns = block_enlargement(across, cell, self.width, side, like)[columns]  # (X, w)
        wide = to_columns @ self.coarse.permute(0, 2, 3, 1)  # (B, h, X, C)
        means = to_rows @ wide.flatten(2)  # (B, Y, X * C)
        height, width = len(to_rows), len(to_columns)
        flat = means.view(-1, channels)  # (B * Y * X, C)
        places = (frame * height + top - first_row) * width + left - first_column  # (K, N)
        return [flat.index_select(0, place) for place in places]


def enlarge(features: Tensor, factor: int, size: Sequence[int]) -> Tensor:
    """Resize bilinearly by a whole factor, then cut off what reaches beyond the picture.

    Args:
        features: Shape (B, C, h, w).
        factor: Pixels that a cell becomes, along each axis.
        size: Height and width to cut to, at most (h * factor, w * factor).

    Returns:
        Shape (B, C, height, width), as `size` says.
    """
    if factor > 1:
        features = functional.interpolate(
            features, scale_factor=factor, mode="bilinear", align_corners=False
        )
    return features[:, :, : size[0], : size[1]]


def enlargement(cells: int, cell: int, pixels: int, like: Tensor) -> Tensor:
    """Give `enlarge` along one axis as a matrix.

    Args:
        cells: Number of values before.
        cell: Pixels that a value becomes.
        pixels: Number of values that are kept.
        like: Tensor whose type and device the matrix takes.

    Returns:
        Shape (pixels, cells); each row sums to one.
    """
    one = torch.eye(cells, dtype=like.dtype, device=like.device)[None]
    resized = functional.interpolate(one, scale_factor=cell, mode="linear", align_corners=False)
    return resized[0].T[:pixels]


def block_enlargement(cells: int, cell: int, pixels: int, side: int, like: Tensor) -> Tensor:
    """Give the enlargement and then the mean of `side` neighbours: (pixels - side + 1, cells)."""
    means = functional.avg_pool1d(enlargement(cells, cell, pixels, like).T[None], side, stride=1)
    return means[0].T
