"""A square window around hand and glass, through which a network looks at a frame.

A glass covers a few per cent of a picture. Squashed to 128x128 pixels it has some 1,100 of them,
through a window of that size around glass and hand some 2,400 (medians of the 48 bundled test
frames, of 320x180, where it has 3,900). A window is a camera that really could have taken the
picture, one with a longer focal length that looks aside: depth, keypoints and rays in metres stay
what they are, and only pixels and intrinsics change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, TypeVar

import torch
from torch import Tensor

from hadr.models.hand.crop import HandCrop
from hadr.models.network_input import HADRInput, masked_rays

Forward = TypeVar("Forward", bound=Callable[..., Any])


@dataclass(frozen=True)
class WindowConfig:
    """How a network looks through a window.

    Args:
        size: Side of what it sees, pixels.
        margin: Side of the window, as a factor on the longer side of the box around the mask and
            the keypoints in the picture.
        jitter: In training the window is laid by chance: its side grows or shrinks by up to this
            share, and its centre moves by up to this share of its side in either direction. Masks
            and keypoints that are predicted lay it no better.
        hand: The box is around the keypoints too, not around the mask alone.
        whole: Share of the training frames that are seen as a whole, 0..1.

    Raises:
        ValueError: The size is not positive, the margin below 1, the jitter not in 0..0.5, or the
            share not in 0..1.
    """

    size: int = 128
    margin: float = 1.3
    jitter: float = 0.1
    hand: bool = True
    whole: float = 0.0

    def __post_init__(self) -> None:
        shares = 0 <= self.jitter <= 0.5 and 0 <= self.whole <= 1
        if self.size < 1 or self.margin < 1 or not shares:
            raise ValueError(
                "a window's size must be at least 1, its margin at least 1, its jitter 0 to 0.5 "
                f"and its whole 0 to 1, got {self.size}, {self.margin}, {self.jitter} and "
                f"{self.whole}"
            )


def lay_windows(
    inputs: HADRInput, config: WindowConfig, chance: torch.Generator | None = None
) -> HandCrop:
    """Lay a window in each frame; the whole picture where there is neither mask nor hand.

    Args:
        inputs: The frames.
        config: How to.
        chance: Where the jitter comes from; None lays the windows without.
    """
    height, width = inputs.mask.shape[1:]
    boxes = []
    for mask, uv in zip(inputs.mask, inputs.keypoints_uv, strict=True):
        rows, columns = mask.nonzero(as_tuple=True)
        pixels = torch.stack((columns, rows), dim=1).to(uv.dtype)  # (pixels, 2)
        known = (uv != 0).any(dim=1) & config.hand
        inside = ((uv >= 0) & (uv < uv.new_tensor([width, height]))).all(dim=1)
        pixels = torch.cat((pixels, uv[known & inside]))
        if not len(pixels):
            pixels = uv.new_tensor([[0, 0], [width - 1, height - 1]])
        boxes.append(torch.stack((pixels.amin(dim=0), pixels.amax(dim=0))))
    crop = windows_around(torch.stack(boxes), config)
    if chance is None:
        return crop
    draw = config.jitter * (2 * torch.rand(len(crop.center), 3, generator=chance) - 1)
    step = crop.step * (1 + draw[:, :1])
    center = crop.center + draw[:, 1:] * step * config.size
    whole = torch.rand(len(center), 1, generator=chance) < config.whole
    everything = whole_windows(inputs.color, config.size)
    return replace(
        crop,
        center=torch.where(whole, everything.center, center),
        step=torch.where(whole, everything.step, step),
    )


def windows_around(box: Tensor, config: WindowConfig) -> HandCrop:
    """Lay windows around boxes (B, 2, 2): first and last column and row that are inside."""
    side = config.margin * ((box[:, 1] - box[:, 0]).amax(dim=1, keepdim=True) + 1)  # (B, 1)
    step = (side / config.size).expand(-1, 2)
    return HandCrop(box.mean(dim=1), step, step.new_zeros(len(step)), config.size)


def whole_windows(images: Tensor, size: int) -> HandCrop:
    """Lay windows that hold whole images (B, C, H, W), with nothing beside the shorter side."""
    height, width = images.shape[2:]
    center = images.new_tensor([(width - 1) / 2, (height - 1) / 2], dtype=torch.float32)
    step = torch.full_like(center, max(height, width) / size)
    count = len(images)
    return HandCrop(center.expand(count, 2), step.expand(count, 2), step.new_zeros(count), size)


def seen_through(crop: HandCrop, inputs: HADRInput) -> HADRInput:
    """Give the frames as they are seen through their windows; zeros beyond the picture."""
    focal, middle = inputs.intrinsics[:, :2], inputs.intrinsics[:, 2:]
    known = (inputs.keypoints_uv != 0).any(dim=2, keepdim=True)  # (B, 21, 1)
    return HADRInput(
        color=crop.sample(inputs.color, "bilinear"),
        depth=nearest(crop, inputs.depth),
        mask=nearest(crop, inputs.mask),
        intrinsics=torch.cat((focal / crop.step, _inside(crop, middle[:, None])[:, 0]), dim=1),
        keypoints=inputs.keypoints,
        keypoints_uv=_inside(crop, inputs.keypoints_uv) * known,
    )


def nearest(crop: HandCrop, images: Tensor) -> Tensor:
    """Cut single-channel images (B, H, W) by their nearest pixels; 0 beyond the picture."""
    return crop.sample(images[:, None].float())[:, 0].to(images.dtype)


def _inside(crop: HandCrop, pixels: Tensor) -> Tensor:
    """Bring pixels (column, row) of the frames, (B, N, 2), into their windows."""
    return (pixels - crop.center[:, None]) / crop.step[:, None] + (crop.size - 1) / 2


def through_window(forward: Forward) -> Forward:
    """Let a depth network look through the window of its configuration, if that has one.

    In training the frames are windows already (`hadr.training.frames.augmentation`). Otherwise the
    network is given each frame's window, and its answer is put back into the frame: interpolated
    between those of the four pixels around that were restored, so that the outline has an answer
    too, where the window cuts the mask otherwise. Then `depth`, `restored` and `clamped` lie in the
    frame, and all other parts of the answer in the window.
    ValueError where rays or true depth are given, too.
    """

    @wraps(forward)
    def look(self: Any, inputs: HADRInput, **further: Any) -> Any:
        window: WindowConfig | None = self.config.view
        if window is None or self.training:
            return forward(self, inputs, **further)
        for name in ("rays", "true_depth"):
            if further.get(name) is not None:
                raise ValueError(f"{name} of the whole frame mean nothing in a network's window")
        crop = lay_windows(inputs, window)
        answer = forward(self, seen_through(crop, inputs), **further)
        parts = [answer.depth, answer.restored.to(answer.depth.dtype)]
        if hasattr(answer, "clamped"):
            parts.append(answer.clamped.to(answer.depth.dtype))
        rays = masked_rays(inputs.mask)  # (rays, 3)
        found = _put_back(crop, torch.stack(parts, dim=1), rays)  # (rays, 2 or 3)
        where, blank = rays.unbind(dim=1), torch.zeros_like(inputs.depth)
        names = ("depth", "restored", "clamped")
        images = {
            name: blank.index_put(where, values)
            for name, values in zip(names, found.unbind(dim=1), strict=False)
        }
        marks = {name: image > 0.5 for name, image in images.items() if name != "depth"}
        return replace(answer, depth=images["depth"], **marks)

    return look  # type: ignore[return-value]


def _put_back(crop: HandCrop, parts: Tensor, rays: Tensor) -> Tensor:
    """Look up depth and marks, (B, 2 or 3, S, S): means of the restored of four pixels around."""
    weighed = torch.cat((parts[:, :1] * parts[:, 1:2], parts[:, 1:]), dim=1)
    sums = crop.look_up(weighed, rays)  # (rays, 2 or 3)
    at = crop.place(rays[:, [2, 1]].to(parts.dtype), rays[:, 0])
    within = ((at > -0.5) & (at < crop.size - 0.5)).all(dim=1, keepdim=True)
    weight = sums[:, 1:2]
    return sums / weight.clamp(min=1e-3) * (within & (weight > 1e-3))
