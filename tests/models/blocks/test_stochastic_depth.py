from __future__ import annotations

import pytest
import torch
from torch import nn

from hadr.models.backbone import BackboneConfig, build_swin
from hadr.models.blocks.stochastic_depth import StochasticDepth, set_share


def test_shares_of_a_batch_drop_what_the_whole_batch_drops() -> None:
    branch = torch.ones(64, 3, 2)
    layer = nn.Sequential(StochasticDepth(0.25))
    torch.manual_seed(0)
    whole = layer(branch)
    parts = []
    for first, last in ((0, 20), (20, 64)):
        torch.manual_seed(0)
        set_share(layer, first, 64)
        parts.append(layer(branch[first:last]))
    assert torch.equal(torch.cat(parts), whole)
    # A frame is kept or dropped as a whole, and what is kept is scaled up.
    values = whole.flatten(1)
    assert torch.equal(values, values[:, :1].expand_as(values))
    torch.testing.assert_close(values.unique(), torch.tensor([0.0, 1 / 0.75]))
    assert 4 < int((whole[:, 0, 0] == 0).sum()) < 28


def test_the_swin_transformer_has_it_in_each_block_at_rising_rates() -> None:
    swin = build_swin(BackboneConfig(embed_dim=8, depths=(1, 2), heads=(1, 2), drop_path=0.3))
    rates = {m.rate for m in swin.modules() if isinstance(m, StochasticDepth)}
    assert max(rates) == pytest.approx(0.3)
    assert len(rates) >= 2
    assert not any(type(module).__name__ == "SwinDropPath" for module in swin.modules())
