from __future__ import annotations

import pytest
import torch

from hadr.rivals.unet_hand import UNetHandConfig
from hadr.training.presets import Preset, preset
from hadr.training.tasks.unet_hand_task import UNetHandTask

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    network="unet-hand",
    model=UNetHandConfig(width=16, levels=3),
)


def test_a_displaced_flat_glass_costs_its_distance_and_no_steps(frames) -> None:
    task = UNetHandTask(MICRO)
    model = task.build().eval()
    torch.nn.init.zeros_(model.head.weight)
    torch.nn.init.zeros_(model.head.bias)
    few = frames.take([0, 1])
    losses = task.losses(model, few, 0, torch.Generator())
    hand = few.inputs.keypoints[:, :, 2].median(dim=1).values
    near = torch.linspace(0.45, 0.7, 6)[:2]  # the flat glass's depth
    assert losses["depth"].item() == pytest.approx((hand - near).abs().mean().item(), abs=1e-6)
    assert losses["step"].item() == pytest.approx(0, abs=1e-7)
    assert losses["loss"].item() == pytest.approx(20 * losses["depth"].item(), rel=1e-5)


def test_recipes(frames) -> None:
    for name in ("tiny", "mini"):
        recipe = preset(name, "unet-hand")
        assert recipe.size == (128, 72)
        assert UNetHandTask(recipe).build().config == recipe.model
    with pytest.raises(ValueError, match="recipe 'paper' of 'hadr' is none of unet-hand"):
        UNetHandTask(preset("paper"))
