"""The front door: one RGB-D frame in, restored depth out (numpy in, numpy out).

`restore` checks what it is given, chooses a method and says in `Restoration.notes` what it did
and, above all, what it could not do: where no trained network fits the input, the result is a
classical fill and is called one. `hadr.perception.Perception` does the same frame after frame with
networks that are loaded once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hadr.camera import BoolArray, FloatArray, Intrinsics, project, valid_depth
from hadr.depth_network import (
    SILENT,
    TITLES,
    Corruption,
    DepthNetwork,
    NetworkDepth,
    enlarge_known,
    enlarge_restored,
)
from hadr.frame_checks import (
    check_mask_form,
    checked_depth,
    checked_hand,
    checked_mask,
    depth_to_use,
)
from hadr.perception import HandKeypoints, Segmentation
from hadr.rivals import classical

__all__ = ["METHODS", "Method", "Restoration", "enlarge_known", "enlarge_restored", "restore"]

Method = Literal[
    "auto",
    "hadr",
    "hadr-plus",
    "unet-hand",
    "lidf",
    "dfnet",
    "swindrnet",
    "tode",
    "nearest",
    "inpaint",
    "hand-median",
]
METHODS: tuple[str, ...] = get_args(Method)
CHECKPOINT_NAME = "hadr-mini.safetensors"
"""The sample checkpoint that is taken where none is named."""
SAMPLE_CHECKPOINTS = (
    CHECKPOINT_NAME,
    "hadr-mini-unknown.safetensors",
    "hadr-plus-mini.safetensors",
)
"""All sample checkpoints that restore depth."""


@dataclass(frozen=True)
class Restoration:
    """What `restore` returns.

    Attributes:
        depth: z-depth in metres, shape (H, W) float32, 0 where still missing.
        confidence: Shape (H, W) float32, 0..1: 1 where the camera measured, 0 where still missing.
            In restored pixels, where `tolerance_m` is set, the probability that the depth is right
            to so many metres; otherwise a network's own score, which only orders pixels. 0 for the
            classical methods, which know no estimate.
        restored: Pixels whose depth comes from the method, shape (H, W) bool.
        method: The method that was really used.
        notes: What a user must know about this result, one sentence each.
        tolerance_m: What a calibrated confidence speaks of, metres; None where it is none.
        mask: Pixels that were to be restored, given or predicted, shape (H, W) bool.
    """

    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    restored: BoolArray
    method: str
    notes: tuple[str, ...]
    tolerance_m: float | None
    mask: BoolArray


def restore(
    color: NDArray[np.uint8],
    depth: FloatArray,
    camera: Intrinsics,
    mask: BoolArray | None = None,
    keypoints: NDArray[np.floating] | None = None,
    method: Method = "auto",
    checkpoint: str | Path | None = None,
    hand_mask: BoolArray | None = None,
    *,
    corruption: Corruption | None = None,
    segmentation: str | Path | None = None,
    keypoint_network: str | Path | None = None,
) -> Restoration:
    """Restore the depth of a transparent object in one RGB-D frame.

    Only the mask's pixels change. A network runs at the size it was trained at; its depth is
    brought back to the full size by interpolating bilinearly between the restored pixels, and by
    taking the nearest one at the mask's border. A pixel that the network can't know stays missing.

    Args:
        color: RGB, shape (H, W, 3) uint8.
        depth: z-depth in metres, shape (H, W) float; 0, NaN and infinity count as missing.
        camera: Intrinsics of both images.
        mask: Pixels of the transparent object, shape (H, W) bool. None has them predicted where
            `segmentation` is given, and restores the pixels that have no depth where it is not.
        keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3). None has them predicted
            where `keypoint_network` is given.
        method: "auto" takes the checkpoint's network where one fits, else "nearest", and says so
            in the notes. The kind of a network, such as "hadr-plus", insists on one of that kind.
            "nearest": nearest valid depth. "inpaint": OpenCV's Telea inpainting. "hand-median":
            the hand's median depth (needs keypoints).
        checkpoint: A checkpoint of a depth network (`.safetensors`); None looks for the sample
            checkpoint.
        hand_mask: Pixels of hand and arm, shape (H, W) bool; sharpens "hand-median", and tells
            where to look for keypoints.
        corruption: What becomes of depth that the camera measured inside of the mask. "oracle"
            does not trust it: on glass it is mostly the background. "sensor" gives it to the
            network; the methods without learning keep it and fill what is missing. None does as
            the checkpoint was trained, and "oracle" without one.
        segmentation: A segmentation checkpoint that predicts mask and hand mask.
        keypoint_network: A hand-keypoint checkpoint that predicts the keypoints.

    Returns:
        The restored depth with its confidence and notes.

    Raises:
        ValueError: An input is unusable; the message names the value and what is expected.
        FileNotFoundError: A checkpoint that was asked for does not exist.
    """
    for name, value, known in (
        ("method", method, METHODS),
        ("corruption", corruption, (None, *get_args(Corruption))),
    ):
        if value not in known:
            expected = ", ".join(str(one) for one in known if one)
            raise ValueError(f"{name} must be one of {expected}, got {value!r}")
    notes: list[str] = []
    clean = checked_depth(color, depth, camera, notes)
    if hand_mask is not None:
        check_mask_form("hand mask", hand_mask, clean)
    if segmentation is not None and (mask is None or hand_mask is None):
        network = Segmentation.load(segmentation)
        found, found_hand = network.masks(color)
        if mask is None:
            notes.append(f"the mask is not given but predicted by {network.name}")
            if not found.any():
                raise ValueError(f"{network.name} found no glass in the picture; give a mask")
        mask = found if mask is None else mask
        hand_mask = found_hand if hand_mask is None else hand_mask
    target = checked_mask(mask, clean, notes)
    hand = None if keypoints is None else checked_hand(keypoints, camera, notes)
    if not target.any():
        notes.append("every pixel has a depth and no mask was given: nothing to restore")
        return _result(clean, clean, np.zeros_like(clean), target, "none", notes)
    if not valid_depth(clean[~target]).any():
        raise ValueError(
            f"the mask covers all {int(target.sum())} pixels that could have depth, expected at "
            "least one pixel with depth outside of it"
        )
    chosen: DepthNetwork | str = "none was asked for"
    if method == "auto" or method in TITLES:
        hand_comes = hand is not None or keypoint_network is not None
        chosen = _fitting_checkpoint(checkpoint, method, hand_comes)
    if keypoint_network is not None and hand is None:
        inside = depth_to_use(clean, target, _corruption(corruption, chosen), [])
        hand = _predicted_hand(color, inside, camera, target, hand_mask, keypoint_network, notes)
        if hand is None and isinstance(chosen, DepthNetwork) and chosen.needs_hand:
            chosen = f"{chosen.name} needs 21 hand keypoints and none were found"
    inside = depth_to_use(clean, target, _corruption(corruption, chosen), notes)
    if isinstance(chosen, DepthNetwork):
        chosen = _with_corruption(chosen, corruption, notes)
        answer = chosen.restore(color, inside, camera, target, hand)
        _note_network(chosen, answer, camera, notes)
        filled = np.where(target, answer.depth, clean)
        result = _result(clean, filled, answer.confidence, target, chosen.kind, notes)
        tolerance = None if chosen.rule is None else chosen.rule.calibration.tolerance_m
        return replace(result, tolerance_m=tolerance)
    used: str = method
    if method in TITLES:
        raise ValueError(f"method {method}: no checkpoint fits: {chosen}")
    if method == "auto":
        notes.append(f"no checkpoint fits: {chosen}; the result is nearest valid depth, not HADR")
        used = "nearest"
    holes = target & ~valid_depth(inside)
    if used == "nearest":
        filled = classical.nearest_valid(clean, holes)
    elif used == "inpaint":
        filled = classical.inpaint(clean, holes)
    else:
        if hand is None:
            raise ValueError("method hand-median needs 21 hand keypoints (21, 3), got none")
        uv = project(hand, camera)
        filled = classical.hand_median(clean, holes, uv, hand[:, 2], hand_mask)
    return _result(clean, filled, np.zeros_like(clean), holes, used, notes, target)


def _result(
    measured: NDArray[np.float32],
    filled: FloatArray,
    confidence_inside: NDArray[np.float32],
    changed: BoolArray,
    method: str,
    notes: list[str],
    mask: BoolArray | None = None,
) -> Restoration:
    """Put the result together; of `mask` only the pixels `changed` took another depth."""
    depth = filled.astype(np.float32)
    restored = changed & (depth > 0)
    lost = int((changed & ~restored).sum())
    if lost:
        notes.append(f"{lost} of {int(changed.sum())} pixels of the mask could not be restored")
    outside = int((~changed & (depth <= 0)).sum())
    if outside:
        notes.append(f"{outside} pixels outside the mask have no depth and stay missing")
    confidence = np.where(changed, np.where(restored, confidence_inside, 0), measured > 0)
    return Restoration(
        depth=depth,
        confidence=confidence.astype(np.float32),
        restored=restored,
        method=method,
        notes=tuple(notes),
        tolerance_m=None,
        mask=changed if mask is None else mask,
    )


def _fitting_checkpoint(
    checkpoint: str | Path | None, method: str, hand_is_known: bool
) -> DepthNetwork | str:
    """Return the network that fits the input, or why there is none."""
    if checkpoint is None:
        if not hand_is_known:
            return "the sample checkpoint needs 21 hand keypoints and none were given"
        from hadr.data.samples import samples_dir

        name = CHECKPOINT_NAME if method in ("auto", "hadr") else f"{method}-mini.safetensors"
        try:
            checkpoint = samples_dir() / "checkpoints" / name
        except FileNotFoundError:
            return "the folder data_samples with the sample checkpoint was not found"
        if not checkpoint.is_file():
            return f"there is no {name} in {checkpoint.parent}"
    network = DepthNetwork.load(checkpoint)
    if method not in ("auto", network.kind):
        return f"{network.name} holds a network of kind {network.kind}"
    if not hand_is_known and network.needs_hand:
        return f"{network.name} needs 21 hand keypoints and none were given"
    return network


def _predicted_hand(
    color: NDArray[np.uint8],
    depth: NDArray[np.float32],
    camera: Intrinsics,
    mask: BoolArray,
    hand_mask: BoolArray | None,
    checkpoint: str | Path,
    notes: list[str],
) -> NDArray[np.float64] | None:
    """Predict the hand's keypoints, or say why not."""
    network = HandKeypoints.load(checkpoint)
    if hand_mask is None:
        raise ValueError(
            f"{network.name} needs to know where the hand is: give hand_mask, or a segmentation "
            "checkpoint that predicts it"
        )
    found = network.find(color, depth, camera, mask, hand_mask)
    notes.append(
        "there is no hand with depth, so there are no keypoints"
        if found is None
        else f"the hand's keypoints are not given but predicted by {network.name}"
    )
    return found


def _corruption(asked: Corruption | None, network: DepthNetwork | str) -> Corruption:
    """What becomes of measured depth: as asked, else as the network learned, else erased."""
    return asked or (network.corruption if isinstance(network, DepthNetwork) else "oracle")


def _with_corruption(
    network: DepthNetwork, corruption: Corruption | None, notes: list[str]
) -> DepthNetwork:
    """Give the network what the user asks for, and say where it learned something else."""
    if corruption is None or corruption == network.corruption:
        return network
    learned = "without" if network.corruption == "oracle" else "with"
    notes.append(
        f"{network.name} learned from frames {learned} measured depth inside the mask, and was "
        "now given the other; expect larger errors"
    )
    return replace(network, corruption=corruption)


def _note_network(
    network: DepthNetwork, answer: NetworkDepth, camera: Intrinsics, notes: list[str]
) -> None:
    width, height = network.size
    notes.append(
        f"{network.title} checkpoint {network.name} ({network.trained}) ran at {width}x{height}; "
        f"its depth was interpolated to {camera.width}x{camera.height}"
    )
    if network.name in SAMPLE_CHECKPOINTS:
        notes.append(
            "the sample checkpoint has seen computed pictures only; expect larger errors on "
            "real ones"
        )
    if network.rule is None:
        own = "0: the network knows none" if network.kind in SILENT else "the network's own score"
        notes.append(f"the confidence is {own}; {network.name} was never calibrated")
    if answer.no_answer == 1:
        notes.append(
            f"no ray of the mask met an occupied voxel, so {network.title} restored nothing"
        )
    elif answer.out_of_range:
        notes.append(
            f"{100 * answer.out_of_range:.1f} % of the mask's depth lay outside of what "
            f"{network.title} has learned and was discarded"
        )
