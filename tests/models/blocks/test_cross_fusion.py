from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.blocks.cross_fusion import CrossFusion, WindowCrossAttention


def maps(height: int, width: int, channels: int = 8) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    shape = (2, height, width, channels)
    return torch.randn(shape, generator=generator), torch.randn(shape, generator=generator)


def plain(layers: WindowCrossAttention) -> WindowCrossAttention:
    """Let each token be told the other map's token itself."""
    channels = layers.answer.in_features
    one = torch.eye(channels)
    for layer in (layers.tell, layers.answer):
        nn.init.zeros_(layer.bias)
    layers.tell.weight.data = torch.cat((layers.tell.weight.data[:channels], one))
    layers.answer.weight.data = one
    return layers


def test_one_window_is_attention_of_several_heads_with_a_score_for_the_place() -> None:
    torch.manual_seed(0)
    layers = WindowCrossAttention(8, 2, 4)
    nn.init.normal_(layers.offset)
    asking, asked = maps(3, 4)
    query = layers.ask(asking).reshape(2, 12, 2, 4).transpose(1, 2)
    told = layers.tell(asked).reshape(2, 12, 2, 2, 4)
    key, value = told[:, :, 0].transpose(1, 2), told[:, :, 1].transpose(1, 2)
    place = torch.zeros(2, 12, 12)
    for q in range(12):
        for k in range(12):
            down, across = q // 4 - k // 4 + 3, q % 4 - k % 4 + 3
            place[:, q, k] = layers.offset[7 * down + across]
    expected = functional.scaled_dot_product_attention(query, key, value, place)
    expected = layers.answer(expected.transpose(1, 2).reshape(2, 3, 4, 8))
    torch.testing.assert_close(layers(asking, asked), expected)


def test_a_token_can_ask_the_one_above_it_in_its_window() -> None:
    layers = plain(WindowCrossAttention(8, 2, 4))
    nn.init.zeros_(layers.offset)
    nn.init.zeros_(layers.ask.weight)
    nn.init.zeros_(layers.ask.bias)
    layers.offset.data[(3 + 1) * 7 + 3] = 50.0  # one row down from the key, in the same column
    asking, asked = maps(8, 4)
    told = layers(asking, asked)
    torch.testing.assert_close(told[:, 1:4], asked[:, 0:3])
    torch.testing.assert_close(told[:, 5:8], asked[:, 4:7])
    windows_mean = asked[:, 4:8].mean(dim=(1, 2))  # nothing above in this window: all alike
    torch.testing.assert_close(told[:, 4, 2], windows_mean)


def test_windows_are_apart_and_padding_is_not_asked() -> None:
    torch.manual_seed(0)
    layers = plain(WindowCrossAttention(8, 2, 4))
    asking, asked = maps(5, 9)
    told = layers(asking, asked)
    assert told.shape == (2, 5, 9, 8)
    torch.testing.assert_close(told[:, 4, 8], asked[:, 4, 8])  # alone in its window
    other = asked.clone()
    other[:, 1, 5] += 1
    changed = (layers(asking, other) != told).any(dim=-1)[0]
    expected = torch.zeros(5, 9, dtype=torch.bool)
    expected[:4, 4:8] = True
    assert torch.equal(changed, expected)


def test_the_fused_map_keeps_its_frame_and_hears_both() -> None:
    torch.manual_seed(0)
    fuse = CrossFusion(8, 1, 4)
    color, depth = (values.permute(0, 3, 1, 2) for values in maps(6, 5))
    fused = fuse(color, depth)
    assert fused.shape == (2, 8, 6, 5)
    torch.testing.assert_close(fused[1:], fuse(color[1:], depth[1:]))
    for inputs in ((color + 1e-2 * torch.randn_like(color), depth), (color, depth.roll(1, 2))):
        assert (fuse(*inputs) - fused).abs().max() > 1e-4
    (fused * torch.randn_like(fused)).sum().backward()
    for name, weight in fuse.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().max() > 0, name


def test_colour_asks_depth_and_depth_asks_colour() -> None:
    torch.manual_seed(0)
    fuse = CrossFusion(8, 1, 4)
    heard: list[tuple[Tensor, ...]] = []
    for layers in fuse.attend:
        layers.register_forward_pre_hook(lambda _, given: heard.append(given))
    color, depth = maps(6, 5)
    nn.init.constant_(fuse.before[1].bias, 0.3)
    fuse(color.permute(0, 3, 1, 2), depth.permute(0, 3, 1, 2))
    color, depth = fuse.before[0](color), fuse.before[1](depth)
    for found, expected in zip(heard, ((color, depth), (depth, color)), strict=True):
        torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("channels", [8, 96])
def test_a_stage_has_26_c_squared_weights(channels: int) -> None:
    matrices = [w for w in CrossFusion(channels, 1, 7).parameters() if w.ndim == 2]
    assert sum(w.numel() for w in matrices) == 26 * channels**2 + 2 * 13**2
