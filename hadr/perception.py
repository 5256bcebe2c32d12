"""Perception: from one RGB-D frame to the glass's mask, the hand's keypoints, and restored depth.

Three networks, one after the other, as the paper's real system runs them: segmentation on the
colour, the hand's keypoints on the depth around the hand, restoration with both. They are loaded
once; what is known already can be given and is then not predicted.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hadr.camera import BoolArray, Intrinsics, resize_color, resize_mask
from hadr.depth_network import DepthNetwork
from hadr.frame_checks import check_mask_form, checked_depth, checked_hand, depth_to_use

PARTS = ("segmentation", "keypoints", "restoration")
"""The parts whose time is taken, in their order."""


@dataclass(frozen=True)
class Perceived:
    """What is perceived in one frame.

    Attributes:
        mask: The transparent object's pixels, shape (H, W) bool.
        hand_mask: Pixels of hand and arm, shape (H, W) bool; None where no network tells.
        keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3); None without a hand.
        depth: z-depth in metres, shape (H, W) float32: restored in the mask, as measured elsewhere,
            0 where missing.
        confidence: Shape (H, W) float32, 0..1: 1 where measured, 0 where missing, and in the
            restored pixels the network's.
        restored: Pixels whose depth was restored, shape (H, W) bool.
        notes: What a user must know about this result, one sentence each.
        seconds: Time of each of `PARTS`, by name; a part that did not run is left out.
    """

    mask: BoolArray
    hand_mask: BoolArray | None
    keypoints: NDArray[np.float64] | None
    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    restored: BoolArray
    notes: tuple[str, ...]
    seconds: dict[str, float]


@dataclass(frozen=True)
class Segmentation:
    """A segmentation network, loaded once.

    Attributes:
        model: The network; its first class is the object and, where there is one, its second the
            hand.
        size: (width, height) that it runs at, pixels.
        name: Name of the checkpoint's file.
    """

    model: Any
    size: tuple[int, int]
    name: str

    @classmethod
    def load(cls, path: str | Path) -> Segmentation:
        """Read a segmentation checkpoint.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: It is damaged, or a checkpoint of another kind of network.
        """
        model, size = _load(path, "segmentation")
        return cls(model, size, Path(path).name)

    def masks(self, color: NDArray[np.uint8]) -> tuple[BoolArray, BoolArray | None]:
        """Find the glass and the hand.

        Args:
            color: RGB, shape (H, W, 3) uint8.

        Returns:
            The object's pixels, and the hand's with the arm (None if the network has no such
            class), shape (H, W) bool.
        """
        import torch

        from hadr.models.segmentation import predict_masks

        height, width = color.shape[:2]
        small = resize_color(color, *self.size).astype(np.float32) / 255
        with torch.inference_mode():
            picture = torch.from_numpy(np.ascontiguousarray(small.transpose(2, 0, 1)))[None]
            positive = predict_masks(self.model, picture)[0].numpy()  # (C, h, w)
        large = [resize_mask(part, width, height) for part in positive[:2]]
        return large[0], large[1] if len(large) > 1 else None


@dataclass(frozen=True)
class HandKeypoints:
    """A hand-keypoint network, loaded once.

    Attributes:
        model: The network.
        size: (width, height) that frames are brought to before the hand is cut out, pixels.
        name: Name of the checkpoint's file.
    """

    model: Any
    size: tuple[int, int]
    name: str

    @classmethod
    def load(cls, path: str | Path) -> HandKeypoints:
        """Read a hand-keypoint checkpoint; errors as `Segmentation.load`."""
        model, size = _load(path, "hand-keypoints")
        return cls(model, size, Path(path).name)

    def find(
        self,
        color: NDArray[np.uint8],
        depth: NDArray[np.float32],
        camera: Intrinsics,
        mask: BoolArray,
        hand_mask: BoolArray,
    ) -> NDArray[np.float64] | None:
        """Find the keypoints.

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres, shape (H, W); 0 = missing.
            camera: Intrinsics of both images.
            mask: The glass's pixels, shape (H, W) bool.
            hand_mask: Pixels of hand and arm, shape (H, W) bool.

        Returns:
            Camera frame, metres, shape (21, 3); None where the hand's pixels have no depth.
        """
        import torch

        from hadr.models.hadr_input import frame_to_input
        from hadr.models.hand.keypoints import keypoints_where_seen

        inputs = frame_to_input(color, depth, mask, None, camera, self.size)
        hand = torch.from_numpy(resize_mask(hand_mask, *self.size).copy())[None]
        with torch.inference_mode():
            found = keypoints_where_seen(self.model, inputs, hand)[0]
        return np.asarray(found.double().numpy()) if bool(found.any()) else None


@dataclass(frozen=True)
class Perception:
    """The three networks.

    Args:
        restoration: Restores the depth.
        segmentation: Finds glass and hand; without it each frame needs its mask.
        keypoints: Finds the hand's keypoints; without it each frame needs them, if the
            restoration does.
    """

    restoration: DepthNetwork
    segmentation: Segmentation | None = None
    keypoints: HandKeypoints | None = None

    @classmethod
    def load(
        cls,
        restoration: str | Path,
        segmentation: str | Path | None = None,
        keypoints: str | Path | None = None,
        *,
        ray_stride: int = 1,
    ) -> Perception:
        """Read the checkpoints.

        Args:
            restoration: Checkpoint of a depth network.
            segmentation: Checkpoint of a segmentation network.
            keypoints: Checkpoint of a hand-keypoint network.
            ray_stride: 2 lets HADR cast a ray at every other row and column only, which is faster
                and costs hardly any accuracy (`benchmarks/restoration.py`).

        Raises:
            FileNotFoundError: A file does not exist.
            ValueError: A file is damaged, or a checkpoint of another kind of network.
        """
        return cls(
            DepthNetwork.load(restoration)
            if ray_stride == 1
            else DepthNetwork.load(restoration).with_fewer_rays(ray_stride),
            None if segmentation is None else Segmentation.load(segmentation),
            None if keypoints is None else HandKeypoints.load(keypoints),
        )

    def __call__(
        self,
        color: NDArray[np.uint8],
        depth: NDArray[np.floating],
        camera: Intrinsics,
        mask: BoolArray | None = None,
        keypoints: NDArray[np.floating] | None = None,
        hand_mask: BoolArray | None = None,
    ) -> Perceived:
        """Perceive one frame.

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres, shape (H, W) float; 0, NaN and infinity count as missing.
            camera: Intrinsics of both images.
            mask: The glass's pixels, shape (H, W) bool; None has them predicted.
            keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3); None has them
                predicted.
            hand_mask: Pixels of hand and arm, shape (H, W) bool; None has them predicted.

        Returns:
            What is perceived. Where no glass is found, the depth is as measured, and a note says
            so.

        Raises:
            ValueError: An input is unusable, or something is neither given nor predicted.
        """
        notes: list[str] = []
        seconds: dict[str, float] = {}
        clean = checked_depth(color, depth, camera, notes)
        for name, given in (("mask", mask), ("hand mask", hand_mask)):
            if given is not None:
                check_mask_form(name, given, clean)
        hand = None if keypoints is None else checked_hand(keypoints, camera, notes)

        started = time.perf_counter()
        wanted = self.keypoints is not None and hand is None
        if mask is None or (wanted and hand_mask is None):
            if self.segmentation is None:
                missing = "mask" if mask is None else "hand mask"
                raise ValueError(f"no {missing} given and no segmentation network to predict it")
            found, found_hand = self.segmentation.masks(color)
            mask = found if mask is None else mask
            hand_mask = found_hand if hand_mask is None else hand_mask
            seconds["segmentation"] = time.perf_counter() - started

        given_depth = depth_to_use(clean, mask, self.restoration.corruption, notes)
        started = time.perf_counter()
        if wanted and self.keypoints is not None:
            if hand_mask is not None and hand_mask.any():
                hand = self.keypoints.find(color, given_depth, camera, mask, hand_mask)
                seconds["keypoints"] = time.perf_counter() - started
            if hand is None:
                notes.append("no hand with depth was found, so there are no keypoints")

        result = np.where(mask, np.float32(0), clean)
        confidence = (result > 0).astype(np.float32)
        restored = np.zeros_like(mask)
        if not mask.any():
            notes.append("no glass was found: the depth is as measured")
        elif hand is None and self.restoration.needs_hand:
            notes.append(
                f"{self.restoration.name} needs 21 hand keypoints and there are none: nothing was "
                "restored"
            )
        else:
            started = time.perf_counter()
            answer = self.restoration.restore(color, given_depth, camera, mask, hand)
            seconds["restoration"] = time.perf_counter() - started
            restored = answer.restored
            result[restored] = answer.depth[restored]
            confidence[restored] = answer.confidence[restored]
        return Perceived(mask, hand_mask, hand, result, confidence, restored, tuple(notes), seconds)


def _load(path: str | Path, kind: str) -> tuple[Any, tuple[int, int]]:
    from hadr.training.checkpoints import load_checkpoint

    if not Path(path).is_file():
        raise FileNotFoundError(f"checkpoint {path} does not exist")
    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return model.eval(), (int(meta["width"]), int(meta["height"]))
