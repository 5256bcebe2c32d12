"""Recipes of the systems that the paper compares HADR with.

`paper` has each system's own size, loss and schedule as published (at the paper's 224x224). `mini`
is scaled to the time that HADR's own `mini` has, with the schedule and the rate that did best in
four short trials on validation frames (`benchmarks/tune.py`). `tiny` is scaled to a minute and was
not tuned.
"""

from __future__ import annotations

from hadr.models.backbone import BackboneConfig
from hadr.models.blocks.dilated_resnet import DilatedResNetConfig
from hadr.rivals.dfnet import DFNetConfig
from hadr.rivals.lidf import LIDFConfig
from hadr.rivals.swindrnet import SwinDRNetConfig
from hadr.rivals.tode import TODEConfig
from hadr.training.losses import LIDF_WEIGHTS
from hadr.training.recipe import Preset

LIDF_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="lidf",
    model=LIDFConfig(),
    weights=LIDF_WEIGHTS,
    epochs=90,
    drop_epoch=90,
    batch_size=32,
)
"""60 epochs of the first stage and 30 of the refinement, at one rate."""

LIDF_MINI = Preset(
    name="mini",
    width=128,
    height=72,
    network="lidf",
    model=LIDFConfig(backbone=DilatedResNetConfig(widths=(24, 48, 96, 192)), max_points=2500),
    weights=LIDF_WEIGHTS,
    epochs=12,
    drop_epoch=12,
    clip_norm=100.0,
    batch_size=8,
    true_voxel_epochs=2,
    ray_stride=2,
    mirror=0.5,
    validation_frames=240,
)
"""A dilated ResNet-34 of about a third of the width; 8 epochs and 4."""

LIDF_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="lidf",
    model=LIDFConfig(
        backbone=DilatedResNetConfig(widths=(16, 32, 64, 128), depths=(1, 1, 1, 1)),
        max_points=1500,
    ),
    weights=LIDF_WEIGHTS,
    epochs=8,
    drop_epoch=8,
    batch_size=8,
    true_voxel_epochs=2,
    augment=False,
)
"""5 epochs and 3, enough to see both stages at work."""

DFNET_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="dfnet",
    model=DFNetConfig(),
    epochs=40,
    milestones=(5 / 40, 15 / 40, 25 / 40, 35 / 40),
    decay=0.2,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=32,
)
"""Four drops of the rate to a fifth."""

DFNET_MINI = Preset(
    name="mini",
    width=128,
    height=72,
    network="dfnet",
    model=DFNetConfig(width=32, layers=4, growth=8),
    epochs=12,
    schedule="cosine",
    learning_rate=3e-3,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=16,
    mirror=0.5,
    precision="bf16-mixed",
    validation_frames=240,
)
"""Half of the width."""

DFNET_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="dfnet",
    model=DFNetConfig(width=16, layers=3, growth=8),
    epochs=8,
    schedule="cosine",
    learning_rate=2e-3,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=8,
    augment=False,
)
"""A smaller one on few frames, enough to see every part at work."""

SWINDRNET_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="swindrnet",
    model=SwinDRNetConfig(),
    epochs=20,
    schedule="cosine",
    learning_rate=1e-4,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=8,
)
"""The published rate falls linearly after a warm-up; half a cosine is the nearest here."""

SWINDRNET_MINI = Preset(
    name="mini",
    width=128,
    height=72,
    network="swindrnet",
    model=SwinDRNetConfig(
        BackboneConfig(
            embed_dim=24,
            depths=(1, 1, 2, 1),
            heads=(1, 2, 4, 8),
            drop_path=0.1,
            normalize_color=False,
        ),
        channels=32,
    ),
    epochs=12,
    schedule="cosine",
    learning_rate=1e-3,
    warmup_epochs=0.5,
    clip_norm=5.0,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=16,
    mirror=0.5,
    precision="bf16-mixed",
    validation_frames=240,
)
"""Two small Swin Transformers from scratch, hence the larger rate."""

SWINDRNET_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="swindrnet",
    model=SwinDRNetConfig(
        BackboneConfig(
            embed_dim=16, depths=(1, 1), heads=(1, 2), drop_path=0.0, normalize_color=False
        ),
        channels=16,
        dropout=0.0,
    ),
    epochs=8,
    schedule="cosine",
    learning_rate=2e-3,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=8,
    augment=False,
)
"""Two stages, enough to see every part at work."""

TODE_PAPER = Preset(
    name="paper",
    width=224,
    height=224,
    network="tode",
    model=TODEConfig(),
    epochs=40,
    milestones=(20 / 40, 30 / 40, 35 / 40),
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=16,
)
"""The rate falls as described; the published script builds that schedule and never steps it."""

TODE_MINI = Preset(
    name="mini",
    width=128,
    height=72,
    network="tode",
    model=TODEConfig(patch=4, embed_dim=32, depths=(2, 2, 2), heads=(1, 2, 4), width=48),
    epochs=12,
    schedule="cosine",
    warmup_epochs=0.5,
    clip_norm=5.0,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=16,
    mirror=0.5,
    validation_frames=240,
)
"""Patches of 4 instead of 2 pixels, which a small picture's time asks for."""

TODE_TINY = Preset(
    name="tiny",
    width=128,
    height=72,
    network="tode",
    model=TODEConfig(patch=4, embed_dim=32, depths=(2, 2), heads=(1, 2), drop_path=0.0, width=32),
    epochs=8,
    schedule="cosine",
    learning_rate=2e-3,
    optimizer="adamw",
    weight_decay=0.01,
    batch_size=8,
    augment=False,
)
"""Two stages, enough to see every part at work."""

RIVAL_RECIPES: tuple[Preset, ...] = (
    LIDF_TINY,
    LIDF_MINI,
    LIDF_PAPER,
    DFNET_TINY,
    DFNET_MINI,
    DFNET_PAPER,
    SWINDRNET_TINY,
    SWINDRNET_MINI,
    SWINDRNET_PAPER,
    TODE_TINY,
    TODE_MINI,
    TODE_PAPER,
)
"""All of them."""
