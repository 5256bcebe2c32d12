"""Named training recipes: the paper's, one for a laptop's half hour, one for a chapter's minute."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hadr.models.backbone import BackboneConfig
from hadr.models.blocks.resnet import UNetConfig
from hadr.models.hadr import HADRConfig
from hadr.models.hadr_plus import HADRPlusConfig
from hadr.models.hand.keypoints import HandKeypointConfig
from hadr.models.segmentation import SegmentationConfig
from hadr.rivals.unet_hand import UNetHandConfig
from hadr.training.losses import LossWeights
from hadr.training.recipe import Preset
from hadr.training.rival_presets import RIVAL_RECIPES

__all__ = ["MINI", "NETWORKS", "PAPER", "RECIPES", "TINY", "Preset", "preset", "recipe_from_dict"]

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
    epochs=12,
    schedule="cosine",
    drop_epoch=9,
    warmup_epochs=0.5,
    clip_norm=100.0,
    batch_size=8,
    true_voxel_epochs=2,
    ray_stride=2,
    mirror=0.5,
    validation_frames=240,
)
"""A small Swin Transformer at 128x72: about 20 minutes for 3,100 frames on one CPU core."""

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

PLUS_MINI = Preset(
    name="mini",
    width=256,
    height=144,
    network="hadr-plus",
    model=HADRPlusConfig(),
    epochs=20,
    schedule="cosine",
    learning_rate=2e-3,
    warmup_epochs=0.5,
    clip_norm=5.0,
    average_decay=0.995,
    batch_size=8,
    mirror=0.5,
    roll_deg=30.0,
    precision="bf16-mixed",
    validation_frames=240,
)
"""HADR-plus at the data's own 256x144, of which it looks at a crop."""

PLUS_TINY = Preset(
    name="tiny",
    width=256,
    height=144,
    network="hadr-plus",
    model=HADRPlusConfig(crop=64, pixel_m=0.0045, width=32, blocks=1),
    epochs=8,
    schedule="cosine",
    learning_rate=3e-3,
    clip_norm=5.0,
    batch_size=8,
    mirror=0.5,
    augment=False,
)
"""A smaller one on few frames, enough to see every part at work."""

KEYPOINTS_PAPER = Preset(
    name="paper",
    width=640,
    height=360,
    network="hand-keypoints",
    model=HandKeypointConfig(),
    batch_size=32,
    mirror=0.5,
    roll_deg=30.0,
)
"""ResNet-18 on crops of 128 pixels; the paper names no schedule of its own for it."""

KEYPOINTS_MINI = Preset(
    name="mini",
    width=256,
    height=144,
    network="hand-keypoints",
    model=HandKeypointConfig(
        unet=UNetConfig(widths=(32, 64, 128, 256), decoder=(128, 64, 32, 32)), crop=64
    ),
    epochs=12,
    schedule="cosine",
    learning_rate=2e-3,
    warmup_epochs=0.5,
    clip_norm=5.0,
    average_decay=0.995,
    batch_size=16,
    mirror=0.5,
    roll_deg=30.0,
    validation_frames=240,
)
"""A ResNet-18 of half the width on crops of 64 pixels, about as many as a 256x144 frame has."""

KEYPOINTS_TINY = Preset(
    name="tiny",
    width=256,
    height=144,
    network="hand-keypoints",
    model=HandKeypointConfig(
        unet=UNetConfig((1, 1, 1, 1), (16, 32, 64, 128), (64, 32, 32, 32)), crop=48
    ),
    epochs=8,
    schedule="cosine",
    learning_rate=3e-3,
    clip_norm=5.0,
    batch_size=8,
    mirror=0.5,
)
"""A smaller one on few frames, enough to see every part at work."""

SEGMENTATION_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="segmentation",
    model=SegmentationConfig(),
    mirror=0.5,
)
"""The whole ResNet-34 at the restoration's size; the paper names no schedule of its own for it."""

SEGMENTATION_MINI = Preset(
    name="mini",
    width=256,
    height=144,
    network="segmentation",
    model=SegmentationConfig(
        UNetConfig(depths=(3, 4, 6, 3), widths=(16, 32, 64, 128), decoder=(64, 32, 16, 16))
    ),
    epochs=12,
    schedule="cosine",
    learning_rate=2e-3,
    warmup_epochs=0.5,
    clip_norm=5.0,
    average_decay=0.995,
    batch_size=16,
    mirror=0.5,
    precision="bf16-mixed",
    validation_frames=240,
)
"""A ResNet-34 of a quarter of the width."""

SEGMENTATION_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="segmentation",
    model=SegmentationConfig(
        UNetConfig((1, 1, 1, 1), widths=(16, 32, 64, 128), decoder=(64, 32, 16, 16))
    ),
    epochs=8,
    schedule="cosine",
    learning_rate=3e-3,
    clip_norm=5.0,
    batch_size=8,
    mirror=0.5,
)
"""A smaller one on few frames, enough to see every part at work."""

UNET_MINI = Preset(
    name="mini",
    width=128,
    height=72,
    network="unet-hand",
    model=UNetHandConfig(),
    epochs=12,
    schedule="cosine",
    learning_rate=1e-3,
    batch_size=16,
    mirror=0.5,
    precision="bf16-mixed",
    validation_frames=240,
)
"""The plain U-Net with the hand, as large as in the trial, at the size of HADR's own recipe."""

PLUS_PAPER = Preset(
    name="paper",
    width=640,
    height=360,
    network="hadr-plus",
    model=HADRPlusConfig(crop=128, pixel_m=0.0018),
    schedule="cosine",
    learning_rate=2e-3,
    warmup_epochs=1.0,
    clip_norm=5.0,
    average_decay=0.999,
    mirror=0.5,
    roll_deg=30.0,
)
"""For as many epochs as the paper's network; made to measure, never trained."""

UNET_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="unet-hand",
    model=UNetHandConfig(),
    schedule="cosine",
    mirror=0.5,
)
"""At the size and for as many epochs as the paper's network; never trained."""

UNET_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="unet-hand",
    model=UNetHandConfig(width=16),
    epochs=8,
    schedule="cosine",
    learning_rate=2e-3,
    batch_size=8,
    augment=False,
)
"""A smaller one on few frames, enough to see every part at work."""

RECIPES: tuple[Preset, ...] = (
    TINY,
    MINI,
    PAPER,
    PLUS_TINY,
    PLUS_MINI,
    PLUS_PAPER,
    UNET_TINY,
    UNET_MINI,
    UNET_PAPER,
    KEYPOINTS_TINY,
    KEYPOINTS_MINI,
    KEYPOINTS_PAPER,
    SEGMENTATION_TINY,
    SEGMENTATION_MINI,
    SEGMENTATION_PAPER,
    *RIVAL_RECIPES,
)
"""All recipes of all networks."""
RIVALS = ("lidf", "dfnet", "swindrnet", "tode")
"""The systems that the paper compares with."""
NETWORKS = ("hadr", "hadr-plus", "unet-hand", *RIVALS, "hand-keypoints", "segmentation")
"""The kinds of network."""


def preset(name: str, network: str = "hadr") -> Preset:
    """Give the recipe of a name.

    Args:
        name: "tiny", "mini" or "paper".
        network: One of `NETWORKS`.

    Returns:
        The recipe.

    Raises:
        ValueError: There is no such recipe, or no such network.
    """
    if network not in NETWORKS:
        raise ValueError(f"network must be one of {', '.join(NETWORKS)}, got {network!r}")
    known = {recipe.name: recipe for recipe in RECIPES if recipe.network == network}
    if name not in known:
        raise ValueError(f"preset must be one of {', '.join(known)}, got {name!r}")
    return known[name]


def recipe_from_dict(values: Mapping[str, Any]) -> Preset:
    """Build the recipe that a record describes.

    Args:
        values: What `Preset.to_dict` gave, also after a way through JSON.

    Returns:
        The recipe.

    Raises:
        ValueError: It is of an unknown network, or a number is out of range.
        TypeError: A field is unknown.
    """
    network = values.get("network")
    if network not in NETWORKS:
        raise ValueError(f"network must be one of {', '.join(NETWORKS)}, got {network!r}")
    model: Any = type(preset("mini", network).model)
    own = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    parts = {
        "model": model.from_dict(values["model"]),
        "weights": LossWeights(**values["weights"]),
    }
    return Preset(**{**own, **parts})
