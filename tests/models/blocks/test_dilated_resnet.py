from __future__ import annotations

import pytest
import torch

from hadr.models.blocks.dilated_resnet import DilatedResNet, DilatedResNetConfig

SMALL = DilatedResNetConfig(depths=(1, 1, 2, 1), widths=(4, 8, 8, 16))


def test_the_default_is_resnet_34_and_a_convolution_to_32_channels() -> None:
    count = sum(p.numel() for p in DilatedResNet(DilatedResNetConfig()).parameters())
    assert count == 21_797_672 - 513_000 + 512 * 32 + 32


@pytest.mark.parametrize("size", [(72, 128), (126, 224), (33, 50)])
def test_the_stride_stays_8(size: tuple[int, int]) -> None:
    model = DilatedResNet(SMALL, channels=5).eval()
    coarse = []
    model.reduce.register_forward_hook(lambda *seen: coarse.append(seen[2].shape))
    dense = model(torch.rand(2, 3, *size))
    assert coarse == [(2, 5, -(-size[0] // 8), -(-size[1] // 8))]
    assert dense.shape == (2, 5, *size)


def test_kernels_reach_twice_and_four_times_as_far_where_the_stride_is_gone() -> None:
    model = DilatedResNet(SMALL)
    stages = model.resnet.encoder.stages  # type: ignore[union-attr]
    for stage, stride, dilation in zip(stages, (1, 2, 1, 1), (1, 1, 2, 4), strict=True):  # type: ignore[arg-type]
        layers = [m for m in stage.modules() if isinstance(m, torch.nn.Conv2d)]
        wide = [layer for layer in layers if layer.kernel_size == (3, 3)]
        assert layers[0].stride == (stride, stride) or stride == 1
        assert max(layer.stride[0] for layer in layers) == stride
        assert {layer.dilation for layer in wide} == {(dilation, dilation)}
        assert {layer.padding for layer in wide} == {(dilation, dilation)}
