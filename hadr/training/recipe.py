"""A training recipe: network, size, schedule, augmentation; and what a network is given."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from hadr.corruption import Corruption
from hadr.models.config import NetworkConfig
from hadr.records.option_words import FILE, LARGEST_SEED, check_range
from hadr.records.provenance import IF_CHANGED, record_of

if TYPE_CHECKING:
    from hadr.training.losses import LossWeights

Schedule = Literal["step", "cosine"]
Precision = Literal["32-true", "bf16-mixed"]
Optimizer = Literal["adam", "adamw"]
Accelerator = Literal["auto", "cpu", "cuda"]
TRUE = "true"


def _hadr() -> NetworkConfig:
    from hadr.models.hadr import HADRConfig

    return HADRConfig()


def _printed() -> LossWeights:
    from hadr.training.losses import PRINTED

    return PRINTED


@dataclass(frozen=True)
class Preset:
    """A training recipe.

    Args:
        name: Its name.
        width: Width of the network's input, pixels; frames are squashed to width x height.
        height: Height of the network's input, pixels.
        network: The kind of network, such as hadr; `hadr.models.networks.NETWORKS` has all.
        model: The network's configuration.
        weights: Weights of HADR's loss terms.
        epochs: Passes over the training frames.
        schedule: "step": the learning rate falls to a tenth after `drop_epoch` epochs; "cosine":
            it falls to 0 along half a cosine.
        drop_epoch: After this many epochs the step comes.
        learning_rate: Adam's learning rate before that.
        warmup_epochs: So long the rate rises linearly from 0; parts of an epoch count.
        clip_norm: Longest gradient of a step; longer ones are scaled down. None leaves them.
        average_decay: Weights of the result: the running average of those of all steps, with this
            share kept a step, such as 0.999. None takes the last step's.
        batch_size: Frames in a step.
        true_voxel_epochs: In the first so many epochs a ray takes its true voxel, not the most
            probable one (ledger, row 10).
        ray_stride: In training only every n-th masked pixel in row and column is restored, at a
            random start; 1 takes all.
        augment: Augment the colour of training frames (`hadr.data.augmentation`).
        mirror: Probability that a training frame is mirrored: a left hand for a right one.
        zoom: Training frames are enlarged by up to this factor and cropped; 1 leaves them.
        roll_deg: Training frames are turned about the optical axis by up to this angle, degrees.
        precision: Arithmetic of the forward pass in training, "32-true" or "bf16-mixed".
        validation_frames: At most so many validation frames, evenly spread, are scored after each
            epoch; None scores all.
        keypoint_noise: Standard deviation of the error that each keypoint coordinate of a training
            frame is given, metres; half of the variance is common to the whole hand.
        optimizer: "adam", or "adamw" with decoupled weight decay.
        weight_decay: That of AdamW.
        milestones: With "step", shares of the training, 0..1 and rising, at each of which the rate
            is multiplied by `decay`; where there are any, `drop_epoch` says nothing.
        decay: Factor at each milestone.
        restarts: With "cosine", shares of the training, 0..1 and rising, at each of which the
            cosine begins anew, for trainings in stages.
        encoder_rate: Factor on the rate of the network's slow encoders (`hadr.models.networks`): a
            Swin Transformer from random weights collapses at 1e-3 and not at 1e-4 (ledger, row 29).

    Raises:
        ValueError: A count is not positive, or another number is out of its range.
    """

    name: str
    width: int
    height: int
    network: str = "hadr"
    model: NetworkConfig = field(default_factory=_hadr)
    weights: LossWeights = field(default_factory=_printed)
    epochs: int = 100
    schedule: Schedule = "step"
    drop_epoch: int = 80
    learning_rate: float = 1e-3
    warmup_epochs: float = 0.0
    clip_norm: float | None = None
    average_decay: float | None = None
    batch_size: int = 40
    true_voxel_epochs: int = 6
    ray_stride: int = 1
    augment: bool = True
    mirror: float = 0.0
    zoom: float = 1.0
    roll_deg: float = 0.0
    precision: Precision = "32-true"
    validation_frames: int | None = None
    keypoint_noise: float = field(default=0.0, metadata=IF_CHANGED)
    optimizer: Optimizer = field(default="adam", metadata=IF_CHANGED)
    weight_decay: float = field(default=0.0, metadata=IF_CHANGED)
    milestones: tuple[float, ...] = field(default=(), metadata=IF_CHANGED)
    decay: float = field(default=0.1, metadata=IF_CHANGED)
    restarts: tuple[float, ...] = field(default=(), metadata=IF_CHANGED)
    encoder_rate: float = field(default=1.0, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        counts = ("width", "height", "epochs", "batch_size", "ray_stride", "validation_frames")
        for name in counts:
            if (count := getattr(self, name)) is not None and count < 1:
                raise ValueError(f"{name} must be at least 1, got {count}")
        choices = {"schedule": Schedule, "precision": Precision, "optimizer": Optimizer}
        for name, kinds in choices.items():
            if (chosen := getattr(self, name)) not in (known := get_args(kinds)):
                raise ValueError(f"{name} must be {' or '.join(map(repr, known))}, got {chosen!r}")
        if self.optimizer == "adam" and self.weight_decay:
            raise ValueError(f"weight_decay is AdamW's, got {self.weight_decay} with 'adam'")
        for name, shares in (("milestones", self.milestones), ("restarts", self.restarts)):
            if any(late <= early for early, late in pairwise((0.0, *shares, 1.0))):
                raise ValueError(f"{name} must rise strictly between 0 and 1, got {shares}")
        for name, value, low, high in (
            ("warmup_epochs", self.warmup_epochs, 0, self.epochs),
            ("average_decay", self.average_decay or 0, 0, 1),
            ("drop_epoch", self.drop_epoch, 0, math.inf),
            ("mirror", self.mirror, 0, 1),
            ("zoom", self.zoom, 1, 4),
            ("roll_deg", self.roll_deg, 0, 45),
            ("keypoint_noise", self.keypoint_noise, 0, 0.1),
            ("weight_decay", self.weight_decay, 0, 1),
            ("decay", self.decay, 0, 1),
            ("encoder_rate", self.encoder_rate, 0, 10),
        ):
            if not low <= value <= high:
                raise ValueError(f"{name} must be from {low} to {high}, got {value}")
        if self.clip_norm is not None and not self.clip_norm > 0:
            raise ValueError(f"clip_norm must be positive, got {self.clip_norm}")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the network's input, pixels."""
        return self.width, self.height

    def rate(self, progress: float, start: float | None = None) -> float:
        """Give the learning rate.

        Args:
            progress: Epochs so far; 2.5 is the middle of the third.
            start: The rate that is scheduled; the recipe's where it is left out.
        """
        rate = self.learning_rate if start is None else start
        if self.schedule == "cosine":
            share, ends = min(progress / self.epochs, 1.0), (0.0, *self.restarts, 1.0)
            begin, end = next(pair for pair in pairwise(ends) if share < pair[1] or pair[1] == 1)
            rate *= 0.5 * (1 + math.cos(math.pi * (share - begin) / (end - begin)))
        elif self.milestones:
            rate *= self.decay ** sum(progress >= m * self.epochs for m in self.milestones)
        elif progress >= self.drop_epoch:
            rate *= 0.1
        if progress < self.warmup_epochs:
            rate *= progress / self.warmup_epochs
        return rate

    def to_dict(self) -> dict[str, Any]:
        """The recipe as built-in types, for JSON (`record_of`)."""
        return record_of(self)


@dataclass(frozen=True)
class Given:
    """What a network is given besides colour: depth, masks and keypoints."""

    corruption: Corruption = "oracle"
    """Of the depth. oracle: none in the object's mask; analytic: a stereo camera imitated by
    formulas; sensor: the frames' raw depth; erased: the same but none in the mask."""
    masks: Annotated[str, FILE] = TRUE
    """'true', or a segmentation checkpoint whose predictions are given."""
    keypoints: Annotated[str, FILE] = TRUE
    """'true', or a hand-keypoints checkpoint whose predictions are given."""
    seed: int = 0
    """Seed of everything that is drawn by chance."""

    def check(self) -> None:
        """Check the seed, and load the checkpoints that are named, before frames are read."""
        check_range("seed", self.seed, 0, LARGEST_SEED)
        for path, kind in ((self.masks, "segmentation"), (self.keypoints, "hand-keypoints")):
            if path != TRUE:
                from hadr.training.checkpoints import load_kind

                load_kind(path, kind)

    def check_network(self, network: str) -> None:
        """Refuse predictions for a network that restores no depth: it would not get them."""
        predicted = self.masks != TRUE or self.keypoints != TRUE
        if predicted and network in ("segmentation", "hand-keypoints"):
            raise ValueError(
                f"--masks and --keypoints are for networks that restore depth, got {network}"
            )

    def record(self) -> dict[str, str]:
        """The same for a training's record: files by their names."""
        return {
            "corruption": self.corruption,
            "masks": Path(self.masks).name,
            "keypoints": Path(self.keypoints).name,
        }
