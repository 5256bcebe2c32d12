"""The trained networks that restore depth, each loaded once and asked frame by frame.

Numpy in, numpy out; those that find glass and hand are `hadr.trained_finders`. A network brings the
frame to its own size and its answer back. What it can't know is *not restored*: no ray met a voxel,
the offset in the voxel is at its end, or the depth is outside of the range in which the training
showed objects (`hadr.confidence.calibration.within_learned`). Such a pixel stays missing; it is
neither 0 metres away nor filled from its neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import BoolArray, Intrinsics, resize_depth, resize_mask, window_around
from hadr.confidence.calibration import ConfidenceRule, signal_of, within_learned
from hadr.confidence.frame_features import torn
from hadr.confidence.known_ground import Ground, Verdict
from hadr.confidence.sight import observe
from hadr.corruption import CORRUPTIONS, Corruption
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS

if TYPE_CHECKING:
    from torch import nn

    from hadr.models.network_input import HADRInput

SAMPLE_CHECKPOINTS = (
    "hadr-imagenet.safetensors", "hadr-plus-imagenet.safetensors",
    "unet-hand-handover.safetensors",
    "hadr-handover.safetensors", "hadr-plus-handover.safetensors",
)  # fmt: skip
"""The bundled checkpoints that restore depth."""
EDGE_M = 0.05
"""Nearer to an end of the learned range, metres, errors are larger.

On 24 bundled validation frames the bundled HADR errs by 2.7 cm and HADR-plus by 1.8 cm (root mean
square, mean over frames), and by 6.9 cm both if the frame is scaled until the glass is 3 cm before
the far end. 4 and 10 cm beyond it, 38 and 31 % of the depths outside that HADR-plus tells are right
to 2 cm, and of those inside 11 and 3 %: it keeps both. Of HADR's outside a third is, and it cannot
say which: they stay missing."""


@dataclass(frozen=True)
class NetworkDepth:
    """What a network says about one frame, at the frame's full size.

    Attributes:
        depth: z-depth in metres, shape (H, W) float32; 0 where nothing was restored.
        confidence: Shape (H, W) float32, 0..1; 0 where nothing was restored, and everywhere from a
            network that cannot say how sure it is.
        restored: Pixels of the mask with a depth, shape (H, W) bool.
        no_answer: Share of the mask's working pixels without any answer, 0..1.
        cut_off: Share of them that stay missing as HADR wanted an answer outside of its voxel.
        out_of_range: Share of them that stay missing as their answer lies outside of what was
            learned, 0..1.
        beyond: Share of them that are restored all the same, without confidence, 0..1.
        ground: Whether the frame lies on the network's ground.
        tolerance_m: The confidence is the probability that the depth is right to so many metres;
            None where it is none.
    """

    depth: NDArray[np.float32]
    confidence: NDArray[np.float32]
    restored: BoolArray
    no_answer: float
    cut_off: float
    out_of_range: float
    beyond: float
    ground: Verdict
    tolerance_m: float | None


@dataclass(frozen=True)
class DepthNetwork:
    """A depth network, loaded once.

    Attributes:
        model: The network as `hadr.training.checkpoints.for_inference` makes it.
        kind: One of `hadr.models.networks.DEPTH_NETWORKS`.
        size: (width, height) that it runs at, pixels.
        needs_hand: Whether it can't do without the hand's keypoints.
        corruption: Of the frames that it learned from.
        rule: From what it says of its answer to the probability that its depth is right; None
            where it was never calibrated, or cannot say.
        learned_range_m: Nearest and farthest depth of the objects that it learned from, metres;
            None where it is not known.
        ground: What else it knows of the frames that it learned from; None where that is not known.
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
    ground: Ground | None
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

    @property
    def skips_mask(self) -> bool:
        """Whether it never looks at depth that was measured inside the mask."""
        return NETWORKS[self.kind].skips_mask

    @property
    def erases(self) -> bool:
        """Whether it learned from frames without any depth inside the mask."""
        return CORRUPTIONS[self.corruption].erase

    @classmethod
    def load(cls, path: str | Path) -> DepthNetwork:
        """Read a depth network's checkpoint; errors as `load_checkpoint`, and for another kind."""
        from hadr.training.checkpoints import load_checkpoint

        return cls.of(*load_checkpoint(path), Path(path).name)

    @classmethod
    def of(cls, model: nn.Module, meta: dict[str, Any], name: str) -> DepthNetwork:
        """Take a network that is loaded already, its checkpoint's record, and a name for messages.

        Raises:
            ValueError: It is no depth network.
        """
        kind = meta.get("network", "hadr")
        if kind not in DEPTH_NETWORKS:
            raise ValueError(
                f"{name} holds a network of kind {kind!r}, expected one that restores depth: "
                f"{', '.join(DEPTH_NETWORKS)}"
            )
        from hadr.training.checkpoints import for_inference, trained_corruption

        config: Any = model.config
        stored = meta.get("confidence") if NETWORKS[kind].can_say else None
        learned = (meta.get("learned_range") or {}).get("depth_m")
        ground = meta.get("ground")
        recipe = (meta.get("preset") or {}).get("name", "unknown")
        return cls(
            model=for_inference(model),
            kind=kind,
            size=(int(meta["width"]), int(meta["height"])),
            needs_hand=getattr(config, "hand", "3d") != "none",
            corruption=trained_corruption(meta),
            rule=None if stored is None else ConfidenceRule.from_dict(stored),
            learned_range_m=None if learned is None else (float(learned[0]), float(learned[1])),
            ground=None if ground is None else Ground.from_dict(ground),
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
        measured: NDArray[np.float32] | None = None,
        unlike: tuple[str, ...] = (),
        *,
        beyond: bool = False,
    ) -> NetworkDepth:
        """Restore the mask's pixels.

        Args:
            color: RGB, shape (H, W, 3) uint8.
            depth: z-depth in metres as the network shall see it, shape (H, W); 0 = missing.
            camera: Intrinsics of both images.
            mask: Pixels to restore, shape (H, W) bool.
            keypoints: 21 hand keypoints, camera frame, metres, shape (21, 3).
            measured: The same as the camera measured it, inside the mask too. Where it is given,
                the frame gets no probability unless it lies on the network's ground. None: the
                ground is not asked.
            unlike: What else is unlike the training, in words; then it lies outside.
            beyond: Keep answers beyond the learned range, with the confidence 0.
        """
        import torch

        from hadr.models.network_input import enlarge_restored, frame_to_input

        width, height = self.size
        seen = mask
        # A mask thinner than a working pixel would vanish; the network then sees it widened.
        if mask.any() and not resize_mask(mask, width, height).any():
            box = (-(-camera.height // height), -(-camera.width // width))
            seen = ndimage.maximum_filter(mask, size=box)
            if self.erases:
                depth = np.where(seen, 0, depth)
        with torch.inference_mode():
            inputs = frame_to_input(color, depth, seen, keypoints, camera, self.size)
            output, ground, rule = self._ask(inputs, measured, unlike, color, mask)
            asked = inputs.mask[0].numpy()
            answered = (output.restored & (output.depth > 0))[0].numpy() & asked
            within = within_learned(output, self.learned_range_m)[0].numpy() & asked
            known = within_learned(output, None)[0].numpy() & asked if beyond else within
            ends = getattr(output, "clamped", None)
            clamped = np.zeros_like(asked) if ends is None else ends[0].numpy()
            found = output.depth[0].numpy()
            sure = np.zeros_like(found)
            if rule is not None:
                sure = rule(signal_of(output)[0].numpy())
            elif self.rule is None and self.can_say:
                sure = output.confidence[0].numpy()
        whole = np.zeros((2, *mask.shape), np.float32)
        restored = np.zeros_like(mask)
        if mask.any():
            window = window_around(mask, 0)
            images = np.stack((found, np.clip(sure, 0, 1)))
            large, there = enlarge_restored(images, known, asked, mask.shape, window)
            restored[window] = there & mask[window]
            whole[:, *window] = np.where(restored[window], large, 0)
            if self.learned_range_m is not None:
                near, far = self.learned_range_m
                whole[1, (whole[0] < near) | (whole[0] > far)] = 0
        count = max(int(asked.sum()), 1)
        return NetworkDepth(
            depth=whole[0],
            confidence=whole[1],
            restored=restored,
            no_answer=float((asked & ~answered).sum()) / count,
            cut_off=float((answered & clamped).sum()) / count,
            out_of_range=float((answered & ~clamped & ~known).sum()) / count,
            beyond=float((known & ~within).sum()) / count,
            ground=ground,
            tolerance_m=None if rule is None else rule.calibration.tolerance_m,
        )

    def _ask(
        self,
        inputs: HADRInput,
        measured: NDArray[np.float32] | None,
        unlike: tuple[str, ...],
        color: NDArray[np.uint8],
        mask: BoolArray,
    ) -> tuple[Any, Verdict, ConfidenceRule | None]:
        """The answer, whether the frame lies on the ground, and what the confidence means there."""
        if measured is None:
            return self.model(inputs), Verdict(None), self.rule
        unlike += torn(mask)
        if self.ground is None or not inputs.mask.any():
            return self.model(inputs), Verdict(False if unlike else None, why=unlike), None
        small = np.nan_to_num(resize_depth(measured, *self.size))
        part = NETWORKS[self.kind].sees
        seen = observe(self.model, part, inputs, small, self.learned_range_m, color, mask)
        verdict = self.ground.judge(seen)
        if unlike:
            verdict = replace(verdict, inside=False, why=unlike + verdict.why)
        here = self.ground.fields[verdict.field].rule or self.rule
        return seen.output, verdict, here if verdict.inside and self.rule else None

    def notes(self, answer: NetworkDepth, corruption: Corruption, camera: Intrinsics) -> list[str]:
        """Say which network it was, what it was not trained for, and what it could not do."""
        (width, height), notes = self.size, []
        if CORRUPTIONS[corruption].erase != self.erases and not self.skips_mask:
            learned = "without" if self.erases else "with"
            notes.append(
                f"{self.name} learned from frames {learned} measured depth inside the mask, and "
                "was now given the other; expect larger errors"
            )
        to = f"; its depth was interpolated to {camera.width}x{camera.height}"
        notes.append(
            f"{self.title} checkpoint {self.name} ({self.trained}) ran at {width}x{height}"
            + to * ((camera.width, camera.height) != self.size)
        )
        if self.name in SAMPLE_CHECKPOINTS:
            notes.append(
                "the sample checkpoint has seen computed pictures only; expect larger errors on "
                "real ones"
            )
        if not self.can_say:
            notes.append(f"{self.title} cannot say how sure it is: its confidence is 0")
        elif self.rule is None:
            notes.append(
                f"the confidence is no probability but the network's own score, which only orders "
                f"pixels: {self.name} was never calibrated"
            )
        if answer.ground.inside is False:
            less = "there is no probability of being right" if self.rule else "expect larger errors"
            notes.append(
                f"the frame is unlike those that {self.title} learned from, so {less}: "
                + "; ".join(answer.ground.why)
            )
        elif self.rule is not None and answer.tolerance_m is None:
            notes.append(
                f"there is no probability of being right: {self.name} does not say which frames it "
                "learned from, so that it can't be told whether this one is like them; `hadr "
                "calibrate` adds that"
            )
        if answer.no_answer == 1:
            notes.append(
                f"{self.title} restored nothing: along no ray of the mask's pixels was depth "
                "measured from which it could begin (none met an occupied voxel)"
            )
            return notes
        learned = "what it has learned"
        if self.learned_range_m is not None:
            near, far = self.learned_range_m
            learned += f" ({near:.2f} to {far:.2f} m)"
            seen = answer.depth[answer.restored]
            if seen.size and not near + EDGE_M < np.median(seen) < far - EDGE_M:
                notes.append(
                    f"the depth lies at the edge of {learned}, or beyond: expect larger errors of "
                    f"{self.title}"
                )
        shares = (
            (answer.no_answer, f"stay missing: {self.title} has no answer"),
            (answer.cut_off, "stay missing: the answer ends at the edge of the voxel it chose"),
            (answer.out_of_range, f"stay missing: their depth would lie outside of {learned}"),
            (answer.beyond, f"have a depth outside of {learned}, and no probability"),
        )
        told = [f"{100 * share:.1f} % {what}" for share, what in shares if share]
        if told:
            notes.append(f"of the mask's pixels {'; '.join(told)}")
        return notes
