"""Effective rank, gradients by part, and the cost of another frame's colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from hadr.models.network_input import DepthOutput, HADRInput
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import Trained
from hadr.training.presets import preset
from hadr.training.tasks.diagnosis import (
    diagnose,
    effective_rank,
    gradient_norms,
    recorded_stages,
    with_other_colors,
)
from hadr.training.tasks.task import Task


@pytest.mark.parametrize(
    ("deviations", "wanted"),
    [
        ((1, 1, 1, 0), 3.0),
        ((1, 0, 0, 0), 1.0),
        ((0, 0, 0, 0), 0.0),
        # Variances 1 and 3: exp(-(1/4 ln 1/4 + 3/4 ln 3/4)).
        ((1, 3**0.5, 0, 0), 1.7547653506033),
    ],
)
def test_effective_rank_by_hand(deviations: tuple[float, ...], wanted: float) -> None:
    # Along each axis two points to either side: their directions vary independently.
    rows = torch.cat([torch.diag(torch.tensor(deviations)) * sign for sign in (1.0, -1.0)])
    shifted = rows + torch.tensor([5.0, 1.0, -2.0, 0.0])
    rotation = torch.linalg.qr(torch.rand(4, 4, generator=torch.Generator().manual_seed(1)))[0]
    assert effective_rank(shifted @ rotation) == pytest.approx(wanted, abs=1e-4)
    maps = shifted.view(2, 2, 2, 4).permute(0, 3, 1, 2)
    assert effective_rank(maps) == pytest.approx(wanted, abs=1e-4)


class Reads(nn.Module):
    """Answers with the mean of the frame's red, in metres; only the first stage varies."""

    def __init__(self) -> None:
        super().__init__()
        self.stages = nn.ModuleList([nn.Identity(), nn.Identity()])
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, inputs: HADRInput) -> DepthOutput:
        first = self.stages[0](inputs.color)
        second = self.stages[1](torch.ones_like(first))
        depth = (first[:, :1] * second[:, :1]).mean(dim=(2, 3)) * self.weight
        image = depth[:, :, None].expand(inputs.depth.shape) * inputs.mask
        return DepthOutput(image, image > 0)


def test_what_other_colors_cost_and_what_varies(make_frames: Callable[..., FrameTensors]) -> None:
    frames = make_frames(6)
    near = torch.tensor([0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
    color = torch.rand(frames.inputs.color.shape, generator=torch.Generator().manual_seed(1))
    color[:, 0] = near[:, None, None]
    truth = near[:, None, None].expand(frames.true_depth.shape).contiguous()
    frames = replace(frames, inputs=replace(frames.inputs, color=color), true_depth=truth)
    kind = replace(NETWORKS["unet-hand"], encoders=("stages",))
    found = diagnose(Reads(), kind, frames, batch_size=4)
    # Half of six frames away each reads a depth that is 0.3 m off, and its own one rightly.
    assert found["color_gain_m"] == pytest.approx(0.3, abs=1e-6)
    assert 2.5 < found["rank_1"] <= 3
    assert found["rank_2"] == 0


def test_only_colors_change_places(make_frames: Callable[..., FrameTensors]) -> None:
    frames = make_frames(5)
    other = with_other_colors(frames)
    assert torch.equal(other.inputs.color, frames.inputs.color[[3, 4, 0, 1, 2]])
    assert torch.equal(other.inputs.depth, frames.inputs.depth)
    assert torch.equal(other.inputs.keypoints, frames.inputs.keypoints)


@pytest.mark.parametrize("kind", [kind for kind in NETWORKS if NETWORKS[kind].encoders])
def test_of_each_encoder_a_map_a_stage_is_kept(kind: str) -> None:
    network = Task(preset("tiny", kind)).build().eval()
    encoder: Any = next(iter(NETWORKS[kind].encoders_of(network).values()))
    kept: list[list[Tensor]]

    @torch.no_grad()
    def look() -> None:
        for part in encoder if isinstance(encoder, nn.ModuleList) else [encoder]:
            part(torch.rand(2, next(part.parameters()).shape[1], 32, 32))

    with recorded_stages(encoder) as kept:
        look()
    look()  # this no longer counts
    assert len(kept) >= 2
    assert all(len(maps) == 1 and maps[0].ndim == 4 for maps in kept)


def test_gradients_are_measured_by_part() -> None:
    network = nn.Module()
    network.eye = nn.ModuleDict({"swin": nn.Linear(2, 1, bias=False), "rest": nn.Linear(1, 1)})
    network.mouth = nn.Linear(3, 1, bias=False)
    network.still = nn.Linear(3, 1)
    eye: Any = network.eye
    eye["swin"].weight.grad = torch.tensor([[3.0, 4.0]])
    eye["rest"].weight.grad, eye["rest"].bias.grad = torch.tensor([[0.0]]), torch.tensor([2.0])
    network.mouth.weight.grad = torch.tensor([[1.0, 2.0, 2.0]])
    norms = gradient_norms(network, ("eye.swin",))
    assert {name: float(norm) for name, norm in norms.items()} == pytest.approx(
        {"gradient_eye.swin": 5, "gradient_eye": 2, "gradient_mouth": 3}
    )


def test_a_training_writes_its_diagnosis(through: tuple[Trained, Path]) -> None:
    trained, folder = through
    names = (folder / "history.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    parts = ("backbone.swin", "backbone", "voxel_features", "probability_decoder", "offset_decoder")
    assert {f"gradient_{part}" for part in parts} <= set(names)
    assert {"rank_1", "rank_2", "color_gain_m"} <= set(names)
    for row in trained.history:
        assert 0 < row["rank_1"] <= 8
        assert 0 < row["rank_2"] <= 16
        assert row["gradient_offset_decoder"] > 0


def test_every_depth_network_can_be_diagnosed() -> None:
    assert [kind for kind in DEPTH_NETWORKS if not NETWORKS[kind].encoders] == ["dfnet"]
