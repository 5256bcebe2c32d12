from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch.nn import functional

from hadr.models.backbone import BackboneConfig, ColorBackbone, FeatureAggregation, build_swin

MICRO = BackboneConfig(embed_dim=8, depths=(1, 1), heads=(1, 2), window=4, drop_path=0.0)


def test_swin_t_has_the_strides_and_channels_of_the_published_network() -> None:
    swin = build_swin(BackboneConfig()).eval()
    with torch.no_grad():
        stages = swin(torch.rand(1, 3, 64, 96)).feature_maps
    shapes = [tuple(stage.shape) for stage in stages]
    assert shapes == [(1, 96, 16, 24), (1, 192, 8, 12), (1, 384, 4, 6), (1, 768, 2, 3)]
    assert BackboneConfig().channels == (96, 192, 384, 768)
    # Swin-T's 27.5 M weights, and a LayerNorm (weight and bias) on each of the four stages.
    weights = sum(p.numel() for p in swin.parameters())
    assert weights == 27_519_354 + 2 * (96 + 192 + 384 + 768)


def test_aggregation_equals_the_papers_order_resize_convolve_concatenate_reduce() -> None:
    torch.manual_seed(0)
    aggregation = FeatureAggregation((8, 16, 32), channels=5)
    stages = [torch.randn(2, 8, 10, 14), torch.randn(2, 16, 5, 7), torch.randn(2, 32, 3, 4)]
    resized = [  # the last stage has half a cell more than the picture, on the right and below
        functional.interpolate(stage, size=size, mode="bilinear", align_corners=False)
        for stage, size in zip(stages, ((10, 14), (10, 14), (12, 16)), strict=True)
    ]
    aligned = [conv(x[:, :, :10, :14]) for conv, x in zip(aggregation.align, resized, strict=True)]
    expected = aggregation.reduce(torch.cat(aligned, dim=1))
    torch.testing.assert_close(aggregation(stages), expected)


def test_without_aggregation_only_the_finest_stage_counts() -> None:
    torch.manual_seed(0)
    aggregation = FeatureAggregation((8, 16), channels=5, multi_scale=False)
    fine = torch.randn(1, 8, 4, 4)
    first = aggregation([fine, torch.randn(1, 16, 2, 2)])
    second = aggregation([fine, torch.randn(1, 16, 2, 2)])
    assert torch.equal(first, second)
    other = aggregation([fine + 1, torch.randn(1, 16, 2, 2)])
    assert not torch.allclose(first, other)


@pytest.mark.parametrize("stage", range(4))
@pytest.mark.parametrize(("height", "width"), [(72, 128), (144, 48), (45, 50)])
def test_a_bright_spot_stays_in_its_place_through_every_stage(height, width, stage):
    torch.manual_seed(0)
    # With windows of one token a cell sees its own pixels alone: the spot is in one cell a stage.
    local = BackboneConfig(embed_dim=8, depths=(1,) * 4, heads=(1,) * 4, window=1, drop_path=0.0)
    backbone = ColorBackbone(local, channels=4).double().eval()
    side = 4 * 2**stage
    with torch.no_grad():
        for number, align in enumerate(backbone.aggregation.align):
            if number != stage:
                align.weight.zero_()
        picture = torch.rand(1, 3, height, width, dtype=torch.float64)
        plain = backbone(picture)
        for spot in ((5, 9), (height // 2, width // 2), (height - 3, width - 2)):
            bright = picture.clone()
            bright[:, :, spot[0], spot[1]] += 1
            answer = (backbone(bright) - plain).abs().sum(dim=(0, 1))  # (height, width)
            down, across = (
                _tent(pixel, side, end) for pixel, end in zip(spot, (height, width), strict=True)
            )
            expected = torch.outer(down, across)
            torch.testing.assert_close(
                answer / answer.sum(), expected / expected.sum(), rtol=0, atol=1e-9
            )


def _tent(pixel: int, side: int, end: int) -> torch.Tensor:
    """One in the middle of the pixel's cell, linear to zero in the middles beside it."""
    cells = (
        torch.arange(-(-end // 4)) + 0.5
    ) * 4 - 0.5  # where the finest cells have their middles
    middles = (torch.arange(-(-end // side)) + 0.5) * side - 0.5
    values = (torch.arange(len(middles)) == pixel // side).double()
    return torch.from_numpy(np.interp(range(end), cells, np.interp(cells, middles, values)))


@pytest.mark.parametrize(("normalize", "red", "green"), [(True, 0.0, 1.0), (False, 0.485, 0.68)])
def test_color_is_normalised_with_imagenet_numbers(normalize, red, green):
    config = replace(MICRO, normalize_color=normalize)
    backbone = ColorBackbone(config)
    seen = []

    def swin(color: torch.Tensor) -> SimpleNamespace:
        seen.append(color)
        return SimpleNamespace(feature_maps=[torch.zeros(1, 8, 2, 2), torch.zeros(1, 16, 1, 1)])

    backbone.swin.forward = swin  # type: ignore[method-assign]
    color = torch.zeros(1, 3, 8, 8)
    color[:, 0] = 0.485
    color[:, 1] = 0.456 + 0.224
    backbone(color)
    assert seen[0][0, 0, 3, 3].item() == pytest.approx(red, abs=1e-6)
    assert seen[0][0, 1, 3, 3].item() == pytest.approx(green, abs=1e-6)


def test_unreachable_weights_are_one_sentence_that_says_what_to_do(monkeypatch, caplog):
    from transformers import SwinBackbone

    def offline(*_: object, **__: object) -> None:
        logging.getLogger("huggingface_hub.utils._http").warning("Retrying in 1s [Retry 1/5].")
        raise OSError("no network")

    monkeypatch.setattr(SwinBackbone, "from_pretrained", offline)
    config = BackboneConfig(pretrained="microsoft/swin-tiny-patch4-window7-224")
    with pytest.raises(OSError, match=r"swin-tiny-patch4-window7-224.*could not be fetched"):
        build_swin(config)
    assert caplog.text == ""


def test_a_folder_is_no_name_of_published_weights(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a name of the public hub"):
        build_swin(BackboneConfig(pretrained=str(tmp_path)))


def test_weights_of_another_size_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from transformers import SwinBackbone

    small = build_swin(MICRO)
    monkeypatch.setattr(SwinBackbone, "from_pretrained", lambda *_, **__: small)
    with pytest.raises(ValueError, match=r"\(8, \(1, 1\), 4, 4\), but \(96"):
        build_swin(BackboneConfig(pretrained="some/other-network"))


def test_configuration_errors_name_the_values() -> None:
    with pytest.raises(ValueError, match="patch must be at least 1, got 0"):
        BackboneConfig(patch=0)
    with pytest.raises(ValueError, match=r"3 heads do not divide a stage of 32 channels"):
        BackboneConfig(embed_dim=32)
    with pytest.raises(ValueError, match=r"one number a stage, got \(2, 2\) and \(3,\)"):
        BackboneConfig(depths=(2, 2), heads=(3,))
