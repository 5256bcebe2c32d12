from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from hadr.models.networks import NETWORKS
from hadr.records.provenance import plain
from hadr.rivals.unet_hand import UNetHandConfig
from hadr.training import presets
from hadr.training.checkpoints import load_checkpoint, save_checkpoint
from hadr.training.loop import optimizer_of
from hadr.training.presets import RECIPES, preset, recipe_from_dict
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task


def test_paper_preset_has_the_papers_figures() -> None:
    paper = preset("paper")
    assert paper.size == (224, 224)
    assert (paper.epochs, paper.batch_size) == (100, 40)
    assert [paper.rate(epoch) for epoch in (0, 79, 80, 99)] == pytest.approx(
        [1e-3, 1e-3, 1e-4, 1e-4]
    )
    weights = paper.weights
    assert (weights.depth, weights.probability, weights.normals) == (200, 10, 0.5)
    swin = paper.model.backbone
    assert (swin.embed_dim, swin.depths, swin.heads) == (96, (2, 2, 6, 2), (3, 6, 12, 24))
    assert (swin.window, swin.drop_path) == (7, 0.2)
    assert sum(paper.model.parts) == 511
    assert paper.model.grid.cells == 8
    assert paper.model.max_points == 10_000
    assert paper.true_voxel_epochs == 6
    # and nothing that is not published
    assert (paper.schedule, paper.warmup_epochs, paper.clip_norm) == ("step", 0.0, None)
    assert (paper.average_decay, paper.mirror, paper.zoom, paper.roll_deg) == (None, 0, 1, 0)
    assert (paper.ray_stride, paper.augment) == (1, True)


def test_an_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match="one of tiny, mini, paper, imagenet, got 'huge'"):
        preset("huge")


def test_rates_of_a_cosine_with_warm_up() -> None:
    recipe = Preset("test", 8, 8, schedule="cosine", epochs=10, learning_rate=2.0, warmup_epochs=2)
    assert recipe.rate(0) == 0
    assert recipe.rate(1) == pytest.approx(0.5 * (1 + math.cos(math.pi / 10)))
    assert recipe.rate(5) == pytest.approx(1.0)
    assert recipe.rate(10) == pytest.approx(0)
    step = Preset("test", 8, 8, epochs=10, drop_epoch=8, learning_rate=2.0)
    assert [step.rate(7.99), step.rate(8)] == pytest.approx([2.0, 0.2])


def test_rates_at_milestones_which_are_shares_of_the_training() -> None:
    recipe = Preset(
        "test", 8, 8, epochs=40, learning_rate=1e-3, milestones=(5 / 40, 15 / 40), decay=0.2
    )
    rates = [recipe.rate(epoch) for epoch in (0, 4.99, 5, 14.99, 15, 39)]
    assert rates == pytest.approx([1e-3, 1e-3, 2e-4, 2e-4, 4e-5, 4e-5])


def test_a_cosine_that_begins_again_at_a_restart() -> None:
    recipe = Preset("test", 8, 8, schedule="cosine", epochs=12, restarts=(2 / 3,))
    rates = [recipe.rate(epoch) / recipe.learning_rate for epoch in (0, 4, 8 - 1e-9, 8, 10, 12)]
    assert rates == pytest.approx([1, 0.5, 0, 1, 0.5, 0], abs=1e-9)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda recipe: f"{recipe.network}-{recipe.name}")
def test_a_recorded_recipe_is_the_recipe_again(recipe: Preset) -> None:
    assert recipe_from_dict(json.loads(json.dumps(plain(recipe.to_dict())))) == recipe


def test_a_late_field_is_recorded_only_where_it_does_something() -> None:
    recipe = preset("mini")
    usual = recipe.to_dict()
    assert not {"optimizer", "weight_decay", "milestones", "decay"} & set(usual)
    assert "patch" not in usual["model"]["backbone"]
    fine = replace(recipe.model, backbone=replace(recipe.model.backbone, patch=2))
    late = replace(recipe, model=fine, optimizer="adamw", weight_decay=0.01).to_dict()
    assert (late.pop("optimizer"), late.pop("weight_decay")) == ("adamw", 0.01)
    assert late["model"]["backbone"].pop("patch") == 2
    assert late == usual


def test_weight_decay_shrinks_what_has_no_gradient() -> None:
    layer = nn.Linear(2, 2)
    before = layer.weight.detach().clone()
    optimizer = optimizer_of(
        Preset("test", 8, 8, optimizer="adamw", weight_decay=0.1, learning_rate=1e-2), layer
    )
    (layer.weight.sum() * 0).backward()
    optimizer.step()
    torch.testing.assert_close(layer.weight.detach(), before * (1 - 1e-3))
    assert type(optimizer_of(Preset("test", 8, 8), layer)) is torch.optim.Adam


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epochs": 0}, "epochs must be at least 1, got 0"),
        ({"schedule": "linear"}, "schedule must be 'step' or 'cosine', got 'linear'"),
        ({"mirror": 1.5}, "mirror must be from 0 to 1, got 1.5"),
        ({"zoom": 0.5}, "zoom must be from 1 to 4, got 0.5"),
        ({"clip_norm": 0.0}, "clip_norm must be positive, got 0.0"),
        ({"optimizer": "sgd"}, "optimizer must be 'adam' or 'adamw', got 'sgd'"),
        ({"weight_decay": 0.1}, "weight_decay is AdamW's, got 0.1 with 'adam'"),
        ({"milestones": (0.5, 0.2)}, r"milestones must rise strictly .* got \(0.5, 0.2\)"),
        ({"milestones": (0.5, 1.0)}, r"milestones must rise strictly .* got \(0.5, 1.0\)"),
        ({"warmup_epochs": 200.0}, "warmup_epochs must be from 0 to 100, got 200.0"),
    ],
)
def test_numbers_out_of_range_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Preset("test", 8, 8, **change)


def test_every_network_has_recipes_that_its_task_builds() -> None:
    for network in NETWORKS:
        recipe = preset("tiny", network)
        assert Task(recipe).build().config == recipe.model
        other = preset("tiny", "hadr" if network != "hadr" else "lidf")
        with pytest.raises(ValueError, match=rf"'tiny' of '{network}' must have a \w+Config, got"):
            Task(replace(other, network=network))
    with pytest.raises(ValueError, match=r"network must be one of hadr, .*, got 'resnet'"):
        preset("tiny", "resnet")
    with pytest.raises(ValueError, match=r"network must be one of hadr, .*, got 'resnet'"):
        Task(Preset("test", 8, 8, network="resnet"))


@pytest.mark.parametrize("network", NETWORKS)
def test_a_checkpoint_of_every_network_is_read_as_that_network(network, tmp_path):
    torch.manual_seed(0)
    model = Task(preset("tiny", network)).build()
    for module in model.modules():  # so that integers and running statistics are seen to travel
        if isinstance(module, torch.nn.BatchNorm2d) and module.num_batches_tracked is not None:
            module.num_batches_tracked.fill_(3_000_001)
    save_checkpoint(tmp_path / "net.safetensors", model, {"width": 32, "height": 24})
    again, meta = load_checkpoint(tmp_path / "net.safetensors")
    assert (type(again), meta["network"]) == (type(model), network)
    assert again.config == model.config
    state = again.state_dict()
    for name, values in model.state_dict().items():
        assert values.dtype == state[name].dtype
        assert torch.equal(values, state[name]), name
    sizes = {"net": (tmp_path / "net.safetensors").stat().st_size}
    for stored in ("float16", "int8"):
        path = tmp_path / f"{stored}.safetensors"
        save_checkpoint(path, *load_checkpoint(tmp_path / "net.safetensors"), stored=stored)
        small, meta = load_checkpoint(path)
        assert meta["network"] == network
        for name, values in small.state_dict().items():
            assert values.dtype == state[name].dtype
            if stored == "int8" and values.is_floating_point() and values.ndim > 1:
                largest = state[name].flatten(1).abs().amax(dim=1)
                off = (values - state[name]).flatten(1).abs().amax(dim=1)
                assert (off <= largest / 253).all(), name  # half a step of 127
            else:
                torch.testing.assert_close(values, state[name], rtol=1e-3, atol=1e-6, msg=name)
        sizes[stored] = path.stat().st_size
    assert sizes["float16"] < 0.7 * sizes["net"]
    assert sizes["int8"] < 0.7 * sizes["float16"]


def test_the_line_with_which_a_method_of_ones_own_gets_its_recipes_works() -> None:
    page = (Path(__file__).resolve().parents[2] / "book" / "own_method.md").read_text("utf-8")
    (line,) = re.findall(r"^    (\*\(replace\(.*\)),$", page, re.M)
    known = vars(presets) | {"MineConfig": UNetHandConfig}
    found = eval(f"({line.replace('mine', 'unet-hand')},)", known)
    assert [recipe.name for recipe in found] == ["tiny", "mini", "paper"]
    assert {type(recipe.model) for recipe in found} == {UNetHandConfig}
