"""The cube around the hand that the keypoint network looks at, and the way into it and back.

A cube of 300 mm is laid around the hand's centre. In it a point has the coordinates (u, v, d): its
pixel relative to the centre's, and its depth relative to the centre's, each divided so that the
cube's sides are at -1 and 1. The crop shows the hand at one size, wherever it is held.

Source: reference, "Adaptive weighting regression": crop around the hand, 300 mm cube in [-1, 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from hadr.models.hand.crop import sample_at
from hadr.models.network_input import ray_points

BESIDE = 1 / 64
"""Hand pixels at most this share of the picture's width and 16/9 of it of its height away from
the object give the hand's centre: 4 pixels of 256 x 144."""


@dataclass(frozen=True)
class HandCube:
    """The cubes of a batch.

    Attributes:
        center: Centre of each cube in metres, camera frame, shape (B, 3).
        intrinsics: fx, fy, cx, cy of each frame in pixels, shape (B, 4).
        side_m: Side of the cubes in metres.
        size: Side of the crops in pixels.
    """

    center: Tensor
    intrinsics: Tensor
    side_m: float
    size: int

    def crop(self, depth: Tensor) -> Tensor:
        """Cut the crops out of depth images (B, H, W), metres, each pixel from the nearest one.

        Returns:
            Depth in the cube, -1 = its front, shape (B, 1, size, size); 1 where depth is missing,
            outside of the image, and before or behind the cube.
        """
        middle, reach = self._middle_and_reach()
        across = (torch.arange(self.size, device=depth.device) + 0.5) * (2 / self.size) - 1
        u = middle[:, :1] + across * reach[:, :1]  # (B, size)
        v = middle[:, 1:] + across * reach[:, 1:]  # (B, size)
        found = sample_at(depth[:, None], u, v, "nearest")  # (B, 1, size, size)
        relative = (found - self.center[:, 2, None, None, None]) / (self.side_m / 2)
        inside = (found > 0) & (relative > -1) & (relative < 1)
        return torch.where(inside, relative, torch.ones_like(relative))

    def points(self, crop: Tensor, stride: int = 1) -> tuple[Tensor, Tensor]:
        """Give the surface point (u, v, d) of every n-th pixel of what `crop` gave, (B, 3, h, w).

        And which of them are on a surface in the cube, (B, h, w), bool.
        """
        depth = crop[:, 0, ::stride, ::stride]  # (B, h, w)
        across = (torch.arange(0, self.size, stride, device=crop.device) + 0.5) * (
            2 / self.size
        ) - 1
        u = across[None, None, :].expand_as(depth)
        v = across[None, :, None].expand_as(depth)
        return torch.stack((u, v, depth), dim=1), depth < 1

    def into(self, points: Tensor) -> Tensor:
        """Bring points of the camera frame, metres, (B, N, 3), into the cubes: (u, v, d)."""
        middle, reach = self._middle_and_reach()
        focal, principal = self.intrinsics[:, None, :2], self.intrinsics[:, None, 2:]
        pixels = points[..., :2] / points[..., 2:] * focal + principal  # (B, N, 2)
        uv = (pixels - middle[:, None]) / reach[:, None]
        d = (points[..., 2:] - self.center[:, None, 2:]) / (self.side_m / 2)
        return torch.cat((uv, d), dim=-1)

    def out_of(self, places: Tensor) -> Tensor:
        """Bring points (u, v, d) of the cubes, (B, N, 3), back; the inverse of `into`."""
        middle, reach = self._middle_and_reach()
        focal, principal = self.intrinsics[:, None, :2], self.intrinsics[:, None, 2:]
        z = self.center[:, None, 2:] + places[..., 2:] * (self.side_m / 2)  # (B, N, 1)
        pixels = middle[:, None] + places[..., :2] * reach[:, None]
        return torch.cat(((pixels - principal) / focal * z, z), dim=-1)

    def _middle_and_reach(self) -> tuple[Tensor, Tensor]:
        """Pixel of each centre, and pixels from there to the cube's side: (B, 2) both."""
        focal, principal = self.intrinsics[:, :2], self.intrinsics[:, 2:]
        z = self.center[:, 2:]
        return self.center[:, :2] / z * focal + principal, focal * (self.side_m / 2) / z


def hand_center(depth: Tensor, hand: Tensor, held: Tensor, intrinsics: Tensor) -> Tensor:
    """Find the hand's centre without knowing its keypoints: camera frame, metres, (B, 3).

    The mask of a hand, (B, H, W) bool, goes on along the arm, whose middle is no hand. But the hand
    holds the object (`held`, which may be empty): the centre is the median of the hand's points
    beside the object, or of all of them where none is. ValueError for a hand without any depth.
    """
    seen = hand & (depth > 0)
    blind = (~seen.flatten(1).any(dim=1)).nonzero().flatten()
    if len(blind):
        number = int(blind[0])
        raise ValueError(
            f"frame {number} of the batch shows no hand: of the {int(hand[number].sum())} pixels "
            "of its hand mask none has a depth"
        )
    height, width = depth.shape[1:]
    rows, columns = round(height * BESIDE * 16 / 9), round(width * BESIDE)
    above = functional.max_pool2d(held.float(), (2 * rows + 1, 1), 1, (rows, 0))
    around = functional.max_pool2d(above, (1, 2 * columns + 1), 1, (0, columns))  # (B, H, W)
    beside = seen & (around > 0)
    centers = []
    for number in range(len(depth)):
        chosen = beside[number] if bool(beside[number].any()) else seen[number]
        pixels = functional.pad(chosen.nonzero(), (1, 0))  # (n, 3), all of a frame 0
        z = depth[number, pixels[:, 1], pixels[:, 2]]
        points = ray_points(pixels, z, intrinsics[number : number + 1])  # (n, 3)
        centers.append(points.quantile(0.5, dim=0))
    return torch.stack(centers)
