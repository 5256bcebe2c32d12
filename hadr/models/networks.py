"""The table of networks: where each one is, what it answers, and what readers call it.

A new network needs a row here, a file of its own, its loss, and recipes in
`hadr.training.presets`; commands, tables and pictures take it from here. Modules are named and
imported when they are asked for.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from torch import nn


@dataclass(frozen=True)
class Network:
    """A row of the table.

    Attributes:
        title: What readers call it.
        module: Dotted name of the module that has network and configuration.
        network: Name of its class.
        config: Name of its configuration's class.
        training: Dotted name of the module with its loss (`hadr.training.tasks.task.Task`).
        loss: Name of its loss there.
        answer: What it says of a frame.
        published: Its name in the paper's tables; "" where it is not in them.
        can_say: It predicts a distribution of depth, so that it can say how sure it is. HADR's and
            LIDF's probability is that of a voxel of 25 cm and says next to nothing about
            centimetres (chapter 7); the others have no opinion.
        skips_mask: It never looks at depth that was measured inside the mask.
        sees: Of one that restores depth, the part whose map is what it sees
            (`hadr.confidence.sight`).
        encoders: The parts that read pictures stage by stage, the one that sees colour first; a
            network need not have all of them.
    """

    title: str
    module: str
    network: str
    config: str
    training: str
    loss: str = "losses"
    answer: Literal["depth", "keypoints", "masks"] = "depth"
    published: str = ""
    can_say: bool = False
    skips_mask: bool = False
    sees: str = ""
    encoders: tuple[str, ...] = ()

    @property
    def slow(self) -> tuple[str, ...]:
        """Those encoders that `Preset.encoder_rate` is for: Swin Transformers and Lite0."""
        return tuple(name for name in self.encoders if name.endswith(("swin", "lite")))

    @property
    def modules(self) -> tuple[str, str]:
        """The modules with which its code begins."""
        return self.module, self.training

    def network_class(self) -> Any:
        """Import the class of the network."""
        return getattr(importlib.import_module(self.module), self.network)

    def encoders_of(self, network: nn.Module) -> dict[str, nn.Module]:
        """Give the encoders that a network of this kind has, by their dotted names."""
        return {name: part for name, part in network.named_modules() if name in self.encoders}

    def config_class(self) -> Any:
        """Import the class of its configuration."""
        return getattr(importlib.import_module(self.module), self.config)


NETWORKS: dict[str, Network] = {
    "hadr": Network(
        "HADR", "hadr.models.hadr", "HADR", "HADRConfig", "hadr.training.tasks.hadr",
        published="HADR", sees="backbone", encoders=("backbone.swin", "backbone.lite"),
    ),
    "lidf": Network(
        "LIDF", "hadr.rivals.lidf", "LIDF", "LIDFConfig", "hadr.training.tasks.lidf",
        published="LIDF+Refine", sees="first.backbone",
        encoders=("first.backbone.resnet", "first.backbone.lite"),
    ),
    "dfnet": Network(
        "DFNet", "hadr.rivals.dfnet", "DFNet", "DFNetConfig", "hadr.training.tasks.images",
        loss="dfnet", published="TransCG", sees="final",
    ),
    "swindrnet": Network(
        "SwinDRNet", "hadr.rivals.swindrnet", "SwinDRNet", "SwinDRNetConfig",
        "hadr.training.tasks.images", loss="swindrnet", published="SwinDRNet", sees="fusions.0",
        encoders=("color_swin", "lite", "depth_swin"),
    ),
    "tode": Network(
        "TODE-Trans", "hadr.rivals.tode", "TODETrans", "TODEConfig", "hadr.training.tasks.images",
        loss="tode", published="TODE-Trans", sees="decoder.0", encoders=("swin",),
    ),
    "unet-hand": Network(
        "U-Net with the hand", "hadr.rivals.unet_hand", "UNetHand", "UNetHandConfig",
        "hadr.training.tasks.images", loss="unet_hand", sees="up.0", skips_mask=True,
        encoders=("lite", "down"),
    ),
    "hadr-plus": Network(
        "HADR-plus", "hadr.models.hadr_plus", "HADRPlus", "HADRPlusConfig",
        "hadr.training.tasks.hadr_plus", can_say=True, sees="unet", skips_mask=True,
        encoders=("lite", "unet.left"),
    ),
    "hand-keypoints": Network(
        "hand keypoints", "hadr.models.hand.keypoints", "HandKeypointNet", "HandKeypointConfig",
        "hadr.training.tasks.hand_keypoints", answer="keypoints",
        encoders=("unet.resnet",),
    ),
    "segmentation": Network(
        "segmentation", "hadr.models.segmentation", "SegmentationNet", "SegmentationConfig",
        "hadr.training.tasks.segmentation", answer="masks",
        encoders=("unet.resnet", "unet.lite"),
    ),
}  # fmt: skip
"""The networks by their kind, as checkpoints and commands name it, in the tables' order."""
DEPTH_NETWORKS = tuple(kind for kind, network in NETWORKS.items() if network.answer == "depth")
"""Those that restore depth."""
RIVALS = tuple(kind for kind, network in NETWORKS.items() if network.published and kind != "hadr")
"""Those that the paper compares with."""


def network_of(kind: str) -> Network:
    """Give the row of a kind of network; ValueError where there is no such network."""
    if kind not in NETWORKS:
        raise ValueError(f"network must be one of {', '.join(NETWORKS)}, got {kind!r}")
    return NETWORKS[kind]
