"""Frames as tensors in memory: read, corrupted and resized once, then served in batches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import torch
from torch import Tensor

from hadr.camera import resize_depth, resize_mask
from hadr.corruption import CAPTURED, ORACLE, SENSOR, CorruptionConfig, corrupt
from hadr.data.augmentation import augment_color
from hadr.models.hadr import HADRInput, frame_to_input, stack_inputs

if TYPE_CHECKING:
    from hadr.data.transhand import Frame

Corruption = Literal["oracle", "analytic", "sensor"]
CORRUPTIONS: dict[str, CorruptionConfig] = {
    "oracle": ORACLE,
    "analytic": SENSOR,
    "sensor": CAPTURED,
}


@dataclass(frozen=True)
class FrameTensors:
    """Frames of one size, ready for the network.

    Attributes:
        inputs: What the network takes, N frames; its mask is the object's.
        true_depth: True z-depth in metres, shape (N, H, W); 0 = unknown.
        hand_mask: Pixels of hand and arm, shape (N, H, W), bool.
        stems: Name of each frame, "object/stem".
    """

    inputs: HADRInput
    true_depth: Tensor
    hand_mask: Tensor
    stems: tuple[str, ...]

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.stems)

    def take(self, frames: list[int]) -> FrameTensors:
        """Give some of the frames, by their indices."""
        index = torch.tensor(frames, dtype=torch.long)
        return FrameTensors(
            self.inputs.take(index),
            self.true_depth[index],
            self.hand_mask[index],
            tuple(self.stems[frame] for frame in frames),
        )


def load_frames(
    frames: Iterable[Frame],
    size: tuple[int, int],
    corruption: Corruption = "oracle",
    seed: int = 0,
) -> FrameTensors:
    """Read frames, corrupt their depth, and bring them to one size.

    Frames in which no pixel of the object is left at this size are skipped.

    Args:
        frames: Frames with true depth.
        size: (width, height) in pixels.
        corruption: "oracle" erases the depth of the whole object, as the published experiments do;
            "analytic" imitates an active-stereo camera by formulas: it loses part of the depth,
            sees the background through the rest, and frays the outlines; "sensor" takes the
            frame's raw depth, measured by a real or simulated camera (ledger, row 8).
        seed: Seed of the analytic models.

    Returns:
        The frames.

    Raises:
        ValueError: There is no frame, `corruption` is unknown, or a frame lacks the raw depth
            that "sensor" takes; the message names it.
    """
    if corruption not in CORRUPTIONS:
        raise ValueError(f"corruption must be one of {sorted(CORRUPTIONS)}, got {corruption!r}")
    rng = np.random.default_rng(seed)
    inputs, depths, hands, stems = [], [], [], []
    for frame in frames:
        if corruption == "sensor" and frame.raw_depth is None:
            raise ValueError(
                f"frame {frame.object_id}/{frame.stem} has no raw depth, which the corruption "
                "'sensor' takes; make frames with --sensor, or choose 'analytic' or 'oracle'"
            )
        corrupted = corrupt(
            frame.depth,
            frame.object_mask,
            frame.camera,
            rng,
            CORRUPTIONS[corruption],
            frame.background_depth,
            frame.raw_depth,
        )
        one = frame_to_input(
            frame.color, corrupted, frame.object_mask, frame.keypoints, frame.camera, size
        )
        if not one.mask.any():
            continue
        inputs.append(one)
        depth = np.nan_to_num(resize_depth(frame.depth, *size)).astype(np.float32)
        depths.append(torch.from_numpy(depth))
        hands.append(torch.from_numpy(resize_mask(frame.hand_mask, *size).copy()))
        stems.append(f"{frame.object_id}/{frame.stem}")
    if not inputs:
        raise ValueError("no frames: the folder is empty, or no frame shows an object")
    return FrameTensors(stack_inputs(inputs), torch.stack(depths), torch.stack(hands), tuple(stems))


def batches(
    frames: FrameTensors, batch_size: int, generator: torch.Generator | None = None
) -> Iterator[tuple[HADRInput, Tensor]]:
    """Serve the frames once, in batches; the last one may be smaller.

    Args:
        frames: The frames.
        batch_size: Frames in a batch.
        generator: Shuffles them; None keeps their order.

    Yields:
        Input and true depth (B, H, W) of each batch.
    """
    count = len(frames)
    order = torch.arange(count) if generator is None else torch.randperm(count, generator=generator)
    for first in range(0, count, batch_size):
        chosen = order[first : first + batch_size]
        yield frames.inputs.take(chosen), frames.true_depth[chosen]


def augment_batch(color: Tensor, generator: torch.Generator) -> Tensor:
    """Augment the colour of each frame of a batch; depth and geometry are not touched.

    Args:
        color: sRGB in 0..1, shape (B, 3, H, W).
        generator: Source of randomness.

    Returns:
        The same shape, in 0..1.
    """
    seed = int(torch.randint(2**31, (), generator=generator))
    rng = np.random.default_rng(seed)
    pictures = (color * 255).round().to(torch.uint8).permute(0, 2, 3, 1).numpy()
    changed = np.stack([augment_color(picture, rng) for picture in pictures])
    return torch.from_numpy(changed).permute(0, 3, 1, 2).float() / 255
