"""The front door: one RGB-D frame in, restored depth out (numpy in, numpy out).

`restore` checks what it is given, chooses a method and says in `Restoration.notes` what it did
and, above all, what it could not do: where no trained network fits the input, the result is a
classical fill and is called one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import (
    BoolArray,
    FloatArray,
    Intrinsics,
    project,
    resize_depth,
    resize_mask,
    valid_depth,
)
from hadr.frame_checks import check_mask_form, checked_depth, checked_hand, checked_mask
from hadr.models.baselines import classical

if TYPE_CHECKING:
    from hadr.models.hadr import HADR

Method = Literal["auto", "hadr", "nearest", "inpaint", "hand-median"]
METHODS: tuple[str, ...] = get_args(Method)
CHECKPOINT_NAME = "hadr-mini.safetensors"


@dataclass(frozen=True)
class Restoration:
    """What `restore` returns.

    Attributes:
        depth: z-depth in metres, shape (H, W) float32, 0 where still missing.
        confidence: Shape (H, W) float32, 0..1: 1 where the camera measured; in the restored
            pixels the probability of the chosen voxel (HADR), or 0 for the classical methods,
            which know no estimate; 0 where still missing.
        restored: Pixels whose depth comes from the method, shape (H, W) bool.
        method: The method that was really used.
        notes: What a user must know about this result, one sentence each.
    """

    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    restored: BoolArray
    method: str
    notes: tuple[str, ...]


def restore(
    color: NDArray[np.uint8],
    depth: FloatArray,
    camera: Intrinsics,
    mask: BoolArray | None = None,
    keypoints: NDArray[np.floating] | None = None,
    method: Method = "auto",
    checkpoint: str | Path | None = None,
    hand_mask: BoolArray | None = None,
) -> Restoration:
    """Restore the depth of a transparent object in one RGB-D frame.

    Only the mask's pixels change, and what the camera measured inside the mask is not used: on
    glass it is mostly the background. HADR runs at the size it was trained at; its depth is
    brought back to the full size by interpolating bilinearly between the restored pixels, and
    by taking the nearest one at the mask's border.

    Args:
        color: RGB, shape (H, W, 3) uint8.
        depth: z-depth in metres, shape (H, W) float; 0, NaN and infinity count as missing.
        camera: Intrinsics of both images.
        mask: Pixels of the transparent object, shape (H, W) bool. None restores the pixels
            that have no depth.
        keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3).
        method: "auto" takes HADR where a checkpoint fits, else "nearest", and says so in the
            notes. "hadr" insists on HADR. "nearest": nearest valid depth. "inpaint": OpenCV's
            Telea inpainting. "hand-median": the hand's median depth (needs keypoints).
        checkpoint: A HADR checkpoint (`.safetensors`); None looks for the sample checkpoint.
        hand_mask: Pixels of hand and arm, shape (H, W) bool; sharpens "hand-median".

    Returns:
        The restored depth with its confidence and notes.

    Raises:
        ValueError: An input is unusable; the message names the value and what is expected.
        FileNotFoundError: The checkpoint that was asked for does not exist.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    notes: list[str] = []
    clean = checked_depth(color, depth, camera, notes)
    target = checked_mask(mask, clean, notes)
    if hand_mask is not None:
        check_mask_form("hand mask", hand_mask, clean)
    hand = None if keypoints is None else checked_hand(keypoints, camera, notes)
    if not target.any():
        notes.append("every pixel has a depth and no mask was given: nothing to restore")
        return _result(clean, clean, np.zeros_like(clean), target, "none", notes)
    if not (valid_depth(clean) & ~target).any():
        raise ValueError(
            f"the mask covers all {int(target.sum())} pixels that could have depth, expected at "
            "least one pixel with depth outside of it"
        )

    used: str = method
    if method in ("auto", "hadr"):
        found = _fitting_checkpoint(checkpoint, hand is not None)
        if isinstance(found, str):
            if method == "hadr":
                raise ValueError(f"method hadr: no checkpoint fits: {found}")
            notes.append(
                f"no checkpoint fits: {found}; the result is nearest valid depth, not HADR"
            )
            used = "nearest"
        else:
            return _restore_with_hadr(color, clean, camera, target, hand, found, notes)
    if used == "nearest":
        filled = classical.nearest_valid(clean, target)
    elif used == "inpaint":
        filled = classical.inpaint(clean, target)
    else:
        if hand is None:
            raise ValueError("method hand-median needs 21 hand keypoints (21, 3), got none")
        uv = project(hand, camera)
        filled = classical.hand_median(clean, target, uv, hand[:, 2], hand_mask)
    return _result(clean, filled, np.zeros_like(clean), target, used, notes)


def _result(
    measured: NDArray[np.float32],
    filled: NDArray[np.float32],
    confidence_inside: NDArray[np.float32],
    target: BoolArray,
    method: str,
    notes: list[str],
) -> Restoration:
    restored = target & (filled > 0)
    lost = int((target & ~restored).sum())
    if lost:
        notes.append(f"{lost} of {int(target.sum())} pixels of the mask could not be restored")
    outside = int((~target & (filled <= 0)).sum())
    if outside:
        notes.append(f"{outside} pixels outside the mask have no depth and stay missing")
    confidence = np.where(target, np.where(restored, confidence_inside, 0), measured > 0)
    return Restoration(filled, confidence.astype(np.float32), restored, method, tuple(notes))


def _fitting_checkpoint(
    checkpoint: str | Path | None, hand_is_known: bool
) -> tuple[HADR, dict[str, Any], Path] | str:
    """Return the network that fits the input, or why there is none."""
    if checkpoint is not None:
        path = Path(checkpoint)
        if not path.is_file():
            raise FileNotFoundError(f"checkpoint {path} does not exist")
    else:
        if not hand_is_known:
            return "the sample checkpoint needs 21 hand keypoints and none were given"
        from hadr.data.samples import samples_dir

        try:
            path = samples_dir() / "checkpoints" / CHECKPOINT_NAME
        except FileNotFoundError:
            return "the folder data_samples with the sample checkpoint was not found"
        if not path.is_file():
            return f"there is no {CHECKPOINT_NAME} in {path.parent}"
    from hadr.training.checkpoints import load_checkpoint

    model, meta = load_checkpoint(path)
    if not hand_is_known and model.config.hand != "none":
        return f"{path.name} needs 21 hand keypoints and none were given"
    return model, meta, path


def _restore_with_hadr(
    color: NDArray[np.uint8],
    clean: NDArray[np.float32],
    camera: Intrinsics,
    target: BoolArray,
    hand: NDArray[np.float64] | None,
    found: tuple[HADR, dict[str, Any], Path],
    notes: list[str],
) -> Restoration:
    import torch

    from hadr.models.hadr_input import frame_to_input

    model, meta, path = found
    width, height = _working_size(meta)
    # A mask thinner than a working pixel would vanish; the network then sees it widened.
    if not resize_mask(target, width, height).any():
        target_seen = ndimage.maximum_filter(
            target, size=(-(-camera.height // height), -(-camera.width // width))
        )
    else:
        target_seen = target
    erased = np.where(target_seen, 0, clean)
    batch = frame_to_input(color, erased, target_seen, hand, camera, (width, height))
    model.eval()
    with torch.no_grad():
        output = model(batch)
    found_depth, probability = output.depth[0].numpy(), output.confidence[0].numpy()
    known = output.restored[0].numpy() & (found_depth > 0)
    notes.append(
        f"HADR checkpoint {path.name} (preset {meta.get('preset', {}).get('name', 'unknown')}, "
        f"{meta.get('epochs', 'unknown')} epochs) ran at {width}x{height}; its depth was "
        f"interpolated to {camera.width}x{camera.height}"
    )
    if path.name == CHECKPOINT_NAME:
        notes.append(
            "the sample checkpoint has seen computed pictures only; expect larger errors on "
            "real ones"
        )
    filled, confidence = clean.copy(), np.zeros_like(clean)
    filled[target] = 0
    if known.any():
        filled[target] = enlarge_known(found_depth, known, clean.shape)[target]
        confidence[target] = enlarge_known(probability, known, clean.shape)[target]
    else:
        notes.append("no ray of the mask met an occupied voxel, so HADR restored nothing")
    return _result(clean, filled, np.clip(confidence, 0, 1), target, "hadr", notes)


def enlarge_known(
    values: FloatArray, known: BoolArray, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Enlarge an image of which only some pixels are known.

    Bilinear between the known pixels (unknown ones get no weight), and the nearest known pixel
    where all four neighbours are unknown.

    Args:
        values: Shape (h, w).
        known: Which of them count, shape (h, w) bool; at least one.
        shape: (H, W) of the result.

    Returns:
        Shape (H, W) float32, a value everywhere.
    """
    height, width = shape
    complete = np.where(known, values, 0).astype(np.float32)
    _, (rows, columns) = ndimage.distance_transform_edt(~known, return_indices=True)
    nearest = resize_depth(complete[rows, columns], width, height)
    weight = cv2.resize(known.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    total = cv2.resize(complete, (width, height), interpolation=cv2.INTER_LINEAR)
    mixed = np.where(weight > 1e-3, total / np.maximum(weight, 1e-3), nearest)
    return np.asarray(mixed, dtype=np.float32)


def _working_size(meta: dict[str, Any]) -> tuple[int, int]:
    """Return (width, height) at which the checkpoint was trained."""
    return int(meta["width"]), int(meta["height"])
