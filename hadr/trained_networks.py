"""The trained networks, each loaded once and asked frame by frame (numpy in, numpy out).

`DepthNetwork` restores depth, `Segmentation` finds glass and hand, `HandKeypoints` the hand's
keypoints. Each brings the frame to its own size and its answer back. What a depth network can't
know is *not restored*: no ray met a voxel, the offset in the voxel is at its end, or the depth is
outside of the range in which the training showed objects (`hadr.confidence.within_learned`). Such
a pixel stays missing; it is neither 0 metres away nor filled from its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import (
    BoolArray,
    FloatArray,
    Intrinsics,
    resize_color,
    resize_mask,
    window_around,
)
from hadr.confidence import ConfidenceRule, signal_of, within_learned
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS

if TYPE_CHECKING:
    from torch import nn

Corruption = Literal["oracle", "sensor"]


@dataclass(frozen=True)
class NetworkDepth:
    """What a network says about one frame, at the frame's full size.

    Attributes:
        depth: z-depth in metres, shape (H, W) float32; 0 where nothing was restored.
        confidence: Shape (H, W) float32, 0..1; 0 where nothing was restored, and everywhere from a
            network that cannot say how sure it is.
        restored: Pixels of the mask with a depth, shape (H, W) bool.
        no_answer: Share of the mask's working pixels without any answer, 0..1.
        out_of_range: Share of them whose answer lies outside of what was learned, 0..1.
    """

    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    restored: BoolArray
    no_answer: float
    out_of_range: float


@dataclass(frozen=True)
class DepthNetwork:
    """A depth network, loaded once.

    Attributes:
        model: The network, in evaluation mode.
        kind: One of `hadr.models.networks.DEPTH_NETWORKS`.
        size: (width, height) that it runs at, pixels.
        needs_hand: Whether it can't do without the hand's keypoints.
        corruption: "oracle": it learned from frames without any depth inside the mask. "sensor":
            what the camera measured there was given to it.
        rule: From what it says of its answer to the probability that its depth is right; None
            where it was never calibrated, or cannot say.
        learned_range_m: Nearest and farthest depth of the objects that it learned from, metres;
            None where it is not known.
        name: Name of the checkpoint's file.
        trained: Its recipe's name and epochs, for readers.
    """

    model: nn.Module
    kind: str
    size: tuple[int, int]
    needs_hand: bool
    corruption: Corruption
    rule: ConfidenceRule | None
    learned_range_m: tuple[float, float] | None
    name: str
    trained: str

    @property
    def title(self) -> str:
        """What readers call it."""
        return NETWORKS[self.kind].title

    @property
    def can_say(self) -> bool:
        """Whether it can say how sure it is."""
        return NETWORKS[self.kind].can_say

    @classmethod
    def load(cls, path: str | Path) -> DepthNetwork:
        """Read a checkpoint of any depth network.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file is damaged, or a checkpoint of another kind of network.
        """
        from hadr.training.checkpoints import load_checkpoint

        return cls.of(*load_checkpoint(path), Path(path).name)

    @classmethod
    def of(cls, model: nn.Module, meta: dict[str, Any], name: str) -> DepthNetwork:
        """Take a network that is loaded already.

        Args:
            model: The network.
            meta: Its checkpoint's record.
            name: What messages call it.

        Raises:
            ValueError: It is no depth network.
        """
        kind = meta.get("network", "hadr")
        if kind not in DEPTH_NETWORKS:
            raise ValueError(
                f"{name} holds a network of kind {kind!r}, expected one that restores depth: "
                f"{', '.join(DEPTH_NETWORKS)}"
            )
        config: Any = model.config
        stored = meta.get("confidence") if NETWORKS[kind].can_say else None
        learned = meta.get("learned_range", {}).get("depth_m")
        recipe = meta.get("preset", {}).get("name", "unknown")
        return cls(
            model=model.eval(),
            kind=kind,
            size=(int(meta["width"]), int(meta["height"])),
            needs_hand=getattr(config, "hand", "3d") != "none",
            corruption=trained_corruption(meta),
            rule=None if stored is None else ConfidenceRule.from_dict(stored),
            learned_range_m=None if learned is None else (float(learned[0]), float(learned[1])),
            name=name,
            trained=f"preset {recipe}, {meta.get('epochs', 'unknown')} epochs",
        )

    def restore(
        self,
        color: NDArray[np.uint8],
        depth: NDArray[np.float32],
        camera: Intrinsics,
        mask: BoolArray,
        keypoints: NDArray[np.float64] | None,
    ) -> NetworkDepth:
        """Restore the mask's pixels.

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres as the network shall see it, shape (H, W); 0 = missing.
            camera: Intrinsics of both images.
            mask: Pixels to restore, shape (H, W) bool.
            keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3).

        Returns:
            Depth and confidence at full size.
        """
        import torch

        from hadr.models.hadr_input import frame_to_input

        width, height = self.size
        seen = mask
        # A mask thinner than a working pixel would vanish; the network then sees it widened.
        if mask.any() and not resize_mask(mask, width, height).any():
            box = (-(-camera.height // height), -(-camera.width // width))
            seen = ndimage.maximum_filter(mask, size=box)
            if self.corruption == "oracle":
                depth = np.where(seen, 0, depth)
        with torch.inference_mode():
            inputs = frame_to_input(color, depth, seen, keypoints, camera, self.size)
            output = self.model(inputs)
            asked = inputs.mask[0].numpy()
            answered = (output.restored & (output.depth > 0))[0].numpy() & asked
            known = within_learned(output, self.learned_range_m)[0].numpy() & asked
            found = output.depth[0].numpy()
            sure = output.confidence[0].numpy() if self.can_say else np.zeros_like(found)
            if self.rule is not None:
                sure = self.rule(signal_of(output, self.rule.signal)[0].numpy())
        whole = np.zeros((2, *mask.shape), np.float32)
        restored = np.zeros_like(mask)
        if mask.any():
            window = window_around(mask, 0)
            images = np.stack((found, np.clip(sure, 0, 1)))
            large, there = enlarge_restored(images, known, asked, mask.shape, window)
            restored[window] = there & mask[window]
            whole[:, *window] = np.where(restored[window], large, 0)
        count = max(int(asked.sum()), 1)
        return NetworkDepth(
            depth=whole[0],
            confidence=whole[1],
            restored=restored,
            no_answer=float((asked & ~answered).sum()) / count,
            out_of_range=float((answered & ~known).sum()) / count,
        )


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
        return cls(*_read_kind(path, "segmentation"), Path(path).name)

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
        return cls(*_read_kind(path, "hand-keypoints"), Path(path).name)

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


def _read_kind(path: str | Path, kind: str) -> tuple[Any, tuple[int, int]]:
    """A checkpoint's network of one kind, ready to be asked, and its size."""
    from hadr.training.checkpoints import load_checkpoint

    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return model.eval(), (int(meta["width"]), int(meta["height"]))


def trained_corruption(meta: dict[str, Any]) -> Corruption:
    """Read from a checkpoint's record whether it learned to use depth inside of the mask."""
    stored = meta.get("data", {}).get("corruption", meta.get("corruption", "oracle"))
    return "oracle" if str(stored).startswith(("oracle", "erased")) else "sensor"


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
    images, _ = enlarge_restored(values[None], known, known, shape)
    large: NDArray[np.float32] = images[0]
    return large


def enlarge_restored(
    values: FloatArray,
    known: BoolArray,
    asked: BoolArray,
    shape: tuple[int, ...],
    window: tuple[slice, slice] | None = None,
) -> tuple[NDArray[np.float32], BoolArray]:
    """Enlarge images, and the answer to the question where they hold something.

    Values are interpolated as by `enlarge_known`. A pixel of the result counts as restored where
    the nearest of the small pixels that were asked for is known: so beyond the mask's rim the
    neighbour inside of it decides, and a hole within the mask stays a hole.

    Args:
        values: K images, shape (K, h, w).
        known: Pixels that were restored, shape (h, w) bool.
        asked: Pixels that were to be restored, shape (h, w) bool.
        shape: (H, W) of the whole result.
        window: Rows and columns of the result that are wanted; all where it is left out.

    Returns:
        The images, shape (K, H, W) float32 or the window's, zeros where nothing is known at all;
        and where they hold a restored value, shape (H, W) bool or the window's.
    """
    rows, columns = window or (slice(0, shape[0]), slice(0, shape[1]))
    top, bottom, down = _neighbours(shape[0], known.shape[0], rows)
    left, right, across = _neighbours(shape[1], known.shape[1], columns)
    size = (len(top), len(left))
    if not known.any():
        return np.zeros((len(values), *size), np.float32), np.zeros(size, bool)

    stack = np.concatenate((np.where(known, values, 0), known[None])).astype(np.float32)
    tall = stack[:, top] * (1 - down[:, None]) + stack[:, bottom] * down[:, None]  # (K + 1, H, w)
    wide = tall[:, :, left] * (1 - across) + tall[:, :, right] * across  # (K + 1, H, W)
    total, weight = wide[:-1], wide[-1]

    pixel = np.ix_(np.where(down < 0.5, top, bottom), np.where(across < 0.5, left, right))
    _, near = ndimage.distance_transform_edt(~known, return_indices=True)
    nearest = stack[:-1, near[0][pixel], near[1][pixel]]
    _, asker = ndimage.distance_transform_edt(~(asked | known), return_indices=True)
    restored: BoolArray = known[asker[0][pixel], asker[1][pixel]]
    images = np.where(weight > 1e-3, total / np.maximum(weight, 1e-3), nearest)
    return images.astype(np.float32), restored


def _neighbours(
    target: int, source: int, wanted: slice
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Between which pixels the pixels of a resized line lie: both indices and the second's weight.

    A new pixel's centre c looks at (c + 0.5) * source / target - 0.5, as in `hadr.camera`.
    """
    centre = (np.arange(target)[wanted] + 0.5) * source / target - 0.5
    first = np.floor(centre).astype(np.int64)
    part = (centre - first).astype(np.float32)
    return first.clip(0, source - 1), (first + 1).clip(0, source - 1), part
