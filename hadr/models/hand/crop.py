"""What the hand says before any network: how far away the object is, and a crop of its own scale.

A hand that holds a glass is at the glass's distance, up to a few centimetres. Networks that are
given the hand's depth as the zero of their depths only learn those centimetres, and an object of
which they know nothing else is no farther off than the hand.

A crop whose pixels span `pixel_m` metres at that depth shows an object at the same size wherever it
is held, so that its outline can be read as a shape in metres. What such a crop shows differs from
frame to frame by the object, not by the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from hadr.models.network_input import HADRInput


@dataclass(frozen=True)
class HandCrop:
    """Where the crops of a batch lie in their frames.

    Attributes:
        center: Centre of each crop in pixels of the frame (column, row), shape (B, 2).
        step: Pixels of the frame from one crop pixel to the next (column, row), shape (B, 2).
        prior: The hand's depth in metres, shape (B,): median z-depth of its keypoints.
        size: Side of the crops in pixels.
    """

    center: Tensor
    step: Tensor
    prior: Tensor
    size: int

    def sample(self, images: Tensor, mode: str = "nearest") -> Tensor:
        """Cut the crops (B, C, size, size) out of images (B, C, H, W); zeros outside of them."""
        offset = torch.arange(self.size, device=images.device) - (self.size - 1) / 2
        u = self.center[:, :1] + offset * self.step[:, :1]  # (B, size)
        v = self.center[:, 1:] + offset * self.step[:, 1:]  # (B, size)
        return sample_at(images, u, v, mode)

    def spread(self, crops: Tensor, size: Sequence[int]) -> tuple[Tensor, Tensor]:
        """Interpolate crops (B, C, size, size) at all pixels of frames of (rows, columns).

        Gives (B, C, H, W), beyond the border the border's values, and which pixels lie inside.
        """
        rows, columns = (torch.arange(n, device=crops.device, dtype=crops.dtype) for n in size)
        pixels = torch.stack(torch.meshgrid(columns, rows, indexing="xy"), dim=-1)  # (H, W, 2)
        step, center = self.step[:, None, None], self.center[:, None, None]  # (B, 1, 1, 2)
        at = 2 * (pixels - center) / step / self.size  # (B, H, W, 2): -1..1 inside
        found = functional.grid_sample(crops, at, padding_mode="border", align_corners=False)
        return found, (at.abs() < 1).all(dim=-1)

    def place(self, pixels: Tensor, frame: Tensor) -> Tensor:
        """Bring pixels (column, row), (N, 2), of frames (N,) into their crops: 0..size-1 inside."""
        center, step = self.center.index_select(0, frame), self.step.index_select(0, frame)
        return (pixels - center) / step + (self.size - 1) / 2

    def look_up(self, crops: Tensor, rays: Tensor) -> Tensor:
        """Interpolate crops (B, C, size, size) at pixels (frame, row, column), (R, 3) long: (R, C).

        Beyond the border are the border's values.
        """
        at = self.place(rays[:, [2, 1]].to(crops.dtype), rays[:, 0])
        at = at.clamp(0, self.size - 1)
        low = at.floor().clamp(max=self.size - 2).long()
        part = at - low  # (R, 2)
        frame = rays[:, 0]
        total = crops.new_zeros(len(rays), crops.shape[1])
        for right in (0, 1):
            for down in (0, 1):
                weight = (part[:, 0] if right else 1 - part[:, 0]) * (
                    part[:, 1] if down else 1 - part[:, 1]
                )
                value = crops[frame, :, low[:, 1] + down, low[:, 0] + right]  # (R, C)
                total = total + weight[:, None] * value
        return total


def sample_at(images: Tensor, u: Tensor, v: Tensor, mode: str) -> Tensor:
    """Sample images (B, C, H, W) in columns u and rows v, pixels (B, S), zeros outside of them."""
    height, width = images.shape[2:]
    x = ((2 * u + 1) / width - 1)[:, None, :].expand(-1, v.shape[1], -1)
    y = ((2 * v + 1) / height - 1)[:, :, None].expand(-1, -1, u.shape[1])
    grid = torch.stack((x, y), dim=-1)  # (B, S, S, 2)
    return functional.grid_sample(images, grid, mode=mode, align_corners=False)


def hand_crop(inputs: HADRInput, size: int, pixel_m: float) -> HandCrop:
    """Lay crops of so many pixels around each frame's mask; around the centre where it is empty.

    A crop pixel spans `pixel_m` metres at the hand's depth; ValueError for a frame without a hand.
    """
    prior = hand_depth(inputs)
    center = torch.stack([_middle(inputs.mask.any(dim=1)), _middle(inputs.mask.any(dim=2))], dim=1)
    return HandCrop(center, pixel_m * inputs.intrinsics[:, :2] / prior[:, None], prior, size)


def _middle(occupied: Tensor) -> Tensor:
    """Middle between the first and the last True of each row: (B, N) bool to (B,)."""
    count = occupied.shape[1]
    flags = occupied.to(torch.uint8)
    first = flags.argmax(dim=1)
    last = count - 1 - flags.flip(1).argmax(dim=1)
    middle = (first + last) / 2
    empty = torch.full_like(middle, (count - 1) / 2)
    return torch.where(occupied.any(dim=1), middle, empty)


def hand_depth(inputs: HADRInput) -> Tensor:
    """Give the hand's depth, the median z-depth of its 21 keypoints, in metres: (B,).

    Raises:
        ValueError: A frame has no hand in front of the camera.
    """
    median: Tensor = inputs.keypoints[:, :, 2].median(dim=1).values  # (B,)
    absent = (~(median > 0)).nonzero().flatten()
    if len(absent):
        number = int(absent[0])
        raise ValueError(
            f"frame {number} of the batch has no hand in front of the camera: the median depth of "
            f"its keypoints is {float(median[number]):.3g} m"
        )
    return median


def relative_depth(depth: Tensor, hand: Tensor, reach: float) -> Tensor:
    """Turn measured depth into two pictures: how far from the hand's, and whether it is near.

    From z-depth (B, H, W), 0 = missing, and the hand's (B,), metres, to (B, 2, H, W): the
    difference in units of `reach`, cut off at -1 and 1 and 0 where depth is missing; 1 where it is
    within `reach`.
    """
    difference = (depth - hand[:, None, None]) / reach  # (B, H, W)
    known = (depth > 0).to(depth.dtype)
    near = known * (difference.abs() < 1)
    return torch.stack((difference.clamp(-1, 1) * known, near), dim=1)


def keypoint_maps(
    uv: Tensor,
    height: Tensor,
    size: tuple[int, int],
    radius: float,
    groups: Sequence[Sequence[int]] = (tuple(range(21)),),
) -> Tensor:
    """Draw keypoints as blobs, `radius` pixels their standard deviation: (B, 2 G, rows, columns).

    For each of G groups of keypoints' numbers that share a picture the sum of its blobs, then for
    each of them the sum of the blobs times their values, (B, 21), such as their relative depth.
    Their pixels are (column, row), (B, 21, 2), the pictures' size is (rows, columns).
    """
    rows, columns = (torch.arange(n, device=uv.device, dtype=uv.dtype) for n in size)
    across = torch.exp(-((uv[:, :, :1] - columns) ** 2) / (2 * radius**2))  # (B, 21, columns)
    along = torch.exp(-((uv[:, :, 1:] - rows) ** 2) / (2 * radius**2))  # (B, 21, rows)
    maps = []
    for value in (torch.ones_like(height), height):
        for group in map(list, groups):
            row = along[:, group] * value[:, group, None]  # (B, K, rows)
            maps.append(torch.einsum("bki,bkj->bij", row, across[:, group]))
    return torch.stack(maps, dim=1)
