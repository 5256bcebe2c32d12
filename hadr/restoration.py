"""The front door: one RGB-D frame in, restored depth out (numpy in, numpy out).

A `Restorer` loads its networks once and then restores frame after frame: it finds the mask and the
hand where they are not given, restores the mask's depth, and says in `Restoration.notes` what it
did and, above all, what it could not do: where no trained network fits the frame, the result is a
classical fill and is called one. `restore` is its short form for a single frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hadr import frame_checks as checks
from hadr import trained_finders as finders
from hadr.camera import BoolArray, FloatArray, Intrinsics, valid_depth
from hadr.confidence.known_ground import Verdict
from hadr.corruption import CORRUPTIONS, Corruption
from hadr.models.hand.plausible import check_hand
from hadr.models.networks import DEPTH_NETWORKS
from hadr.rivals import classical
from hadr.trained_networks import DepthNetwork

METHODS = ("auto", *DEPTH_NETWORKS, "nearest", "inpaint", "hand-median")
CHECKPOINT_NAME = "hadr-imagenet.safetensors"
"""The sample checkpoint that is taken where none is named."""
Depth = NDArray[np.float32]


@dataclass(frozen=True)
class Restoration:
    """A restored frame.

    Attributes:
        depth: z-depth in metres, shape (H, W) float32, 0 where still missing.
        confidence: Shape (H, W) float32, 0..1: 1 where the camera measured, 0 where still missing.
            In restored pixels, where `tolerance_m` is set, the probability that the depth is right
            to so many metres; otherwise HADR-plus's own score, which only orders pixels. 0 for all
            other methods, which cannot say how sure they are.
        restored: Pixels whose depth comes from the method, shape (H, W) bool.
        method: The method that was really used; "none" where there was nothing to restore.
        notes: What a user must know about this result, one sentence each.
        tolerance_m: What a calibrated confidence speaks of, metres; None where it is none, or does
            not hold: away from the frames that the network learned from.
        mask: Pixels that were to be restored, given or predicted, shape (H, W) bool.
        hand_mask: Pixels of hand and arm, given or predicted, shape (H, W) bool; None: not known.
        hand: The hand that was given or found, also one that was not accepted; None: none was, or
            there was nothing to restore.
        ground: Whether the frame is like those that the network learned from; None without network.
    """

    depth: Depth
    confidence: Depth
    restored: BoolArray
    method: str
    notes: tuple[str, ...]
    tolerance_m: float | None
    mask: BoolArray
    hand_mask: BoolArray | None = None
    hand: finders.Hand | None = None
    ground: Verdict | None = None

    @property
    def keypoints(self) -> finders.Points | None:
        """The 21 hand keypoints that were used, if any were."""
        return self.hand.keypoints if self.hand is not None and self.hand.accepted else None


@dataclass(frozen=True)
class _Known:
    """What is known of a frame before its depth is restored; shapes as in `Restoration`."""

    color: NDArray[np.uint8]
    depth: Depth
    camera: Intrinsics
    target: BoolArray
    given_mask: bool
    hand_mask: BoolArray | None
    presence: float | None
    hand: finders.Hand | None = None

    def unlike_training(self, network: DepthNetwork, trusted: Corruption) -> Iterator[str]:
        """What the network is given in another way than in training, in words."""
        if CORRUPTIONS[trusted].erase != network.erases and not network.skips_mask:
            was, now = ("none", "is") if network.erases else ("some", "is none")
            yield f"there {now} measured depth in the mask, in training there was {was}"
        if abs((pixels := self.camera.fy / self.camera.fx) - 1) > checks.SQUARE:
            yield f"fy is {pixels:.2f} times fx, in training pixels were square"
        if not self.given_mask:
            yield "the mask is not given, in training it was the true one"
        if self.hand is not None and self.hand.source != finders.GIVEN:
            yield f"the hand was found by {self.hand.source}, in training it was the true one"
        yield from self.odd_color()

    def odd_color(self) -> tuple[str, ...]:
        """What the hand's pixels say of the picture, in words."""
        if self.hand is None or not self.hand.accepted:
            return ()
        place = self.camera, self.target, self.hand.keypoints
        return checks.told_color(self.color, self.depth, *place)

    @property
    def keypoints(self) -> finders.Points | None:
        """Those of a hand that is used."""
        return self.hand.keypoints if self.hand is not None and self.hand.accepted else None


@dataclass(frozen=True)
class _Filled:
    """The frame's depth after filling; only the pixels `changed` took another one."""

    depth: FloatArray
    confidence: Depth
    changed: BoolArray
    method: str
    tolerance_m: float | None = None
    ground: Verdict | None = None


class Restorer:
    """Restores depth frame after frame; reads its networks once, the depth one when needed.

    Args:
        method: One of `METHODS`. "auto" takes the depth network where it fits the frame, else
            "nearest", and says so in the notes. The kind of a network, such as "hadr-plus", insists
            on one of that kind. "nearest": nearest valid depth. "inpaint": OpenCV's Telea
            inpainting. "hand-median": the hand's median depth (needs keypoints).
        network: A depth network, or its checkpoint (`.safetensors`); None looks for the sample
            checkpoint of the method.
        corruption: What becomes of depth that the camera measured inside of the mask; one of
            `CORRUPTIONS`. "oracle" does not trust it: on glass it is mostly the background.
            "sensor" gives it to the network; the methods without learning keep it and fill what is
            missing. None does as the network was trained, and "oracle" without one.
        segmentation: A network, or its checkpoint, that finds mask and hand mask.
        keypoint_network: A network, or its checkpoint, that finds the hand's keypoints, or
            MediaPipe (`hadr.models.hand.mediapipe_hand.MediaPipeHand`). A hand that it finds
            counts only if it is plausible (`hadr.models.hand.plausible`).

    Raises:
        ValueError: Method or corruption is unknown.
        FileNotFoundError: A checkpoint that was asked for does not exist.
    """

    def __init__(
        self,
        method: str = "auto",
        network: str | Path | DepthNetwork | None = None,
        *,
        corruption: Corruption | None = None,
        segmentation: str | Path | finders.Segmentation | None = None,
        keypoint_network: str | Path | finders.HandFinder | None = None,
    ) -> None:
        for name, value, known in (
            ("method", method, METHODS),
            ("corruption", corruption, (None, *CORRUPTIONS)),
        ):
            if value not in known:
                expected = ", ".join(str(one) for one in known if one)
                raise ValueError(f"{name} must be one of {expected}, got {value!r}")
        if network is not None and method != "auto" and method not in DEPTH_NETWORKS:
            raise ValueError(
                f"method {method} uses no depth network, but one is named; leave out either "
                "(on the command line: --method, --checkpoint)"
            )
        self.method, self.corruption, self._given = method, corruption, network
        if isinstance(segmentation, str | Path):
            segmentation = finders.Segmentation.load(segmentation)
        if isinstance(keypoint_network, str | Path):
            keypoint_network = finders.HandKeypoints.load(keypoint_network)
        self.segmentation, self.finder = segmentation, keypoint_network

    @cached_property
    def network(self) -> DepthNetwork | str:
        """The depth network, or why there is none."""
        given = self._given
        if self.method != "auto" and self.method not in DEPTH_NETWORKS:
            return "none was asked for"
        if given is None:
            from hadr.data.samples import samples_dir

            auto = self.method in ("auto", "hadr")
            name = CHECKPOINT_NAME if auto else f"{self.method}-imagenet.safetensors"
            try:
                given = samples_dir() / "checkpoints" / name
            except FileNotFoundError:
                return "the folder data_samples with the sample checkpoint was not found"
            if not given.is_file():
                return f"there is no {name} in {given.parent}"
        network = given if isinstance(given, DepthNetwork) else DepthNetwork.load(given)
        if self.method not in ("auto", network.kind):
            return f"{network.name} holds a network of kind {network.kind}"
        return network

    def __call__(
        self,
        color: NDArray[np.uint8],
        depth: FloatArray,
        camera: Intrinsics,
        mask: BoolArray | None = None,
        keypoints: NDArray[np.floating] | None = None,
        hand_mask: BoolArray | None = None,
    ) -> Restoration:
        """Restore one frame.

        Only the mask's pixels change. A network runs at the size it was trained at; its depth is
        brought back to the full size by interpolating bilinearly between the restored pixels, and
        by taking the nearest one at the mask's border. A pixel that the network can't know stays
        missing.

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres, shape (H, W) float; 0, NaN and infinity count as missing.
            camera: Intrinsics of both images.
            mask: Pixels of the transparent object, shape (H, W) bool. None has them predicted;
                without a segmentation network the pixels that have no depth are restored.
            keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3). None has them
                predicted, if there is a network for it.
            hand_mask: Pixels of hand and arm, shape (H, W) bool: sharpens "hand-median", and tells
                where to look for keypoints. None has them predicted, if there is a network for it.

        Returns:
            The restored frame. Where no glass is found, its depth is as measured.

        Raises:
            ValueError: An input is unusable, or what the method needs is missing; the message names
                the value and what is expected.
        """
        notes: list[str] = []
        clean = checks.checked_depth(color, depth, camera, notes)
        given = None if keypoints is None else checks.checked_hand(keypoints, camera, notes)
        finder = self.finder if given is None else None
        ask_hand = self.method == "hand-median" or (finder is not None and finder.needs_hand_mask)
        target, hand_mask, presence = finders.find_masks(
            self.segmentation, color, clean, mask, hand_mask, ask_hand, notes
        )
        hand = None
        if target.any():
            if not valid_depth(clean[~target]).any():
                raise ValueError(
                    f"the mask covers all {int(target.sum())} pixels that could have depth, "
                    "expected at least one pixel with depth outside of it"
                )
            if mask is not None or self.segmentation is not None:
                checks.note_size(target, clean, camera, notes)
            known = _Known(color, clean, camera, target, mask is not None, hand_mask, presence)
            if given is not None:
                check = check_hand(given, clean, camera, target, given=True)
                hand = finders.Hand(given, finders.GIVEN, check)
                known = replace(known, hand=hand)
                if hand.doubtful:
                    notes.append(
                        f"the given hand does not fit this frame: {'; '.join(hand.check.problems)};"
                        " what is restored from it may be off by as much, and has no probability"
                    )
            known, filled = self._fill(known, notes)
            hand = known.hand
            notes += self._unused(filled.method, given is not None, known)
        else:
            notes.append("nothing to restore: the depth is as measured")
            filled = _Filled(clean, np.zeros_like(clean), target, "none")
        restored_depth, changed = filled.depth.astype(np.float32), filled.changed
        restored = changed & (restored_depth > 0)
        if lost := int((changed & ~restored).sum()):
            notes.append(f"{lost} of {int(changed.sum())} pixels of the mask could not be restored")
        if outside := int((~changed & (restored_depth <= 0)).sum()):
            notes.append(f"{outside} pixels outside the mask have no depth and stay missing")
        confidence = np.where(changed, np.where(restored, filled.confidence, 0), clean > 0)
        return Restoration(
            depth=restored_depth,
            confidence=confidence.astype(np.float32),
            restored=restored,
            method=filled.method,
            notes=tuple(notes),
            tolerance_m=filled.tolerance_m,
            mask=target,
            hand_mask=hand_mask,
            hand=hand,
            ground=filled.ground,
        )

    def _fill(self, known: _Known, notes: list[str]) -> tuple[_Known, _Filled]:
        """Find the hand if need be, and fill the mask with the network or without."""
        network = self._fitting(known.hand is not None or self.finder is not None)
        learned: Corruption = "oracle" if isinstance(network, str) else network.corruption
        trusted = self.corruption or learned
        seen = checks.depth_to_use(known.depth, known.target, trusted)
        if known.hand is None and self.finder is not None:
            searched = known.color, seen, known.camera, known.target, known.hand_mask
            hand = finders.find_hand(self.finder, *searched, known.depth, known.presence, notes)
            known = replace(known, hand=hand)
            network = self._fitting(known.keypoints is not None)
        skipped_by = None if isinstance(network, str) or not network.skips_mask else network.title
        checks.note_measured(known.depth, known.target, trusted, skipped_by, notes)
        if isinstance(network, str):
            method = self._without_network(network, notes)
            notes += known.odd_color()
            holes = known.target & ~valid_depth(seen)
            filled = classical.fill(
                method, known.depth, holes, known.camera, known.keypoints, known.hand_mask
            )
            return known, _Filled(filled, np.zeros_like(known.depth), holes, method)
        asked = replace(network, corruption=trusted)
        unlike = tuple(known.unlike_training(network, trusted))
        place = known.camera, known.target, known.keypoints
        answer = asked.restore(
            known.color, seen, *place, known.depth, unlike, beyond=network.can_say
        )
        notes += network.notes(answer, trusted, known.camera)
        filled = np.where(known.target, answer.depth, known.depth)
        sure, tolerance = answer.confidence, answer.tolerance_m
        if known.hand is not None and known.hand.doubtful:
            sure, tolerance = np.zeros_like(sure), None
        return known, _Filled(filled, sure, known.target, network.kind, tolerance, answer.ground)

    def _unused(self, method: str, given: bool, known: _Known) -> Iterator[str]:
        """What was given or found and not used, in words."""
        finder, keypoints = self.finder, known.keypoints
        if finder is not None and given:
            yield f"the hand is given: {finder.name} was not used"
        if keypoints is not None and method in ("nearest", "inpaint"):
            yield f"{method} does not look at the hand"
        asked = finder is not None and not given and finder.needs_hand_mask
        looked = method == "hand-median" or asked
        if known.hand_mask is not None and not looked:
            yield f"{method} does not look at the hand mask"

    def _fitting(self, hand_is_known: bool) -> DepthNetwork | str:
        """The network that fits the frame, or why there is none."""
        if self._given is None and not hand_is_known:  # needs no file to be read
            return "the sample checkpoint needs 21 hand keypoints and there are none"
        network = self.network
        if isinstance(network, DepthNetwork) and network.needs_hand and not hand_is_known:
            return f"{network.name} needs 21 hand keypoints and there are none"
        return network

    def _without_network(self, why: DepthNetwork | str, notes: list[str]) -> str:
        """The classical method to use where no network fits."""
        if self.method in DEPTH_NETWORKS:
            reasons = (note for note in notes if note.startswith(finders.NO_HAND))
            raise ValueError(
                "; ".join((f"method {self.method}: no checkpoint fits: {why}", *reasons))
            )
        if self.method != "auto":
            return self.method
        notes.append(f"no checkpoint fits: {why}; the result is nearest valid depth, not HADR")
        return "nearest"


def restore(
    color: NDArray[np.uint8],
    depth: FloatArray,
    camera: Intrinsics,
    mask: BoolArray | None = None,
    keypoints: NDArray[np.floating] | None = None,
    method: str = "auto",
    checkpoint: str | Path | None = None,
    hand_mask: BoolArray | None = None,
    *,
    corruption: Corruption | None = None,
) -> Restoration:
    """Restore the depth of a transparent object in one RGB-D frame.

    The short form of `Restorer`, which explains all arguments, reads its networks once for many
    frames, and can predict mask and keypoints.
    """
    restorer = Restorer(method, checkpoint, corruption=corruption)
    return restorer(color, depth, camera, mask, keypoints, hand_mask)
