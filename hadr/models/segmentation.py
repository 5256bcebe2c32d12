"""The segmentation network: which pixels are the transparent object, and which are the hand.

The restoration needs the object's mask, and the keypoint network needs to know where the hand is.
The paper trains a U-Net with a ResNet-34 encoder for the first; the hand is a second class of the
same network here. A pixel has a logit for each class on its own: a pixel may be neither.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.backbone import imagenet_normal
from hadr.models.blocks.resnet import ResNetUNet, UNetConfig
from hadr.models.config import NetworkConfig

RESNET_34 = UNetConfig(depths=(3, 4, 6, 3), decoder=(256, 128, 64, 32))


@dataclass(frozen=True)
class SegmentationConfig(NetworkConfig):
    """The segmentation network; the defaults are the paper's ResNet-34.

    Args:
        unet: Size of the U-Net, and the name of its encoder's published weights if any.
        classes: Names of the classes, the object's first.

    Raises:
        ValueError: The first class is not the object.
    """

    unet: UNetConfig = field(default_factory=lambda: RESNET_34)
    classes: tuple[str, ...] = ("object", "hand")

    def __post_init__(self) -> None:
        if self.classes[:1] != ("object",):
            raise ValueError(f"the first class must be 'object', got {self.classes}")


class SegmentationNet(nn.Module):
    """From colour to a logit a class and pixel.

    The U-Net ends at half of the resolution; a last convolution gives four logits there, those of
    the 2 x 2 pixels that the feature stands for.
    """

    def __init__(self, config: SegmentationConfig) -> None:
        super().__init__()
        self.config = config
        self.unet = ResNetUNet(config.unet, 3)
        self.head = nn.Conv2d(config.unet.decoder[-1], 4 * len(config.classes), 3, padding=1)

    def forward(self, color: Tensor) -> Tensor:
        """Compute the logits (B, classes, H, W) of sRGB in 0..1, (B, 3, H, W), any size.

        A positive logit says that the pixel belongs to the class.
        """
        height, width = color.shape[2:]
        features = self.unet(imagenet_normal(color))  # (B, C, ceil(H / 2), ceil(W / 2))
        logits = functional.pixel_shuffle(self.head(features), 2)  # (B, classes, H', W')
        return logits[:, :, :height, :width]


def predict_logits(model: SegmentationNet, color: Tensor) -> Tensor:
    """Give the logits (B, classes, H, W) of each class, the object's first, then the hand's.

    Args:
        model: The network in evaluation mode.
        color: sRGB in 0..1, shape (B, 3, H, W).

    Raises:
        ValueError: The colour is of another shape, or not in 0..1 (NaN included).
    """
    if color.ndim != 4 or color.shape[1] != 3:
        raise ValueError(f"color must be (B, 3, H, W), got {tuple(color.shape)}")
    if not bool(((color >= 0) & (color <= 1)).all()):
        low, high = float(color.min()), float(color.max())
        raise ValueError(f"color must be in 0..1, got {low:.4g} to {high:.4g}")
    with torch.no_grad():
        logits: Tensor = model(color)
    return logits
