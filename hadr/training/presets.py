"""Named training recipes: the paper's, one for a laptop's half hour, one for a chapter's minute."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from hadr.models.backbone import BackboneConfig
from hadr.models.hadr import HADRConfig
from hadr.training.losses import PRINTED, LossWeights


@dataclass(frozen=True)
class Preset:
    """A training recipe.

    Args:
        name: Its name.
        width: Width of the network's input, pixels; frames are squashed to width x height.
        height: Height of the network's input, pixels.
        model: The network.
        weights: Weights of the loss's terms.
        epochs: Passes over the training frames.
        drop_epoch: After this many epochs the learning rate falls to a tenth.
        learning_rate: Adam's learning rate before that.
        batch_size: Frames in a step.
        true_voxel_epochs: In the first so many epochs a ray takes its true voxel, not the most
            probable one (ledger, row 10).
        ray_stride: In training only every n-th masked pixel in row and column is restored, at a
            random start; 1 takes all.
        augment: Augment the colour of training frames (`hadr.data.augmentation`).

    Raises:
        ValueError: A count is not positive.
    """

    name: str
    width: int
    height: int
    model: HADRConfig = field(default_factory=HADRConfig)
    weights: LossWeights = PRINTED
    epochs: int = 100
    drop_epoch: int = 80
    learning_rate: float = 1e-3
    batch_size: int = 40
    true_voxel_epochs: int = 6
    ray_stride: int = 1
    augment: bool = True

    def __post_init__(self) -> None:
        for name in ("width", "height", "epochs", "batch_size", "ray_stride"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the network's input, pixels."""
        return self.width, self.height

    def rate(self, epoch: int) -> float:
        """Give the learning rate of an epoch; the first is 0."""
        return self.learning_rate * (0.1 if epoch >= self.drop_epoch else 1.0)

    def to_dict(self) -> dict[str, Any]:
        """The recipe as built-in types, for JSON."""
        return asdict(self)


PAPER = Preset(name="paper", width=224, height=224)
"""The paper's figures: Swin-T, 224x224, 8^3 voxels, 100 epochs, 1e-3 and from epoch 80 1e-4."""

MINI = Preset(
    name="mini",
    width=128,
    height=72,
    model=HADRConfig(
        backbone=BackboneConfig(
            embed_dim=32, depths=(2, 2, 2, 2), heads=(1, 2, 4, 8), drop_path=0.1
        ),
        max_points=2500,
    ),
    epochs=40,
    drop_epoch=30,
    batch_size=8,
)
"""A small Swin Transformer at 128x72: about half an hour for 800 frames on two CPU cores."""

TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    model=HADRConfig(
        backbone=BackboneConfig(embed_dim=32, depths=(2, 2), heads=(1, 2), drop_path=0.0),
        max_points=1500,
    ),
    epochs=8,
    drop_epoch=6,
    batch_size=8,
    true_voxel_epochs=2,
    augment=False,
)
"""Two stages, few frames: a minute on two CPU cores, enough to see every part at work."""


def preset(name: str) -> Preset:
    """Give the recipe of a name.

    Args:
        name: "tiny", "mini" or "paper".

    Returns:
        The recipe.

    Raises:
        ValueError: There is no such recipe.
    """
    known = {recipe.name: recipe for recipe in (TINY, MINI, PAPER)}
    if name not in known:
        raise ValueError(f"preset must be one of {', '.join(known)}, got {name!r}")
    return known[name]
