"""The trained networks that find glass, hand and keypoints in a frame, each loaded once.

Numpy in, numpy out: each brings the frame to its own size and its answer back.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from hadr.camera import (
    BoolArray,
    Intrinsics,
    resize_color,
    resize_mask,
)
from hadr.models.hand.plausible import NoHandError

if TYPE_CHECKING:
    pass


class SeenMasks(NamedTuple):
    """What a segmentation network sees in a picture.

    Attributes:
        glass: The object's pixels, shape (H, W) bool.
        hand: Those of hand and arm, shape (H, W) bool; None if the network has no such class.
        presence: The mean probability of a hand in these, 0..1; 0 where there are none.
    """

    glass: BoolArray
    hand: BoolArray | None
    presence: float


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

    def masks(self, color: NDArray[np.uint8]) -> SeenMasks:
        """Find the glass, and the hand with the arm, in RGB (H, W, 3) uint8."""
        import torch

        from hadr.models.segmentation import predict_logits

        height, width = color.shape[:2]
        small = resize_color(color, *self.size).astype(np.float32) / 255
        with torch.inference_mode():
            picture = torch.from_numpy(np.ascontiguousarray(small.transpose(2, 0, 1)))[None]
            logits = predict_logits(self.model, picture)[0].numpy()  # (C, h, w)
        large = [resize_mask(part > 0, width, height) for part in logits[:2]]
        if len(large) < 2:
            return SeenMasks(large[0], None, 0.0)
        sure = expit(logits[1][logits[1] > 0])
        return SeenMasks(large[0], large[1], float(sure.mean()) if sure.size else 0.0)


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
    needs_hand_mask: ClassVar[bool] = True

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
        hand_mask: BoolArray | None,
    ) -> NDArray[np.float64]:
        """Find the keypoints: camera frame, metres, (21, 3).

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres, shape (H, W); 0 = missing.
            camera: Intrinsics of both images.
            mask: The glass's pixels, shape (H, W) bool.
            hand_mask: Pixels of hand and arm, shape (H, W) bool.

        Raises:
            NoHandError: There are no pixels of a hand, or none of them has a depth.
        """
        import torch

        from hadr.models.hand.keypoints import keypoints_where_seen
        from hadr.models.network_input import frame_to_input

        if hand_mask is None or not hand_mask.any():
            raise NoHandError("none is seen in the picture")
        inputs = frame_to_input(color, depth, mask, None, camera, self.size)
        hand = torch.from_numpy(resize_mask(hand_mask, *self.size).copy())[None]
        with torch.inference_mode():
            found = keypoints_where_seen(self.model, inputs, hand)[0]
        if not bool(found.any()):
            raise NoHandError("the pixels in which one is seen have no depth")
        return np.asarray(found.double().numpy())


def _read_kind(path: str | Path, kind: str) -> tuple[Any, tuple[int, int]]:
    """A checkpoint's network of one kind, ready to be asked, and its size."""
    from hadr.training.checkpoints import load_checkpoint

    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return model.eval(), (int(meta["width"]), int(meta["height"]))
