"""The frames of a command: opened, read, and given predicted masks and keypoints.

Predictions of masks and keypoints are computed once and stored in the frames. Scoring stays on the
true mask (`FrameTensors.object_mask`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from hadr.corruption import CORRUPTIONS
from hadr.data.folders import FrameSource, check_folders, has_split, open_folder
from hadr.data.frame import Frame
from hadr.models.hand.keypoints import keypoints_where_seen
from hadr.models.network_input import HADRInput
from hadr.models.segmentation import predict_logits
from hadr.training.checkpoints import load_kind
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.recipe import TRUE, Given

NEED_HAND = ("unet-hand", "hadr-plus")
"""Kinds of networks that have no answer where no hand is known: they measure from its depth."""


def open_split(
    folders: Sequence[str | Path], split: str, objects: Sequence[str] | None = None
) -> FrameSource | None:
    """Open a split of some data folders, joined; None where none of them has it.

    FileNotFoundError for an object or all splits, ValueError for a folder that is named twice.
    """
    check_folders(folders)
    there = [folder for folder in folders if has_split(folder, split)]
    if not there:
        return None
    return FrameSource([open_folder(folder, split, objects) for folder in there])


def read_split(
    folders: Sequence[str | Path],
    split: str,
    size: tuple[int, int],
    given: Given,
    objects: Sequence[str] | None = None,
    network: str = "",
) -> FrameTensors | None:
    """Read a split of some data folders, joined; None where none of them has it.

    ValueError for a frame without a known hand, by its name, where the network is of a kind that
    needs one.
    """
    found = open_split(folders, split, objects)
    if found is None:
        return None
    frames = load_given(found, size, given, progress=f"reading {split}")
    if network in NEED_HAND and not (known := hand_known(frames.inputs)).all():
        lost = [stem for stem, one in zip(frames.stems, known.tolist(), strict=True) if not one]
        raise ValueError(
            f"{network} needs the hand, and of {len(lost)} of the {len(frames)} frames of split "
            f"{split} no hand is known, the first is {lost[0]}"
        )
    return frames


def hand_known(inputs: HADRInput) -> Tensor:
    """Say where the keypoints' median depth is positive, (B,) bool; of a hand not found it is 0."""
    return inputs.keypoints[:, :, 2].median(dim=1).values > 0


def load_given(
    source: Sequence[Frame], size: tuple[int, int], given: Given, **more: Any
) -> FrameTensors:
    """Read frames as networks are given them; `more` are arguments of `load_frames`."""
    frames = load_frames(source, size, given.corruption, given.seed, **more)
    return with_predicted(frames, source, given)


def with_predicted(
    frames: FrameTensors, source: Sequence[Frame], given: Given, batch_size: int = 16
) -> FrameTensors:
    """Put predicted masks and keypoints in the place of the true ones, where asked for.

    Each network works at the size it was trained at, whatever the size of the frames, so that all
    systems of a table are given the same masks and keypoints. With the corruptions "oracle" and
    "erased" the depth is missing in the true mask already; it is erased in the predicted one as
    well. The keypoints' network looks where the predicted hand is, or the true one where masks are
    true, and so does the hand's median depth; a frame in which too little of a hand is seen gets
    zeros, which mean "unknown".

    The source is what the frames were read from, in their order; it may have more. ValueError where
    it lacks one, or the segmentation network finds an object in none of them.
    """
    inputs, hand = frames.inputs, None
    if given.masks != TRUE:
        model, size = load_kind(given.masks, "segmentation")
        seen = _at(size, frames, source, given)
        found = torch.cat([_masks(model, part) for part in seen.batches(batch_size)])
        if not found[:, 0].any():
            raise ValueError(f"{given.masks} finds no object in any of the {len(frames)} frames")
        inputs = _with_mask(inputs, found[:, 0], given)
        hand = found[:, 1] if found.shape[1] > 1 else None
    if given.keypoints != TRUE:
        model, size = load_kind(given.keypoints, "hand-keypoints")
        seen = _at(size, frames, source, given)
        if given.masks != TRUE:
            seen = replace(seen, inputs=_with_mask(seen.inputs, found[:, 0], given))
        hands = seen.hand_mask if hand is None else resized(hand, seen.hand_mask)
        both = zip(seen.batches(batch_size), torch.split(hands, batch_size), strict=True)
        with torch.no_grad():
            keypoints = torch.cat(
                [keypoints_where_seen(model, part.inputs, own) for part, own in both]
            )
        uv = pixels_of(keypoints, inputs.intrinsics) * (keypoints != 0).any(dim=-1, keepdim=True)
        inputs = replace(inputs, keypoints=keypoints, keypoints_uv=uv)
    if hand is not None:
        frames = replace(frames, hand_mask=resized(hand, frames.hand_mask))
    return frames if inputs is frames.inputs else replace(frames, inputs=inputs)


def _with_mask(inputs: HADRInput, masks: Tensor, given: Given) -> HADRInput:
    """Put predicted masks in place of the true ones; depth that is erased in those is in these."""
    mask, depth = resized(masks, inputs.mask), inputs.depth
    if CORRUPTIONS[given.corruption].erase:
        depth = torch.where(mask, torch.zeros_like(depth), depth)
    return replace(inputs, mask=mask, depth=depth)


def resized(masks: Tensor, like: Tensor) -> Tensor:
    """Bring masks (N, h, w) to the size of others (N, H, W): the pixel nearest to each centre."""
    size = (int(like.shape[1]), int(like.shape[2]))
    if tuple(masks.shape[1:]) == size:
        return masks
    return functional.interpolate(masks[:, None].float(), size, mode="nearest-exact")[:, 0] > 0


def _at(
    size: tuple[int, int], frames: FrameTensors, source: Sequence[Frame], given: Given
) -> FrameTensors:
    """Read the same frames at another size."""
    height, width = frames.inputs.depth.shape[1:]
    if size == (width, height):
        return frames
    every = load_frames(source, size, given.corruption, given.seed, keep_all=True)
    numbers, stems = [], enumerate(every.stems)
    for stem in frames.stems:
        number = next((n for n, other in stems if other == stem), None)
        if number is None:
            raise ValueError(f"frame {stem} is not in the source, or out of its order")
        numbers.append(number)
    return every.take(numbers)


def pixels_of(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Project points (N, 21, 3), metres, by fx, fy, cx, cy (N, 4): pixels (N, 21, 2)."""
    focal, centre = intrinsics[:, None, :2], intrinsics[:, None, 2:]
    return points[..., :2] / points[..., 2:].clamp(min=1e-6) * focal + centre


def _masks(model: Any, frames: FrameTensors) -> Tensor:
    """Masks of the object and, if the network knows it, the hand: bool (B, classes, H, W)."""
    return predict_logits(model, frames.inputs.color) > 0
