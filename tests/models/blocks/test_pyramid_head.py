from __future__ import annotations

import torch
from torch import Tensor, nn

from hadr.models.blocks.pyramid_head import ChannelDropout, PyramidHead


def stages(frames: int = 2) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    shapes = ((4, 18, 32), (8, 9, 16), (16, 5, 8))
    return [torch.rand(frames, *shape, generator=generator) for shape in shapes]


def head(pools: tuple[int, ...] = (1, 2, 3, 6), dropout: float = 0.0) -> PyramidHead:
    torch.manual_seed(0)
    return PyramidHead((4, 8, 16), 6, 2, pools, dropout)


def test_it_draws_at_the_finest_stages_size_from_all_stages_with_all_weights() -> None:
    network, given = head(), [stage.requires_grad_() for stage in stages()]
    drawn = network(given)
    assert drawn.shape == (2, 2, 18, 32)
    (drawn * torch.randn_like(drawn)).sum().backward()
    for number, stage in enumerate(given):
        assert stage.grad is not None
        assert stage.grad.abs().max() > 0, number
    for name, weight in network.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().max() > 0, name


def test_stages_of_odd_sizes_stay_in_their_places() -> None:
    network = PyramidHead((1, 1, 1), 1, 1, (), 0.0).eval()
    network.pyramid = network.merge = nn.Identity()  # type: ignore[assignment]
    for layers in (network.lateral, network.smooth):
        layers[0] = layers[1] = nn.Identity()
    network.last = nn.Conv2d(3, 1, 1, bias=False)
    nn.init.ones_(network.last.weight)
    # Each stage tells the place of its cells in pixels: 18, 9 and 5 rows, 32, 16 and 8 columns.
    rows = [2.0**n * (torch.arange(-(-18 // 2**n)) + 0.5) - 0.5 for n in range(3)]
    columns = [2.0**n * (torch.arange(-(-32 // 2**n)) + 0.5) - 0.5 for n in range(3)]
    given = [(r[:, None] + 100 * c)[None, None] for r, c in zip(rows, columns, strict=True)]
    drawn = network(given)[0, 0]
    # The finest is heard once, the next twice, the coarsest three times; off the border, where
    # nothing lies beyond to interpolate with, all of them tell the same place.
    place = torch.arange(18.0)[:, None] + 100 * torch.arange(32.0)
    torch.testing.assert_close(drawn[4:17, 4:28], 6 * place[4:17, 4:28])


def test_the_pyramid_takes_the_whole_picture_in() -> None:
    generator = torch.Generator().manual_seed(1)
    shapes = ((4, 80, 80), (8, 40, 40), (16, 20, 20))
    given = [torch.rand(2, *shape, generator=generator) for shape in shapes]
    other = [*given[:-1], given[-1].clone()]
    other[-1][:, :, 0, 0] += 5.0  # one corner
    for pools, heard in (((1,), True), ((20,), False)):
        network = head(pools).eval()
        far = (network(other) - network(given))[:, :, -1, -1].abs().max()
        assert (far > 0) == heard


def test_a_batch_of_one_frame_can_be_learned_from() -> None:
    network = head().train()
    before = network.pooled[0][1].running_mean.clone()
    assert network(stages(1)).isfinite().all()
    assert torch.equal(network.pooled[0][1].running_mean, before)
    network(stages(2))
    assert not torch.equal(network.pooled[0][1].running_mean, before)


def test_the_last_layer_is_not_rounded_to_16_bits() -> None:
    network = head().eval()
    torch.nn.init.constant_(network.last.bias, 0.7013)
    torch.nn.init.zeros_(network.last.weight)
    with torch.autocast("cpu", torch.bfloat16):
        drawn = network(stages())
    assert drawn.dtype == torch.float32
    torch.testing.assert_close(drawn, torch.full_like(drawn, 0.7013))


def test_dropout_leaves_channels_out() -> None:
    layer, values = ChannelDropout(0.25).train(), torch.ones(8, 100, 2, 3)
    torch.manual_seed(3)
    whole = layer(values)
    per_channel = whole.flatten(2)
    assert torch.equal(per_channel.amin(dim=2), per_channel.amax(dim=2))
    assert sorted(whole.unique().tolist()) == [0, torch.tensor(1 / 0.75).item()]
    assert 0.2 < (whole == 0).float().mean() < 0.3
    assert not torch.equal(whole[0], whole[1])
    assert layer.eval()(values) is values
