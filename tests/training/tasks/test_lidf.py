from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import nn

from hadr.rivals.lidf import LIDF, DilatedResNetConfig, LIDFConfig
from hadr.training.checkpoints import load_checkpoint
from hadr.training.frames.batches import FrameTensors
from hadr.training.loop import Trained, train
from hadr.training.losses import LIDF_WEIGHTS
from hadr.training.recipe import Preset
from hadr.training.tasks.lidf import draw_perturbation, stage
from hadr.training.tasks.task import Task, validate_depth
from hadr.training.training_folder import LAST

MICRO = Preset(
    name="micro",
    width=32,
    height=24,
    network="lidf",
    model=LIDFConfig(
        backbone=DilatedResNetConfig(depths=(1, 1, 1, 1), widths=(8, 8, 16, 16)),
        decoder_widths=(32, 16),
        voxel_width=24,
        max_points=200,
        first_share=0.5,
    ),
    weights=LIDF_WEIGHTS,
    epochs=4,
    drop_epoch=4,
    batch_size=4,
    true_voxel_epochs=1,
    augment=False,
)


def learn(frames: FrameTensors, recipe: Preset = MICRO, **how: Any) -> Trained:
    return train(recipe, frames, progress=False, **how)


def state(model: nn.Module, part: str = "") -> dict[str, torch.Tensor]:
    return {n: v.clone() for n, v in model.state_dict().items() if n.startswith(part)}


def same(one: dict[str, torch.Tensor], two: dict[str, torch.Tensor]) -> bool:
    return one.keys() == two.keys() and all(torch.equal(v, two[n]) for n, v in one.items())


@pytest.mark.parametrize(
    ("epochs", "share", "first"), [(90, 2 / 3, 60), (12, 2 / 3, 8), (4, 0.5, 2), (2, 0.1, 1)]
)
def test_the_stage_follows_from_the_epoch(epochs: int, share: float, first: int) -> None:
    recipe = replace(MICRO, epochs=epochs, model=replace(MICRO.model, first_share=share))  # type: ignore[type-var]
    stages = [stage(recipe, epoch) for epoch in range(epochs)]
    assert stages == [1] * first + [2] * (epochs - first)
    alone = replace(recipe, model=replace(recipe.model, refine=False))  # type: ignore[type-var]
    assert {stage(alone, epoch) for epoch in range(epochs)} == {1}


def test_what_is_frozen_stays_to_the_bit(frames: FrameTensors) -> None:
    states: list[dict[str, torch.Tensor]] = []
    trained = learn(frames, watch=lambda _, model: states.append(state(model)))

    def part(epoch: int, name: str) -> dict[str, torch.Tensor]:
        return {n: v for n, v in states[epoch].items() if n.startswith(name)}

    assert any(name.endswith("running_mean") for name in part(0, "first"))
    assert not same(part(0, "first"), part(1, "first"))
    assert same(part(1, "first"), part(2, "first"))
    assert same(part(1, "first"), part(3, "first"))
    assert same(part(0, "refinement"), part(1, "refinement"))
    assert not same(part(1, "refinement"), part(2, "refinement"))
    assert not same(part(2, "refinement"), part(3, "refinement"))
    assert [int(states[epoch]["stage"]) for epoch in range(4)] == [1, 1, 2, 2]
    history = trained.history
    assert "first_depth" not in history[1]
    assert history[2]["first_depth"] == pytest.approx(history[3]["first_depth"], rel=1e-5)
    assert history[2]["first_depth"] != history[2]["depth"]


def test_clipping_and_averaging_leave_the_frozen_stage_alone_too(frames: FrameTensors) -> None:
    recipe = replace(MICRO, clip_norm=1.0, average_decay=0.5)
    averages: list[dict[str, torch.Tensor]] = []
    trained = learn(frames, recipe, watch=lambda _, model: averages.append(state(model)))
    assert trained.model.refines
    running = [name for name in averages[1] if "running" in name]
    assert running
    assert all(torch.equal(averages[1][name], averages[3][name]) for name in running)


@pytest.fixture(scope="module")
def through(frames: FrameTensors) -> Trained:
    """A whole training with seed 3."""
    return learn(frames, seed=3)


@pytest.mark.parametrize("stopped", [1, 2, 3])
def test_a_resumed_training_ends_with_the_same_weights(frames, through, tmp_path, stopped):
    learn(frames, seed=3, folder=tmp_path, stop_after=stopped)
    kept, _ = load_checkpoint(tmp_path / LAST)
    assert kept.refines == (stopped > 2)  # what has not begun to learn does not answer
    torch.manual_seed(999)
    resumed = learn(frames, seed=3, folder=tmp_path, resume=True)
    assert same(state(through.model), state(resumed.model))
    last, meta = load_checkpoint(tmp_path / LAST)
    assert meta["network"] == "lidf"
    scores = [validate_depth(model, frames, 4) for model in (last, through.model)]
    assert scores[0] == scores[1]


def test_the_losses_of_both_stages_are_weighted_as_published(frames: FrameTensors) -> None:
    torch.manual_seed(0)
    task = Task(MICRO)
    model = task.build().train()
    few = frames.take([0, 1])
    one = {k: v.item() for k, v in task.losses(model, few, 0, torch.Generator()).items()}
    assert one["probability"] > 0
    assert one["loss"] == pytest.approx(
        100 * one["depth"] + 0.5 * one["probability"] + 10 * one["normals"], rel=1e-5
    )
    two = {k: v.item() for k, v in task.losses(model, few, 2, torch.Generator()).items()}
    assert two["loss"] == pytest.approx(100 * two["depth"] + 10 * two["normals"], rel=1e-5)


def test_true_voxels_are_told_in_the_first_epochs_only(frames: FrameTensors) -> None:
    recipe = replace(MICRO, true_voxel_epochs=4)  # longer than the first stage
    task = Task(recipe)
    told: list[bool] = []

    class Spy(LIDF):
        def forward(self, *inputs: Any, **options: Any) -> Any:
            told.append(options["true_depth"] is not None)
            return super().forward(*inputs, **options)

    model = Spy(recipe.model).train()
    for epoch in range(4):
        task.losses(model, frames, epoch, torch.Generator())
    assert told == [True, True, False, False]


def test_a_perturbed_batch_starts_farther_off(frames: FrameTensors) -> None:
    """A fresh refinement moves nothing: the depth term shows what it was given."""
    task = Task(replace(MICRO, model=replace(MICRO.model, perturb_probability=1.0)))  # type: ignore[type-var]
    calm = Task(replace(MICRO, model=replace(MICRO.model, perturb_probability=0.0)))  # type: ignore[type-var]
    torch.manual_seed(0)
    model = task.build().train()
    found = [t.losses(model, frames, 2, torch.Generator().manual_seed(1)) for t in (task, calm)]
    assert found[0]["first_depth"] == found[1]["first_depth"]
    assert found[1]["depth"].item() == pytest.approx(found[1]["first_depth"].item(), abs=1e-6)
    assert abs(found[0]["depth"].item() - found[0]["first_depth"].item()) > 1e-4


def test_perturbations_are_spread_as_published() -> None:
    generator = torch.Generator().manual_seed(0)
    drawn = torch.tensor([draw_perturbation(generator, 0.8) for _ in range(8000)])
    assert (drawn == 0).float().mean().item() == pytest.approx(0.2, abs=0.02)
    moved = drawn[drawn != 0]
    edges = ((-0.1, -0.05, 0.1), (-0.05, 0.0, 0.5), (0.0, 0.05, 0.3), (0.05, 0.1, 0.1))
    for low, high, share in edges:
        inside = moved[(moved >= low) & (moved < high)]
        assert len(inside) / len(moved) == pytest.approx(share, abs=0.02)
        assert inside.mean().item() == pytest.approx((low + high) / 2, abs=0.004)
    assert moved.abs().max() <= 0.1
    assert all(draw_perturbation(generator, 0.0) == 0 for _ in range(9))
    before = generator.get_state()
    draw_perturbation(generator, 0.0)
    skipped = generator.get_state()
    generator.set_state(before)
    draw_perturbation(generator, 1.0)
    assert torch.equal(generator.get_state(), skipped)  # always as many numbers


def test_longer_training_does_not_go_back_to_the_first_stage(frames: FrameTensors) -> None:
    task = Task(MICRO)
    model = task.build().train()
    task.losses(model, frames, 2, torch.Generator())
    longer = Task(replace(MICRO, epochs=20))
    with pytest.raises(ValueError, match=r"of 20 epochs the first 10 are .* got epoch 5"):
        longer.losses(model, frames, 4, torch.Generator())
