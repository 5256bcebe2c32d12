"""What finds glass, hand and keypoints in a frame, and the hand that was found or given.

Numpy in, numpy out: a trained network is loaded once, brings each frame to its own size and its
answer back. A hand is held against the frame (`hadr.models.hand.plausible`): a found one that does
not fit is none, a given one is used and doubted.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from hadr.camera import BoolArray, FloatArray, Intrinsics, resize_color, resize_mask
from hadr.frame_checks import check_apart, check_mask_form, checked_mask
from hadr.models.hand.plausible import HandCheck, NoHandError, check_hand

if TYPE_CHECKING:
    from hadr.models.hand.mediapipe_hand import MediaPipeHand

GIVEN = "given"
"""The source of a hand that the caller gave."""
NO_HAND = "no hand found"

Points = NDArray[np.float64]


class SeenMasks(NamedTuple):
    """The pixels of the glass and, if the network has such a class, of hand and arm, (H, W) bool.

    And the mean probability of a hand in these, 0..1; 0 where there are none.
    """

    glass: BoolArray
    hand: BoolArray | None
    presence: float


@dataclass(frozen=True)
class _Finder:
    """A network, loaded once, the (width, height) that it runs at, and its file's name."""

    model: Any
    size: tuple[int, int]
    name: str
    kind: ClassVar[str]

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a checkpoint of this kind; errors as `hadr.training.checkpoints.load_kind`."""
        from hadr.training.checkpoints import load_kind

        return cls(*load_kind(path, cls.kind), Path(path).name)


class Segmentation(_Finder):
    """A segmentation network: its first class is the object, its second, if any, the hand."""

    kind = "segmentation"

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


class HandKeypoints(_Finder):
    """A hand-keypoint network; frames are brought to its size before the hand is cut out."""

    kind = "hand-keypoints"
    needs_hand_mask = True

    def find(
        self,
        color: NDArray[np.uint8],
        depth: FloatArray,
        camera: Intrinsics,
        mask: BoolArray,
        hand_mask: BoolArray | None,
    ) -> Points:
        """Find the keypoints: camera frame, metres, (21, 3).

        From RGB (H, W, 3) uint8, z-depth (H, W), metres, 0 = missing, the intrinsics of both, and
        the pixels of the glass, and of hand and arm, (H, W) bool. NoHandError where there are none
        of a hand, or none of them has a depth.
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


HandFinder: TypeAlias = "HandKeypoints | MediaPipeHand"
"""What finds a hand's keypoints; `find` gives them, or raises a NoHandError."""


@dataclass(frozen=True)
class Hand:
    """A hand that was given, or found.

    Attributes:
        keypoints: 21 keypoints, camera frame, metres, shape (21, 3).
        source: `GIVEN`, or the name of what found it.
        check: How it fits to the frame.
    """

    keypoints: Points
    source: str
    check: HandCheck

    @property
    def accepted(self) -> bool:
        """Whether it was used: a found hand that does not fit is none."""
        return self.source == GIVEN or not self.check.problems

    @property
    def doubtful(self) -> bool:
        """Whether it was used and does not fit: then the result has no probability."""
        return self.accepted and bool(self.check.problems)


def find_masks(
    segmentation: Segmentation | None,
    color: NDArray[np.uint8],
    clean: NDArray[np.float32],
    mask: BoolArray | None,
    hand_mask: BoolArray | None,
    ask_hand: bool,
    notes: list[str],
) -> tuple[BoolArray, BoolArray | None, float | None]:
    """The pixels to restore and those of the hand, given or predicted, and how sure these are.

    What is not given is predicted, the hand's if `ask_hand`; without a network the pixels to
    restore are those without depth, which is 0 in `clean`. The last is as `SeenMasks.presence`,
    None where the hand's pixels are not a network's. ValueError where a mask is unusable.
    """
    if hand_mask is not None:
        check_mask_form("hand mask", hand_mask, clean)
        check_apart(mask, hand_mask)
    ask_hand = ask_hand and hand_mask is None
    if segmentation is None or not (mask is None or ask_hand):
        if segmentation is not None:
            notes.append(f"the mask is given: {segmentation.name} was not used")
        return checked_mask(mask, clean, notes), hand_mask, None
    found, presence = segmentation.masks(color), None
    if ask_hand:
        hand_mask, presence = found.hand, found.presence
    if mask is not None:
        return checked_mask(mask, clean, notes), hand_mask, presence
    there = found.glass.any()
    said = "is not given but predicted by" if there else "is empty: no glass was found by"
    notes.append(f"the mask {said} {segmentation.name}")
    return found.glass, hand_mask, presence


def find_hand(
    finder: HandFinder,
    color: NDArray[np.uint8],
    seen: FloatArray,
    camera: Intrinsics,
    glass: BoolArray,
    hand_mask: BoolArray | None,
    measured: FloatArray,
    presence: float | None,
    notes: list[str],
) -> Hand | None:
    """Have a hand found, and note whether it is one; None: none was found.

    `seen` is the depth that the finder may use, `measured` as the camera gave it, z-depth in
    metres, (H, W), 0 = missing; `presence` is the mean probability of a hand in the mask, None
    where that is not a network's. ValueError where the finder needs a hand mask and there is none.
    """
    if finder.needs_hand_mask and hand_mask is None:
        raise ValueError(
            f"{finder.name} needs to know where the hand is: give a hand mask (--hand-mask), "
            "or a segmentation checkpoint (--segmentation) that predicts it"
        )
    try:
        found = finder.find(color, seen, camera, glass, hand_mask)
        check = check_hand(found, measured, camera, glass, hand_mask, presence)
    except NoHandError as why:
        notes.append(f"{NO_HAND} by {finder.name}: {why}")
        return None
    hand = Hand(found, finder.name, check)
    if hand.accepted:
        notes.append(f"the hand's keypoints are not given but predicted by {finder.name}")
    else:
        problems = "; ".join(hand.check.problems)
        notes.append(f"{NO_HAND}: what {finder.name} took for one is none: {problems}")
    if isinstance(finder, HandKeypoints):
        notes.append(
            f"{finder.name} has learned from computed pictures; in photographs let MediaPipe "
            "find the hand"
        )
    return hand
