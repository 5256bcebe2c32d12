"""The U-Net of both helpers, and the segmentation network on top."""

import pytest
import torch

from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.blocks.resnet import UNetConfig, build_resnet
from hadr.models.segmentation import (
    RESNET_34,
    SegmentationConfig,
    SegmentationNet,
    _seen_by,
    predict_logits,
)
from hadr.models.window import WindowConfig, whole_windows

SMALL = UNetConfig((1, 1, 1, 1), widths=(4, 4, 8, 8), decoder=(8, 8, 8, 8))


@pytest.mark.parametrize("size", [(64, 96), (45, 63), (33, 46)])
@pytest.mark.parametrize("lite", [None, LiteConfig(stages=4, pretrained=False)])
def test_a_change_of_the_picture_stays_at_its_place_in_any_size(size, lite) -> None:
    torch.manual_seed(0)
    model = SegmentationNet(SegmentationConfig(SMALL, lite=lite)).eval()
    picture = torch.zeros(1, 3, *size)
    other = picture.clone()
    other[0, :, 20:22, 40:42] = 1
    with torch.no_grad():
        change = (model(other) - model(picture)).abs().sum(dim=1)[0]
    assert change.shape == size
    row, column = divmod(int(change.argmax()), size[1])
    assert abs(row - 20) <= 5
    assert abs(column - 40) <= 5


class _Bright(SegmentationNet):
    """Takes bright pixels for the object, and notes what it is shown."""

    def __init__(self, config: SegmentationConfig) -> None:
        super().__init__(config)
        self.shown: list[torch.Tensor] = []

    def forward(self, color: torch.Tensor) -> torch.Tensor:
        self.shown.append(color)
        return color[:, :2] - 0.5


def test_it_looks_again_where_it_found_the_object() -> None:
    view = WindowConfig(size=64, margin=2, hand=False)
    model = _Bright(SegmentationConfig(SMALL, view=view)).eval()
    row, column = torch.arange(180)[:, None], torch.arange(320)
    disc = ((row - 60) ** 2 + (column - 200) ** 2 < 20**2).float()
    color = disc.expand(2, 3, 180, 320).clone()
    color[1] = 0.4 * torch.rand(3, 180, 320)  # nothing is found there
    found = predict_logits(model, color)
    assert found.shape == (2, 2, 180, 320)
    both = ((found[0, 0] > 0) & (disc > 0)).sum() / ((found[0, 0] > 0) | (disc > 0)).sum()
    assert float(both) > 0.95
    assert not bool((found[1] > 0).any())
    first, _ = _seen_by(model, whole_windows(color, 64), color)
    assert torch.equal(found[1], first[1])  # it has nothing to look at again
    whole, near = (shown[0, 0].mean() * shown[0, 0].numel() for shown in model.shown[:2])
    # The disc's 1257 pixels: a cell of the first look spans 5 x 5 of them, of the second some 1.2.
    assert float(whole) == pytest.approx(1257 / 25, rel=0.2)
    assert float(near) == pytest.approx(1257 / 1.2**2, rel=0.2)


def test_the_paper_s_encoders_are_resnet_18_and_34() -> None:
    """Parameters of the published networks without their last layer of 513 thousand."""
    counts = [
        sum(p.numel() for p in build_resnet(config, 3).parameters())
        for config in (UNetConfig(), RESNET_34)
    ]
    assert counts == [11_689_512 - 513_000, 21_797_672 - 513_000]


def test_pixels_of_a_feature_are_its_2_x_2() -> None:
    model = SegmentationNet(SegmentationConfig(SMALL, ("object",))).eval()
    with torch.no_grad():
        model.head.weight.zero_()
        model.head.bias.copy_(torch.tensor([1.0, 2.0, 3.0, 4.0]))
        logits = model(torch.rand(1, 3, 32, 32))
    assert logits[0, 0, :4, :4].tolist() == [[1, 2, 1, 2], [3, 4, 3, 4]] * 2


def test_without_a_window_the_logits_are_the_network_s() -> None:
    model = SegmentationNet(SegmentationConfig(SMALL)).eval()
    color = torch.rand(1, 3, 32, 64)
    with torch.no_grad():
        assert torch.equal(predict_logits(model, color), model(color))


def test_wrong_configurations_are_named() -> None:
    with pytest.raises(ValueError, match="first class must be 'object', got"):
        SegmentationConfig(SMALL, ("hand", "object"))
    with pytest.raises(ValueError, match=r"widths needs 4 positive numbers, got \(8, 8\)"):
        UNetConfig(widths=(8, 8))


def test_published_weights_for_another_number_of_channels(monkeypatch: pytest.MonkeyPatch) -> None:
    """A grey picture given once is then as good as given in three colours."""
    from transformers import ResNetBackbone, ResNetConfig

    torch.manual_seed(0)
    published = ResNetBackbone(
        ResNetConfig(
            embedding_size=4, hidden_sizes=[4, 4, 8, 8], depths=[1] * 4, layer_type="basic"
        )
    ).eval()
    monkeypatch.setattr(ResNetBackbone, "from_pretrained", lambda name, **_: published)
    grey = torch.rand(1, 1, 32, 32)
    wanted = published.embedder(grey.expand(-1, 3, -1, -1))
    named = UNetConfig((1, 1, 1, 1), SMALL.widths, SMALL.decoder, pretrained="some/resnet")
    torch.testing.assert_close(build_resnet(named, 1).eval().embedder(grey), wanted)
    wide = UNetConfig((1, 1, 1, 1), (8, 8, 8, 8), SMALL.decoder, pretrained="some/resnet")
    with pytest.raises(ValueError, match="'some/resnet' has depths and widths"):
        build_resnet(wide, 3)
