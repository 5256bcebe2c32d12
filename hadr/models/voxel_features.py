"""Voxel features: what the points inside of an occupied voxel look like, as one vector a voxel.

Source: paper, "Ray and Voxel Feature Extraction" (early-stage point fusion); Zhou and Tuzel 2018,
"VoxelNet", for the encoder; the widths are those of the published code (book, chapter 4).
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.ray_voxels import segment_max


class VoxelFeatures(nn.Module):
    """Encode the points of each voxel; the order of the points does not matter.

    Each point becomes 32 numbers. With point fusion these are 16 from its position relative to the
    voxel's centre and 16 from the dense colour feature at its pixel; without, 32 from position and
    raw RGB together (the form of LIDF). Then, twice: layers on each point, the maximum in the
    voxel, and a layer on it; after the first time its vector goes back to each of the points.

    Args:
        point_fusion: Take the dense colour feature of each point (True) or its raw RGB (False).
        color_channels: Channels of the dense colour feature; without point fusion not used.
        width: Length of a voxel's feature.
        voxel_relu: End both layers on voxels in a ReLU (ledger, row 28).
    """

    def __init__(
        self,
        point_fusion: bool = True,
        color_channels: int = 32,
        width: int = 128,
        voxel_relu: bool = False,
    ) -> None:
        super().__init__()
        self.bend = functional.relu if voxel_relu else nn.Identity()
        self.point_fusion = point_fusion
        self.width = width
        if point_fusion:
            self.embed_position = nn.Linear(3, 16)
            self.embed_color = nn.Linear(color_channels, 16)
        else:
            self.embed_both = nn.Linear(3 + 3, 32)
        self.lift = nn.Linear(32, 64)
        self.first_voxel = nn.Linear(64, 64)
        # One Linear 128 -> 128 on (point, voxel), split exactly: the voxel's half is computed once
        # a voxel instead of once a point.
        self.mix_point = nn.Linear(64, 128)
        self.mix_voxel = nn.Linear(64, 128, bias=False)
        self.mix = nn.Linear(128, 128)
        self.last_voxel = nn.Linear(128, width)

    def forward(
        self, points: Tensor, color: Tensor, point_voxel: Tensor, centers: Tensor
    ) -> Tensor:
        """Compute the feature of each voxel.

        Args:
            points: Points in metres, camera frame, shape (N, 3).
            color: Per point the dense colour feature, shape (N, color_channels), or without point
                fusion its RGB in 0..1, shape (N, 3).
            point_voxel: Row of each point's voxel, shape (N,), long; points with -1 are left out.
            centers: Centres of the voxels in metres, camera frame, shape (V, 3).

        Returns:
            Voxel features, shape (V, width).
        """
        kept = (point_voxel >= 0).nonzero().squeeze(1)
        voxel = point_voxel[kept]
        relative = points.index_select(0, kept) - centers.index_select(0, voxel)  # (points, 3)
        color = color.index_select(0, kept)
        n_voxels = len(centers)

        if self.point_fusion:
            position = torch.relu(self.embed_position(relative))  # (points, 16)
            color = torch.relu(self.embed_color(color))  # (points, 16)
            point = torch.cat((position, color), dim=1)  # (points, 32)
        else:
            point = torch.relu(self.embed_both(torch.cat((relative, color), dim=1)))
        point = torch.relu(self.lift(point))  # (points, 64)
        in_voxel = self.bend(self.first_voxel(segment_max(point, voxel, n_voxels)))  # (voxels, 64)
        from_voxel = self.mix_voxel(in_voxel).index_select(0, voxel)  # (points, 128)
        point = torch.relu(self.mix_point(point) + from_voxel)  # (points, 128)
        point = torch.relu(self.mix(point))  # (points, 128)
        result: Tensor = self.bend(self.last_voxel(segment_max(point, voxel, n_voxels)))
        return result  # (voxels, width)
