"""Frames as tensors in memory: read, corrupted and resized once, then taken in batches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from hadr.camera import resize_depth, resize_mask
from hadr.corruption import CORRUPTIONS, Corruption, corrupt
from hadr.models.network_input import HADRInput, frame_to_input
from hadr.records.provenance import usable_cores

if TYPE_CHECKING:
    from hadr.data.frame import Frame


@dataclass(frozen=True)
class FrameTensors:
    """Frames of one size, ready for a network.

    Attributes:
        inputs: What the network is given, N frames: its mask and keypoints may be true or
            predicted ones. Colour is kept as bytes; `take` gives floats.
        true_depth: True z-depth in metres, shape (N, H, W); 0 = unknown.
        hand_mask: Pixels of hand and arm, shape (N, H, W), bool.
        object_mask: True pixels of the object, on which is scored, shape (N, H, W), bool.
        true_keypoints: True hand keypoints in metres, camera frame, shape (N, 21, 3).
        stems: Name of each frame, "object/stem".
    """

    inputs: HADRInput
    true_depth: Tensor
    hand_mask: Tensor
    object_mask: Tensor
    true_keypoints: Tensor
    stems: tuple[str, ...]

    def __len__(self) -> int:
        """Give the number of frames."""
        return len(self.stems)

    def take(self, frames: Sequence[int] | Tensor) -> FrameTensors:
        """Give some of the frames, by their indices; their colour is in 0..1."""
        numbers = [int(frame) for frame in frames]
        index = torch.tensor(numbers, dtype=torch.long)
        parts = {name: getattr(self, name)[index] for name in _TENSORS}
        stems = tuple(self.stems[number] for number in numbers)
        return FrameTensors(inputs=self.inputs.take(index), stems=stems, **parts)

    def batches(self, size: int) -> Iterator[FrameTensors]:
        """Give all of them, at most so many at a time."""
        for first in range(0, len(self), size):
            yield self.take(range(first, min(first + size, len(self))))

    def to(self, device: torch.device | str) -> FrameTensors:
        """Give the frames on another device."""
        parts = {name: getattr(self, name).to(device) for name in _TENSORS}
        return FrameTensors(inputs=self.inputs.to(device), stems=self.stems, **parts)

    @staticmethod
    def join(parts: Sequence[FrameTensors]) -> FrameTensors:
        """Join frames of one size, in their order."""
        inputs = {
            field.name: torch.cat([getattr(part.inputs, field.name) for part in parts])
            for field in fields(HADRInput)
        }
        tensors = {name: torch.cat([getattr(part, name) for part in parts]) for name in _TENSORS}
        stems = tuple(stem for part in parts for stem in part.stems)
        return FrameTensors(inputs=HADRInput(**inputs), stems=stems, **tensors)


_TENSORS = ("true_depth", "hand_mask", "object_mask", "true_keypoints")


def load_frames(
    frames: Iterable[Frame],
    size: tuple[int, int],
    corruption: Corruption = "oracle",
    seed: int = 0,
    *,
    keep_all: bool = False,
    progress: str | None = None,
) -> FrameTensors:
    """Read frames, corrupt their depth, and bring them to one size.

    Frames in which no pixel of the object is left at this size are skipped. Some threads decode
    at once; a frame's result does not depend on the others.

    Args:
        frames: Frames with true depth; a sequence that reads each when asked for it is best.
        size: (width, height) in pixels.
        corruption: "oracle" erases the depth of the whole object, as the published experiments do;
            "analytic" imitates an active-stereo camera by formulas: it loses part of the depth,
            sees the background through the rest, and frays the outlines; "sensor" takes the
            frame's raw depth, measured by a real or simulated camera (ledger, row 8); "erased"
            takes it outside of the object alone.
        seed: Seed of the analytic models; each frame's chance follows from it and its number.
        keep_all: Keep frames without a pixel of the object.
        progress: Show a bar with this title.

    Returns:
        The frames.

    Raises:
        ValueError: There is no frame, `corruption` is unknown, or a frame lacks the raw depth
            that "sensor" and "erased" take; the message names it.
    """
    if corruption not in CORRUPTIONS:
        raise ValueError(f"corruption must be one of {sorted(CORRUPTIONS)}, got {corruption!r}")
    source = frames if isinstance(frames, Sequence) else list(frames)
    if len(source) == 0:
        raise ValueError("no frames: the folder is empty, or no frame shows an object")
    store = blank_frames(len(source), size)

    def load(number: int) -> str | None:
        frame: Frame = source[number]
        rng = np.random.default_rng((seed, number))
        one = _one_frame(frame, size, corruption, rng)
        if not keep_all and not one.object_mask.any():
            return None
        for name in _TENSORS:
            getattr(store, name)[number] = getattr(one, name)[0]
        for part in fields(HADRInput):
            getattr(store.inputs, part.name)[number] = getattr(one.inputs, part.name)[0]
        return one.stems[0]

    with ThreadPoolExecutor(usable_cores()) as pool:
        read, silent = pool.map(load, range(len(source))), progress is None
        stems = list(tqdm(read, progress, len(source), disable=silent, mininterval=1.0))
    kept = [number for number, stem in enumerate(stems) if stem is not None]
    if not kept:
        raise ValueError("no frames: the folder is empty, or no frame shows an object")
    names = tuple(stem for stem in stems if stem is not None)
    inputs = {
        part.name: _packed(getattr(store.inputs, part.name), kept) for part in fields(HADRInput)
    }
    tensors = {name: _packed(getattr(store, name), kept) for name in _TENSORS}
    return FrameTensors(inputs=HADRInput(**inputs), stems=names, **tensors)


def _packed(rows: Tensor, kept: list[int]) -> Tensor:
    """Move the rows that are kept to the front, within the same memory."""
    for place, number in enumerate(kept):
        if place != number:
            rows[place] = rows[number]
    return rows[: len(kept)]


def _one_frame(
    frame: Frame, size: tuple[int, int], corruption: Corruption, rng: np.random.Generator
) -> FrameTensors:
    """Corrupt and resize one frame; colour as bytes."""
    name = f"{frame.object_id}/{frame.stem}"
    for taken, depth, what in (
        (CORRUPTIONS[corruption].captured, frame.raw_depth, "raw depth"),
        (CORRUPTIONS[corruption].see_through, frame.background_depth, "depth without the object"),
    ):
        if taken and depth is None:
            raise ValueError(
                f"frame {name} has no {what}, which the corruption {corruption!r} takes; 'oracle' "
                "takes nothing but the true depth"
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
    given = frame_to_input(
        frame.color, corrupted, frame.object_mask, frame.keypoints, frame.camera, size
    )
    depth = np.nan_to_num(resize_depth(frame.depth, *size)).astype(np.float32)
    hand = resize_mask(frame.hand_mask, *size).copy()
    return FrameTensors(
        inputs=replace(given, color=(given.color * 255).round().to(torch.uint8)),
        true_depth=torch.from_numpy(depth)[None],
        hand_mask=torch.from_numpy(hand)[None],
        object_mask=given.mask,
        true_keypoints=given.keypoints,
        stems=(name,),
    )


def blank_frames(count: int, size: tuple[int, int]) -> FrameTensors:
    """Room for so many frames of (width, height): zeros, colour as bytes, no names."""
    width, height = size
    image = (count, height, width)
    inputs = HADRInput(
        color=torch.zeros(count, 3, height, width, dtype=torch.uint8),
        depth=torch.zeros(image),
        mask=torch.zeros(image, dtype=torch.bool),
        intrinsics=torch.zeros(count, 4),
        keypoints=torch.zeros(count, 21, 3),
        keypoints_uv=torch.zeros(count, 21, 2),
    )
    return FrameTensors(
        inputs=inputs,
        true_depth=torch.zeros(image),
        hand_mask=torch.zeros(image, dtype=torch.bool),
        object_mask=torch.zeros(image, dtype=torch.bool),
        true_keypoints=torch.zeros(count, 21, 3),
        stems=("",) * count,
    )
