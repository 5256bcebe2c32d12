"""Ray features: the dense colour features around a ray's pixel, by ROI align of an 8x8 box to 2x2.

Two forms of the same thing. `roi_align` is the published operation, written plainly and slowly,
for chapter 4 and the tests. `RayFeatures` uses that the box of every ray has the same size and
stands on whole pixels: each of the four bins is then the mean of 4x4 pixels, so one average pooling
of the map and four look-ups replace the sampling.

Coordinates of boxes here are ROI align's: continuous, pixel k covers [k, k + 1) and has its centre
at k + 0.5. (In the rest of the library integers are pixel centres: subtract 0.5.) The box of the
pixel in column x is [x - 4, x + 4]: the four columns left of the pixel, the pixel itself and three
columns right of it.

Source: paper, "Ray and Voxel Feature Extraction"; He et al. 2017, "Mask R-CNN", section 3.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

BOX = 8
"""Side of the box around a ray's pixel, pixels."""


def features_at(feature_map: Tensor, pixels: Tensor) -> Tensor:
    """Look up features (B, C, H, W) at pixels (frame, row, column), (N, 3) long: (N, C)."""
    _, channels, height, width = feature_map.shape
    frame, row, column = pixels.unbind(dim=1)
    rows = feature_map.permute(0, 2, 3, 1).reshape(-1, channels)  # (B * H * W, C)
    return rows.index_select(0, (frame * height + row) * width + column)


class RayFeatures(nn.Module):
    """ROI align of a box around each ray's pixel to 2x2, flattened; no weights.

    Equal to `roi_align` with `aligned=True` and the usual sampling of one point per pixel. At the
    border the box keeps its size and is pushed back until it lies in the image: a pixel nearer
    than half of it to the border gets the box of its nearest neighbour that has a whole one. (The
    published code cuts the box off instead, which gives bins of other sizes there.)
    """

    def boxes(self, pixels: Tensor, height: int, width: int) -> Tensor:
        """Give the boxes of pixels (frame, row, column), (R, 3) long, in a map of this size.

        They are (left, top, right, bottom) in ROI align's continuous coordinates, inside of the
        image, (R, 4), long; ValueError for an image that is smaller than the box.
        """
        if min(height, width) < BOX:
            raise ValueError(f"the feature map must be at least {BOX}x{BOX}, got {height}x{width}")
        half = BOX // 2
        top = pixels[:, 1].clamp(half, height - half) - half
        left = pixels[:, 2].clamp(half, width - half) - half
        return torch.stack((left, top, left + BOX, top + BOX), dim=1)

    def forward(self, feature_map: Tensor, pixels: Tensor) -> Tensor:
        """Compute the feature of each ray.

        Args:
            feature_map: Colour features at the image's resolution, shape (B, C, H, W).
            pixels: Rows (frame, row, column) of the rays' pixels, shape (R, 3), long.

        Returns:
            Shape (R, 4 * C): of each channel the bins upper left and right, lower left and right.
        """
        left, top, _, _ = self.boxes(pixels, *feature_map.shape[2:]).unbind(dim=1)
        half = BOX // 2
        tops = torch.stack((top, top, top + half, top + half))  # (4, rays)
        lefts = torch.stack((left, left + half, left, left + half))
        # Channels last in memory: the pooling is several times faster, the look-ups copy none.
        feature_map = feature_map.contiguous(memory_format=torch.channels_last)
        mean = functional.avg_pool2d(feature_map, kernel_size=half, stride=1)
        bins = [
            features_at(mean, torch.stack((pixels[:, 0], *corner), dim=1))
            for corner in zip(tops, lefts, strict=True)
        ]  # four of (rays, C)
        return torch.stack(bins, dim=2).flatten(1)  # (rays, 4 * C)


def _bin_weights(
    start: float, end: float, sampling: int, size: int, aligned: bool, dtype: torch.dtype
) -> Tensor:
    """Give, for one axis of one box, the weight of each pixel in both bins: (2, size)."""
    per_bin = sampling if sampling > 0 else max(1, math.ceil((end - start) / 2))
    step = (end - start) / (2 * per_bin)
    sample = start - 0.5 * aligned + (torch.arange(2 * per_bin, dtype=dtype) + 0.5) * step
    sample = sample.clamp(0, size - 1)
    pixel = torch.arange(size, dtype=dtype)
    weight = (1 - (sample[:, None] - pixel).abs()).clamp(min=0)  # bilinear
    return weight.reshape(2, per_bin, size).mean(dim=1)


def roi_align(
    feature_map: Tensor, boxes: Tensor, frame: Tensor, *, sampling: int = 0, aligned: bool = True
) -> Tensor:
    """ROI align to 2x2, as defined: the mean of bilinear samples in each bin. One box a time: slow.

    Bilinear sampling is separable, so each bin is a weighted sum of pixels with one weight per row
    times one weight per column.

    Args:
        feature_map: Features, shape (B, C, H, W).
        boxes: Boxes (left, top, right, bottom) in the image, in continuous pixel coordinates,
            shape (R, 4).
        frame: Frame of each box, shape (R,), long.
        sampling: Samples in a bin along each axis; 0 = one per pixel, ceil(bin size).
        aligned: Whether the centre of pixel k lies at k + 0.5 of the box's coordinates (True) or,
            as in the first implementations, at k.

    Returns:
        Bin means, shape (R, C, 2, 2).
    """
    _, channels, height, width = feature_map.shape
    feature_map = feature_map.contiguous()  # products of strided maps are a hundred times slower
    result = feature_map.new_zeros(len(boxes), channels, 2, 2)
    for i, (left, top, right, bottom) in enumerate(boxes.tolist()):
        dtype = feature_map.dtype
        rows = _bin_weights(top, bottom, sampling, height, aligned, dtype)
        columns = _bin_weights(left, right, sampling, width, aligned, dtype)
        result[i] = rows @ feature_map[frame[i]] @ columns.T
    return result
