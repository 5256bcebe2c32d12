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
from hadr.models.blocks.efficientnet_lite import CHANNELS, LiteConfig
from hadr.models.blocks.resnet import ResNetUNet, UNetConfig
from hadr.models.config import NetworkConfig
from hadr.models.hand.crop import HandCrop
from hadr.models.window import WindowConfig, whole_windows, windows_around
from hadr.records.provenance import IF_CHANGED

RESNET_34 = UNetConfig(depths=(3, 4, 6, 3), decoder=(256, 128, 64, 32))


@dataclass(frozen=True)
class SegmentationConfig(NetworkConfig):
    """The segmentation network; the defaults are the paper's ResNet-34.

    Args:
        unet: Size of the U-Net, and the name of its encoder's published weights if any.
        classes: Names of the classes, the object's first.
        lite: An EfficientNet-Lite0 of four stages in the ResNet's place.
        view: Look twice, at the whole picture and then at a window around the object that was found
            there; None looks once.

    Raises:
        ValueError: The first class is not the object, or the EfficientNet-Lite0 lacks stages.
    """

    unet: UNetConfig = field(default_factory=lambda: RESNET_34)
    classes: tuple[str, ...] = ("object", "hand")
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.classes[:1] != ("object",):
            raise ValueError(f"the first class must be 'object', got {self.classes}")
        if self.lite and self.lite.stages < len(CHANNELS):
            raise ValueError(f"lite must have {len(CHANNELS)} stages, got {self.lite.stages}")


class SegmentationNet(nn.Module):
    """From colour to a logit a class and pixel.

    The U-Net ends at half of the resolution; a last convolution gives four logits there, those of
    the 2 x 2 pixels that the feature stands for.
    """

    def __init__(self, config: SegmentationConfig) -> None:
        super().__init__()
        self.config = config
        self.unet = ResNetUNet(config.unet, 3, config.lite)
        self.head = nn.Conv2d(config.unet.decoder[-1], 4 * len(config.classes), 3, padding=1)

    def forward(self, color: Tensor) -> Tensor:
        """Compute the logits (B, classes, H, W) of sRGB in 0..1, (B, 3, H, W), any size.

        A positive logit says that the pixel belongs to the class.
        """
        height, width = color.shape[2:]
        seen = color if self.config.lite else imagenet_normal(color)
        features = self.unet(seen)  # (B, C, ceil(H / 2), ceil(W / 2)) or more
        logits = functional.pixel_shuffle(self.head(features), 2)  # (B, classes, H', W')
        return logits[:, :, :height, :width]


def predict_logits(model: SegmentationNet, color: Tensor) -> Tensor:
    """Give the logits (B, classes, H, W), the object's first, of sRGB in 0..1, (B, 3, H, W)."""
    view = model.config.view
    with torch.no_grad():
        if view is None:
            logits: Tensor = model(color)
            return logits
        logits, _ = _seen_by(model, whole_windows(color, view.size), color)
        found = logits[:, 0] > 0  # (B, H, W)
        again, within = _seen_by(model, _around(found, view), color)
        within = within & found.any(dim=(1, 2), keepdim=True)
        return torch.where(within[:, None], again, logits)


def _seen_by(model: SegmentationNet, crop: HandCrop, color: Tensor) -> tuple[Tensor, Tensor]:
    """Logits of pictures that are seen through windows, and which pixels these show, (B, H, W)."""
    return crop.spread(model(crop.sample(color, "bilinear")), color.shape[2:])


def _around(found: Tensor, view: WindowConfig) -> HandCrop:
    """Lay windows around what was found, (B, H, W) bool, less its outermost fiftieths."""
    height, width = found.shape[1:]
    boxes = []
    for mask in found:
        at = mask.nonzero().flip(1).float()  # (pixels, 2): column, row
        if not len(at):
            at = at.new_tensor([[0, 0], [width - 1, height - 1]])
        boxes.append(torch.quantile(at, at.new_tensor([0.02, 0.98]), dim=0))
    return windows_around(torch.stack(boxes), view)
